//! axe-core, the rules of accessibility that the reports are held against: fetched for the tests, and no part of
//! what is built.

use std::path::PathBuf;
use std::process::Command;

use anyhow::{Result, ensure};

use crate::measure::installed;
use crate::steps::{self, scratch};

/// Names the file to the tests.
pub(crate) const AXE: &str = "SHELLCAL_AXE";

const PACKAGE: &str = "axe-core@4.10.3";

/// The file of axe-core below `target`; it is fetched from npm's registry where it is not there.
///
/// # Errors
/// Why it cannot be had.
pub(crate) fn find() -> Result<PathBuf> {
    let folder = scratch("axe-core")?;
    let file = folder.join("node_modules/axe-core/axe.min.js");
    if !file.exists() {
        ensure!(installed("npm", &["--version"]), "`npm` is missing");
        let mut npm = Command::new("npm");
        npm.args([
            "install",
            "--silent",
            "--no-audit",
            "--no-fund",
            "--ignore-scripts",
            "--prefix",
        ]);
        steps::run("axe-core, for the tests of reports", npm.arg(&folder).arg(PACKAGE))?;
        ensure!(file.exists(), "npm has installed no `{}`", file.display());
    }
    Ok(file)
}
