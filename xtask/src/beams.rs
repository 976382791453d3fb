//! `cargo xtask bench-beams`: forces in the beam channel against companion matrices in numpy.
//!
//! Each solver gets the same positions. Only the solving is timed, not the start of a process; the
//! runs are interleaved, so that a busy moment of the machine hits all alike.

use std::process::Command;

use anyhow::{Context, Result, ensure};
use serde::Deserialize;

use crate::measure::installed;
use crate::steps;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Positions on the way through the channel
    #[arg(long, default_value_t = 200)]
    positions: u32,

    /// Runs of every solver
    #[arg(long, default_value_t = 7)]
    runs: u32,
}

/// Channel of 2 cm deflection, its spacing, and the way through it, in m.
const WIDTH: &str = "0.06";
const PITCH: f64 = 0.28 / 11.0;
const MARGIN: f64 = 0.1;

/// Beams of a row.
const BEAMS: [u32; 3] = [11, 110, 11_000];

#[derive(Deserialize)]
struct Ours {
    contacts: u64,
    #[serde(flatten)]
    run: Run,
}

#[derive(Deserialize)]
struct Peers {
    one_by_one: Run,
    all_at_once: Run,
}

#[derive(Deserialize)]
struct Run {
    seconds: Vec<f64>,
    totals: Vec<f64>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    ensure!(installed("python3", &["-c", "import numpy"]), "python3 with numpy is needed");
    let build = ["build", "--release", "--package", "beam-channel", "--example", "sweep"];
    steps::run("build the sweep", &mut steps::cargo(&build))?;
    let sweep = steps::target().join("release/examples/sweep");
    let script = steps::workspace().join("beam-channel/benches/peer_companion.py");

    println!("beam-channel, one wall of two equal ones");
    println!("{:>6} {:>12} {:>13} {:>13}", "beams", "µs/position", "ns/contact", "contacts/pos.");
    for beams in BEAMS {
        let ours = ours(&sweep, beams, args.positions * 10, args.runs)?;
        let (seconds, positions) = (median(&ours.run.seconds), f64::from(args.positions * 10));
        println!(
            "{beams:>6} {:>12.3} {:>13.1} {:>13.2}",
            seconds * 1e6 / positions,
            seconds * 1e9 / ours.contacts as f64,
            ours.contacts as f64 / positions,
        );
    }

    let beams = BEAMS[0];
    let (mut fast, mut roots, mut batch) = (Vec::new(), Vec::new(), Vec::new());
    let (mut differences, mut last) = ([0.0, 0.0], None);
    for _ in 0..args.runs {
        let ours = ours(&sweep, beams, args.positions, 1)?;
        let peers: Peers = output(Command::new("python3").arg(&script), beams, args.positions, 1)?;
        differences = [&peers.one_by_one, &peers.all_at_once]
            .map(|run| greatest_difference(&ours.run.totals, &run.totals));
        fast.extend(ours.run.seconds);
        roots.extend(peers.one_by_one.seconds);
        batch.extend(peers.all_at_once.seconds);
        last = Some(ours.contacts);
    }
    ensure!(last.is_some(), "no runs");
    println!("\n{beams} beams, {} positions, medians of {} runs", args.positions, args.runs);
    println!("{:<40} {:>12} {:>8} {:>14}", "", "µs/position", "ratio", "difference (N)");
    let positions = f64::from(args.positions);
    let solvers = [
        ("beam-channel", &fast, None),
        ("numpy.roots, beam by beam", &roots, Some(differences[0])),
        ("numpy.linalg.eigvals, all at once", &batch, Some(differences[1])),
    ];
    for (name, seconds, difference) in solvers {
        println!(
            "{name:<40} {:>12.3} {:>8.1} {:>14}",
            median(seconds) * 1e6 / positions,
            median(seconds) / median(&fast),
            difference.map_or_else(String::new, |difference| format!("{difference:.1e}")),
        );
    }
    Ok(())
}

fn ours(sweep: &std::path::Path, beams: u32, positions: u32, repeats: u32) -> Result<Ours> {
    output(&mut Command::new(sweep), beams, positions, repeats)
}

/// Runs a sweep over the way through the channel, or ten spacings in its middle if it is longer.
fn output<T: serde::de::DeserializeOwned>(
    command: &mut Command,
    beams: u32,
    positions: u32,
    repeats: u32,
) -> Result<T> {
    let length = PITCH * f64::from(beams - 1);
    let (from, to) = if beams == BEAMS[0] {
        (-MARGIN, length + MARGIN)
    } else {
        (0.5 * length, 0.5 * length + 10.0 * PITCH)
    };
    // One thread, as ours.
    command.env("OMP_NUM_THREADS", "1").env("OPENBLAS_NUM_THREADS", "1").arg(WIDTH);
    command.args([beams.to_string(), PITCH.to_string(), from.to_string(), to.to_string()]);
    command.args([positions.to_string(), repeats.to_string()]);
    let output = command.output().with_context(|| format!("cannot start {command:?}"))?;
    let said = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "{command:?}: {}: {}", output.status, said.trim_end());
    serde_json::from_slice(&output.stdout).with_context(|| format!("what {command:?} printed"))
}

fn greatest_difference(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[sorted.len() / 2]
}
