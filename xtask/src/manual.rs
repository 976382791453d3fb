//! `cargo xtask manual`: manual pages and completions for a release, written by a test.

use std::path::PathBuf;

use anyhow::{Context, Result};

use crate::steps::{self, PROFILE, cargo};

const FOLDER: &str = "SHELLCAL_MANUAL";

#[derive(Debug, clap::Args)]
pub(crate) struct ManualArgs {
    /// Folder for `man` and `completions`, created if missing
    directory: PathBuf,
}

pub(crate) fn write(args: &ManualArgs) -> Result<()> {
    let folder = std::path::absolute(&args.directory).context("no such folder can be")?;
    let test = ["test", "--package", "shellcal", "--bin", "shellcal"];
    let mut command = cargo(&[&test[..], &PROFILE, &["manual::the_manual_is_written"]].concat());
    steps::run("manual", command.env(FOLDER, folder))
}
