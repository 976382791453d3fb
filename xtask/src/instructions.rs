//! Instructions that a fit executes, with and without what it can be asked for.
//!
//! Counted by Valgrind: the same number on every run. The profile of a plain fit also names every
//! function that was entered; none of those of validation, covariance and figures may be among them.

use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, ensure};

use crate::measure::installed;
use crate::steps::{cargo, run as run_step, scratch, workspace};

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Rows of the log
    #[arg(long, default_value_t = 20_000)]
    rows: usize,
}

/// What is asked for, and the arguments that ask for it.
const ASKED: [(&str, &[&str]); 7] = [
    ("nothing", &[]),
    ("calibration file", &["--output", "/dev/null", "--covariance", "none"]),
    ("covariance by rows", &["--output", "/dev/null", "--covariance", "rows"]),
    ("covariance by groups", &["--output", "/dev/null", "--covariance", "groups"]),
    ("figure", &["--plot", "fit.svg"]),
    ("cross-validation", &["--cv"]),
    ("choice of the model", &["--model", "auto"]),
];

/// Parts of the program that a plain fit must not enter.
const UNASKED: [&str; 6] = [
    "calibration::validation::grouped",
    "calibration::validation::cross_validation",
    "calibration::validation::selection",
    "calibration::uncertainty",
    "calibration::magnitudes",
    "figures",
];

pub(crate) fn run(args: &Args) -> Result<()> {
    ensure!(installed("valgrind", &["--version"]), "this needs Valgrind");
    // Not the released program: there, functions are put into one another across files.
    let build = ["build", "--profile", "checked", "--package", "shellcal"];
    run_step("build shellcal", &mut cargo(&build))?;
    let program = workspace().join("target/checked/shellcal");
    let folder = &scratch("instructions")?;
    let rows = args.rows.to_string();
    let made = Command::new(&program)
        .args(["synth", "train", "--quiet", "--rows", &rows, "--output", "train.csv"])
        .current_dir(folder)
        .status()
        .context("cannot start shellcal")?;
    ensure!(made.success(), "no log was made");
    println!("| asked for | instructions | times a plain fit |\n| --- | ---: | ---: |");
    let mut plain = None;
    for (what, arguments) in ASKED {
        let profile = count(&program, folder, arguments)?;
        let entered: Vec<&str> =
            UNASKED.into_iter().filter(|part| profile.has_entered(part)).collect();
        let base = *plain.get_or_insert(profile.instructions);
        let ratio = profile.instructions as f64 / base as f64;
        println!("| {what} | {:.1} M | {ratio:.3} |", profile.instructions as f64 / 1e6);
        let is_plain = matches!(what, "nothing" | "calibration file");
        ensure!(!is_plain || entered.is_empty(), "{what}: entered {}", entered.join(", "));
    }
    println!("\nA plain fit enters none of {}.", UNASKED.join(", "));
    Ok(())
}

struct Profile {
    instructions: u64,
    /// The profile as it was written, with the names of all functions entered.
    text: String,
}

impl Profile {
    /// Whether a function of `part` was entered; dropping an empty option of it does not count.
    fn has_entered(&self, part: &str) -> bool {
        [format!(") {part}"), format!(") <{part}")].iter().any(|name| self.text.contains(name))
    }
}

fn count(program: &Path, folder: &Path, arguments: &[&str]) -> Result<Profile> {
    let output = Command::new("valgrind")
        .args(["--tool=callgrind", "--callgrind-out-file=profile", "--quiet"])
        .arg(program)
        .args(["fit", "train.csv", "--quiet", "--threads", "1"])
        .args(arguments)
        .current_dir(folder)
        .output()
        .context("cannot start valgrind")?;
    ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr).trim_end());
    let text = std::fs::read_to_string(folder.join("profile"))?;
    let total = text.lines().find_map(|line| line.strip_prefix("totals: "));
    let instructions = total.context("no total in the profile")?.trim().parse()?;
    Ok(Profile { instructions, text })
}
