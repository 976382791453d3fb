//! Wall time and peak memory of one program.
//!
//! The system keeps the peak memory of all children of a process together, so each program gets a
//! parent of its own: this task, which runs it and prints the two figures.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

use anyhow::{Context, Result, bail};
use nix::sys::resource::{UsageWho, getrusage};
use serde::{Deserialize, Serialize};

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The program and its arguments
    #[arg(trailing_var_arg = true, required = true)]
    command: Vec<String>,
}

/// What one run of a program took.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct Measurement {
    /// Wall time from start to exit in s.
    pub(crate) wall_s: f64,
    /// Peak resident memory in bytes.
    pub(crate) peak_bytes: u64,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let start = Instant::now();
    let output = Command::new(&args.command[0])
        .args(&args.command[1..])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .output()
        .with_context(|| format!("cannot start `{}`", args.command[0]))?;
    let wall_s = start.elapsed().as_secs_f64();
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        bail!("`{}`: {}: {}", args.command.join(" "), output.status, said.trim_end());
    }
    let peak_kib = getrusage(UsageWho::RUSAGE_CHILDREN)?.max_rss();
    let peak_bytes = u64::try_from(peak_kib).context("no peak memory")? * 1024;
    println!("{}", serde_json::to_string(&Measurement { wall_s, peak_bytes })?);
    Ok(())
}

/// Runs `command` once under a parent of its own.
pub(crate) fn measure(command: &[String]) -> Result<Measurement> {
    let this = std::env::current_exe().context("cannot find this program")?;
    let output = Command::new(this).args(["measure", "--"]).args(command).output()?;
    if !output.status.success() {
        bail!("{}", String::from_utf8_lossy(&output.stderr).trim_end());
    }
    serde_json::from_slice(&output.stdout).context("no measurement came back")
}

/// The median wall time and the largest peak of `runs`.
pub(crate) fn summary(runs: &[Measurement]) -> Measurement {
    let mut walls: Vec<f64> = runs.iter().map(|run| run.wall_s).collect();
    walls.sort_by(f64::total_cmp);
    Measurement {
        wall_s: walls[walls.len() / 2],
        peak_bytes: runs.iter().map(|run| run.peak_bytes).max().unwrap_or(0),
    }
}

/// Whether `program` can be started here.
pub(crate) fn installed(program: &str, check: &[&str]) -> bool {
    let run =
        Command::new(program).args(check).stdout(Stdio::null()).stderr(Stdio::null()).status();
    run.is_ok_and(|status| status.success())
}

/// A path as an argument.
pub(crate) fn argument(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}
