//! One file per subcommand, each a set of arguments with a `run`.

mod align;
mod convert;
mod eval;
mod fit;
mod frames;
mod import;
mod info;
mod mapping;
mod noise;
mod origin;
mod quality;
mod synth;
mod synth_pair;

use std::process::ExitCode;

use clap::Subcommand;

use crate::printer::Printer;

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    Info(info::InfoArgs),
    Align(Box<align::AlignArgs>),
    Fit(Box<fit::FitArgs>),
    Eval(Box<eval::EvalArgs>),
    Convert(Box<convert::ConvertArgs>),
    Noise(noise::NoiseArgs),
    Import(import::ImportArgs),
    Synth(synth::SynthArgs),
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
            Command::Info(args) => args.run(printer),
            Command::Align(args) => args.run(printer),
            Command::Fit(args) => args.run(printer),
            Command::Eval(args) => args.run(printer),
            Command::Convert(args) => args.run(printer),
            Command::Noise(args) => args.run(printer),
            Command::Import(args) => args.run(printer),
            Command::Synth(args) => args.run(printer),
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
