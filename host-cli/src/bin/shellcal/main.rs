//! `shellcal`: from the recordings of an optical force/torque shell to forces and moments.

mod args;
mod cmd;
mod hints;
mod outcome;
mod printer;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    let args = args::Args::parse();
    let mut printer = printer::Printer::new(args.output);
    match args.command.run(&mut printer) {
        Ok(outcome) => outcome.into(),
        Err(error) if hints::is_closed_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            printer.error(&error, hints::for_error(&error).as_deref());
            ExitCode::from(2)
        }
    }
}
