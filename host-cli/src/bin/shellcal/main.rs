//! `shellcal`: from the recordings of an optical force/torque shell to forces and moments.

mod args;
mod cmd;
mod files;
mod hints;
mod outcome;
mod printer;
mod signals;

use std::io::{self, Write};
use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches};
use shell_data::instructions;
use shellcal::output;

fn main() -> ExitCode {
    if std::env::args_os().len() < 2 {
        let _ = writeln!(io::stderr(), "{}", args::GREETING);
        return ExitCode::from(2);
    }
    let mut command = args::Args::command();
    let matches = command.get_matches_mut();
    let args = match args::Args::from_arg_matches(&matches) {
        Ok(args) => args,
        Err(error) => error.format(&mut command).exit(),
    };
    output::before_unfinished(signals::listen);
    let mut printer = printer::Printer::new(args.output);
    let ran = instructions::chosen()
        .map_err(anyhow::Error::from)
        .and_then(|_| Ok(files::outputs(&matches)?))
        .and_then(|outputs| args.command.run(&mut printer, &outputs, args::Args::command));
    match ran {
        Ok(outcome) => outcome.into(),
        Err(error) if hints::is_closed_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            printer.error(&error, hints::for_error(&error).as_deref());
            ExitCode::from(2)
        }
    }
}
