//! `cargo xtask bench-scale`: a long file must take the memory of a short one, and its share of
//! the time.
//!
//! The long files repeat the rows of one synthetic file, so that making them is quick.

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result};

use crate::measure::{argument, measure, summary};
use crate::steps;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Rows of the short file; the long ones have 10, 100 and 1000 times as many
    #[arg(long, default_value_t = 10_000)]
    rows: usize,

    /// The program that is measured [default: the release, built first]
    #[arg(long, value_name = "FILE")]
    program: Option<PathBuf>,

    /// Runs of every length
    #[arg(long, default_value_t = 5)]
    runs: usize,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let shellcal = args.program.clone().map_or_else(steps::build_shellcal, Ok)?;
    let dir = steps::scratch("bench-scale")?;
    let seed = dir.join("seed.csv");
    let rows = args.rows.to_string();
    let mut synth = Command::new(&shellcal);
    synth.args(["synth", "train", "--layout", "peer", "--rows", &rows, "--output"]).arg(&seed);
    steps::run("make the rows", &mut synth)?;

    println!(
        "{:>12} {:>10} {:>12} {:>14} {:>10}",
        "rows", "MB", "median ms", "ns per row", "peak MB"
    );
    for factor in [1, 10, 100, 1000] {
        let path = repeat(&seed, &dir, factor)?;
        let command =
            ["fit", &argument(&path), "--output", "/dev/null", "--covariance", "rows", "--quiet"];
        let command: Vec<_> =
            [argument(&shellcal)].into_iter().chain(command.map(str::to_owned)).collect();
        let runs: Result<Vec<_>> = (0..args.runs).map(|_| measure(&command)).collect();
        let median = summary(&runs?);
        println!(
            "{:>12} {:>10.1} {:>12.1} {:>14.1} {:>10.1}",
            args.rows * factor,
            fs::metadata(&path)?.len() as f64 / 1e6,
            median.wall_s * 1e3,
            median.wall_s * 1e9 / (args.rows * factor) as f64,
            median.peak_bytes as f64 / 1e6,
        );
        fs::remove_file(&path)?;
    }
    Ok(())
}

/// A file with the rows of `seed` `factor` times over, under one header.
fn repeat(seed: &Path, dir: &Path, factor: usize) -> Result<PathBuf> {
    let text = fs::read(seed)?;
    let header = memchr::memchr(b'\n', &text).context("no header")? + 1;
    let path = dir.join(format!("x{factor}.csv"));
    let mut file = BufWriter::new(File::create(&path)?);
    file.write_all(&text[..header])?;
    for _ in 0..factor {
        file.write_all(&text[header..])?;
    }
    file.flush()?;
    Ok(path)
}
