//! One file per subcommand, each a set of arguments with a `run`.

mod align;
mod bench;
mod board;
mod choices;
mod convert;
mod eval;
mod fit;
mod frames;
mod import;
mod info;
mod mapping;
mod merge;
mod noise;
mod origin;
mod ports;
mod quality;
mod record;
mod serial;
mod simulate;
#[cfg(unix)]
mod simulate_board;
mod synth;
mod synth_pair;
mod synth_trial;
mod trials;
mod validation;

use std::process::ExitCode;

use clap::Subcommand;

use crate::printer::Printer;

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    Ports(ports::PortsArgs),
    Board(board::BoardArgs),
    Record(record::RecordArgs),
    Info(info::InfoArgs),
    Align(Box<align::AlignArgs>),
    Fit(Box<fit::FitArgs>),
    Merge(merge::MergeArgs),
    Eval(Box<eval::EvalArgs>),
    Convert(Box<convert::ConvertArgs>),
    Noise(noise::NoiseArgs),
    Trial(Box<trials::trial::TrialArgs>),
    Batch(Box<trials::batch::BatchArgs>),
    Window(Box<trials::window::WindowArgs>),
    Plot(Box<trials::plot::PlotArgs>),
    Report(Box<trials::report::ReportArgs>),
    Stats(trials::stats::StatsArgs),
    Profile(trials::profile::ProfileArgs),
    Import(import::ImportArgs),
    Bench(bench::BenchArgs),
    Synth(synth::SynthArgs),
    Simulate(Box<simulate::SimulateArgs>),
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
            Command::Ports(args) => args.run(printer),
            Command::Board(args) => args.run(printer),
            Command::Record(args) => args.run(printer),
            Command::Info(args) => args.run(printer),
            Command::Align(args) => args.run(printer),
            Command::Fit(args) => args.run(printer),
            Command::Merge(args) => args.run(printer),
            Command::Eval(args) => args.run(printer),
            Command::Convert(args) => args.run(printer),
            Command::Noise(args) => args.run(printer),
            Command::Trial(args) => args.run(printer),
            Command::Batch(args) => args.run(printer),
            Command::Window(args) => args.run(printer),
            Command::Plot(args) => args.run(printer),
            Command::Report(args) => args.run(printer),
            Command::Stats(args) => args.run(printer),
            Command::Profile(args) => args.run(printer),
            Command::Import(args) => args.run(printer),
            Command::Bench(args) => args.run(printer),
            Command::Synth(args) => args.run(printer),
            Command::Simulate(args) => args.run(printer),
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
