//! `cargo xtask …`: the tasks of this workspace that take more than one word of cargo.

mod apt;
mod axe;
mod beams;
mod book;
mod compiler;
mod cross;
mod emulate;
mod emulator;
mod firmware;
mod flash;
mod fuzz;
mod hostile;
mod image;
mod instructions;
mod layers;
mod licences;
mod measure;
mod model;
mod need;
mod package;
mod peers;
mod pictures;
mod python;
mod scale;
mod setup;
mod stack;
mod steps;
mod test;
mod toolchain;
mod trials;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// The tasks of this workspace.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask", max_term_width = 100)]
struct Args {
    #[command(subcommand)]
    task: Task,
}

#[derive(Debug, Subcommand)]
enum Task {
    /// Install what the test run needs, and say each command before it is run
    Setup(setup::Args),
    /// Check and test everything: formatting, lints, tests, documentation
    Test(test::Args),
    /// Check that the program compiles for Windows and for Linux on aarch64
    Cross,
    /// Build the book from the pages of the repository, and follow its links
    Book,
    /// Make the pictures of README anew
    Pictures,
    /// Run every fuzz target for some time
    Fuzz(fuzz::Args),
    /// Run random commands over damaged files and see that nothing fails open
    Hostile(hostile::Args),
    /// Check licences, duplicates and sources of the dependencies against `deny.toml`
    Licences(licences::Args),
    /// Make what a release consists of: an archive and, on Debian, a package
    Package(package::Args),
    /// Look for circles of files and for imports against `layers.toml`; exit code 1 if there are any
    Layers(layers::Args),
    /// Build the boards' images and say what they take; exit code 1 above their limits
    Firmware(firmware::Args),
    /// Build a board's image and flash it, with probe-rs
    Flash(flash::Args),
    /// Run the emulated board on a pty until Ctrl-C
    Emulate(emulate::Args),
    /// Measure whole fits against the tools that people use today
    BenchPeers(peers::Args),
    /// Measure time and memory of a fit against the length of the file
    BenchScale(scale::Args),
    /// Measure a batch of trials against the pipeline that labs use today
    BenchTrials(trials::Args),
    /// Measure forces in the beam channel against companion matrices in numpy
    BenchBeams(beams::Args),
    /// Count the instructions of a fit with and without what it can be asked for
    Instructions(instructions::Args),
    /// Run one program and print its wall time and peak memory (used by the benchmarks)
    #[command(hide = true)]
    Measure(measure::Args),
}

fn main() -> ExitCode {
    let done = match Args::parse().task {
        Task::Setup(args) => setup::run(args),
        Task::Cross => cross::check(),
        Task::Test(args) => test::run(&args),
        Task::Book => book::run(),
        Task::Pictures => pictures::make(),
        Task::Fuzz(args) => fuzz::run(&args),
        Task::Hostile(args) => hostile::run(&args),
        Task::Licences(args) => licences::run(args),
        Task::Package(args) => package::run(&args),
        Task::Layers(args) => layers::run(&args),
        Task::Firmware(args) => firmware::run(args),
        Task::Flash(args) => flash::run(&args),
        Task::Emulate(args) => emulate::run(&args),
        Task::BenchPeers(args) => peers::run(&args),
        Task::BenchScale(args) => scale::run(&args),
        Task::BenchTrials(args) => trials::run(&args),
        Task::BenchBeams(args) => beams::run(&args),
        Task::Instructions(args) => instructions::run(&args),
        Task::Measure(args) => measure::run(&args),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
