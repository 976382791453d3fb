//! `cargo xtask manual`: manual pages and completions for a release, by the test that writes them.

use std::path::PathBuf;

use anyhow::{Context, Result};

use crate::steps::{self, PROFILE, cargo};

/// Names the folder to the test.
const FOLDER: &str = "SHELLCAL_MANUAL";

#[derive(Debug, clap::Args)]
pub(crate) struct ManualArgs {
    /// The folder of `man` and `completions`, made if it is not there
    directory: PathBuf,
}

pub(crate) fn write(args: &ManualArgs) -> Result<()> {
    let folder = std::path::absolute(&args.directory).context("no such folder can be")?;
    let test = ["test", "--package", "shellcal", "--bin", "shellcal"];
    let mut command = cargo(&[&test[..], &PROFILE, &["manual::the_manual_is_written"]].concat());
    steps::run("manual", command.env(FOLDER, folder))
}
