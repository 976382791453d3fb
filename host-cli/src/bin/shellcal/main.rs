//! `shellcal`: from the recordings of an optical force/torque shell to forces and moments.

#[macro_use]
mod document;

mod args;
mod cmd;
mod config;
mod files;
mod hints;
mod printer;
mod signals;
mod tables;

use std::borrow::Cow;
use std::io::{self, Write};
use std::process::ExitCode;

use clap::{ArgMatches, CommandFactory, FromArgMatches};
use shell_data::{escape, instructions};

fn main() -> ExitCode {
    if std::env::args_os().len() < 2 {
        let _ = writeln!(io::stderr(), "{}", args::GREETING);
        return ExitCode::from(2);
    }
    let mut command = args::Args::command().color(args::color_of(std::env::args_os()));
    let matches = command.try_get_matches_from_mut(std::env::args_os());
    let matches = matches.unwrap_or_else(|error| refuse(&error));
    let said = parsed(&mut command, &matches);
    output_file::before_unfinished(signals::listen);
    let printer = printer::Printer::new(said.output);
    match run(&mut command, &said.config, matches, &printer) {
        Ok(outcome) => outcome.into(),
        Err(error) if hints::is_closed_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            printer.error(&error, hints::for_error(&error).as_deref());
            ExitCode::from(2)
        }
    }
}

/// Ends the program where the command line cannot be.
fn parsed(command: &mut clap::Command, matches: &ArgMatches) -> args::Args {
    args::Args::from_arg_matches(matches).unwrap_or_else(|error| refuse(&error.format(command)))
}

/// Prints help, or what is wrong with the command line, and ends the program. Arguments may hold anything.
fn refuse(error: &clap::Error) -> ! {
    let text = error.render().to_string();
    let lines: Vec<_> = text.lines().map(escape::terminal).collect();
    if error.use_stderr() && lines.iter().any(|line| matches!(line, Cow::Owned(_))) {
        let _ = writeln!(io::stderr(), "{}", lines.join("\n"));
        std::process::exit(error.exit_code());
    }
    error.exit()
}

/// Runs a command, with the settings of its data.
fn run(
    command: &mut clap::Command,
    config: &config::ConfigArgs,
    matches: ArgMatches,
    printer: &printer::Printer,
) -> anyhow::Result<printer::Outcome> {
    instructions::chosen().map_err(anyhow::Error::msg)?;
    let words: Vec<_> = std::env::args_os().collect();
    let configured = config::configure(words.clone(), command, config, matches)?;
    let args = parsed(command, &configured.matches);
    if let Some(why) = files::misplaced_value(command, &configured.matches, &words) {
        anyhow::bail!(why);
    }
    files::collect(&configured.matches, &printer.files)?;
    if let Some(file) = configured.file() {
        printer.files.protect(file)?;
    }
    configured.explain(command, printer);
    args.command.run(printer, args::Args::command)
}
