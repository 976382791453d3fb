//! `cargo xtask hostile`: commands over damaged files, drawn from seeds, for as long as one has time.
//!
//! They are the test `hostile::random` of the program, which draws a few hundred among the others.

use std::time::Duration;

use anyhow::{Result, ensure};

use crate::steps::{self, cargo};

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// How long to draw [default: until there were as many as `--cases`]
    #[arg(long, value_name = "H")]
    hours: Option<f64>,

    /// How many to draw
    #[arg(long, value_name = "N", default_value_t = 100_000, conflicts_with = "hours")]
    cases: u64,

    /// The seed of the first; those after it count up
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let mut test =
        cargo(&["test", "--profile", "checked", "--package", "shellcal", "--test", "it"]);
    test.args(["hostile::random", "--", "--nocapture"]);
    test.env("SHELLCAL_HOSTILE_SEED", args.seed.to_string());
    match args.hours {
        Some(hours) => {
            ensure!(hours > 0.0, "`--hours` is a time above 0");
            let time = Duration::try_from_secs_f64(3600.0 * hours)?;
            test.env("SHELLCAL_HOSTILE_SECONDS", time.as_secs().to_string());
        }
        None => drop(test.env("SHELLCAL_HOSTILE_CASES", args.cases.to_string())),
    }
    steps::run("hostile", &mut test)
}
