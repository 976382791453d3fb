//! `cargo xtask …`: the tasks of this workspace that need more than a single cargo command.

mod book;
mod check;
mod compiler;
mod dependencies;
mod emulate;
mod firmware;
mod image;
mod layers;
mod manual;
mod need;
mod pictures;
mod python;
mod stack;
mod steps;
mod test;
mod web;
mod words;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// The tasks of this workspace.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask", max_term_width = 100)]
struct Xtask {
    #[command(subcommand)]
    task: Task,
}

#[derive(Debug, Subcommand)]
enum Task {
    /// Test that the program works on this machine: Rust, flashed images, Python, browser
    Test(test::TestArgs),
    /// Run the checks that a change must pass in addition to the tests; exit code 1 if any fails
    Check(check::CheckArgs),
    /// Install the requirements of tests and checks; each command is printed before it runs
    Setup(need::SetupArgs),
    /// Write the list of packages in a release, with their licences
    Licences,
    /// Write the manual pages and the shell completions into `man` and `completions`
    Manual(manual::ManualArgs),
    /// Redraw the pictures of README and of the architecture
    Pictures,
    /// Build the page that fits and converts in a browser, and print its size; exit code 1 above the limit
    Web,
    /// Lint and build the boards' images and print their sizes; exit code 1 if they do not fit
    Firmware(firmware::FirmwareArgs),
    /// Build a board's image and flash it, with probe-rs
    Flash(image::FlashArgs),
    /// Run a board's image on the model of its microcontroller, on a pty, until Ctrl-C
    Emulate(emulate::EmulateArgs),
}

fn main() -> ExitCode {
    let done = match Xtask::parse().task {
        Task::Test(args) => test::run(&args),
        Task::Check(args) => check::run(&args),
        Task::Setup(args) => need::set_up(args),
        Task::Manual(args) => manual::write(&args),
        Task::Licences => dependencies::write_notices(),
        Task::Pictures => pictures::make(),
        Task::Web => web::build().map(drop),
        Task::Firmware(args) => firmware::run(args),
        Task::Flash(args) => image::flash(&args),
        Task::Emulate(args) => emulate::run(&args),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
