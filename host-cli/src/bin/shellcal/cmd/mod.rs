//! One file per subcommand, each a set of arguments with a `run`.

mod eval;
mod fit;
mod import;
mod info;
mod mapping;
mod origin;
mod quality;
mod synth;

use std::process::ExitCode;

use clap::Subcommand;

use crate::printer::Printer;

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    Synth(synth::Synth),
    Info(info::InfoArgs),
    Fit(Box<fit::FitArgs>),
    Eval(Box<eval::EvalArgs>),
    Import(import::ImportArgs),
}

/// How a command that could run has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// Done.
    Done,
    /// Ran, but a check that the user asked for has failed.
    CheckFailed,
}

impl Command {
    pub(crate) fn run(&self, printer: &mut Printer) -> anyhow::Result<Outcome> {
        match self {
            Command::Synth(command) => command.run(printer),
            Command::Info(args) => args.run(printer),
            Command::Fit(args) => args.run(printer),
            Command::Eval(args) => args.run(printer),
            Command::Import(args) => args.run(printer),
        }
    }
}

impl From<Outcome> for ExitCode {
    fn from(outcome: Outcome) -> Self {
        match outcome {
            Outcome::Done => ExitCode::SUCCESS,
            Outcome::CheckFailed => ExitCode::from(1),
        }
    }
}
