//! `cargo xtask flash`: builds a board's image and flashes it with probe-rs.

use std::process::Command;

use anyhow::{Result, bail};

use crate::image::Board;
use crate::steps::{self, installed};

#[derive(Debug, clap::Args)]
pub(crate) struct FlashArgs {
    /// Board that is at the probe
    #[arg(long, value_enum, default_value = "skinproc")]
    board: Board,

    /// Probe to use where there are several, as `probe-rs list` names it
    #[arg(long, value_name = "VID:PID[:SERIAL]")]
    probe: Option<String>,

    /// Stay and print the board's log
    #[arg(long)]
    log: bool,
}

pub(crate) fn run(args: &FlashArgs) -> Result<()> {
    // Before minutes are spent on the image.
    if !installed("probe-rs", &["--version"]) {
        bail!(
            "`probe-rs` is missing, which talks to the debug probe; install it with \
             `cargo install --locked probe-rs-tools`, or see https://probe.rs/docs/getting-started"
        );
    }
    let image = args.board.build()?;
    let mut probe = vec!["--chip", args.board.chip()];
    if let Some(selector) = &args.probe {
        probe.extend(["--probe", selector]);
    }
    let command = |name: &str| {
        let mut command = Command::new("probe-rs");
        command.arg(name).args(&probe);
        command
    };
    if args.log {
        return steps::run("flash, reset, and listen until Ctrl-C", command("run").arg(&image));
    }
    steps::run("flash", command("download").arg("--verify").arg(&image))?;
    steps::run("reset", &mut command("reset"))
}
