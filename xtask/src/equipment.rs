//! What is needed beside compilers and Python: a browser, shells, rules of accessibility.

use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result, ensure};
use system_tests::chromium;

use crate::need::{Need, Way};
use crate::steps::{self, installed, scratch};

pub(crate) const BROWSER: Need = Need {
    what: "Chromium",
    is_met: || chromium::find().is_some(),
    ways: &[Way::Packages(&["chromium"])],
};

/// For the tests of completions, of the manual and of the installation script.
pub(crate) const SHELLS: Need = Need {
    what: "zsh, fish, groff and curl",
    is_met: || ["zsh", "fish", "groff", "curl"].iter().all(|name| installed(name, &["--version"])),
    ways: &[Way::Packages(&["zsh", "fish", "groff-base", "curl"])],
};

/// The rules of accessibility that pages are held against: fetched from npm's registry into `target`.
pub(crate) fn axe() -> Result<PathBuf> {
    let folder = scratch("axe-core")?;
    let file = folder.join("node_modules/axe-core/axe.min.js");
    if !file.exists() {
        ensure!(installed("npm", &["--version"]), "`npm` is missing");
        let mut npm = Command::new("npm");
        npm.args(["install", "--silent", "--no-audit", "--no-fund", "--ignore-scripts"]);
        steps::run("axe-core", npm.arg("--prefix").arg(&folder).arg("axe-core@4.10.3"))?;
        ensure!(file.exists(), "npm has installed no `{}`", file.display());
    }
    file.canonicalize().context("axe-core is gone")
}
