//! `cargo xtask setup`: what tests and checks need of a machine; and what is needed beside compilers and Python: a browser,
//! shells, rules of accessibility.

use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result, ensure};
use system_tests::chromium;

use crate::need::{Need, Way};
use crate::steps::{self, installed, scratch};
use crate::{check, compiler, python, web};

#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub(crate) struct SetupArgs {
    /// Install nothing: name what is missing and how to get it; exit code 1 if anything is
    #[arg(long)]
    no_install: bool,
}

pub(crate) fn run(args: SetupArgs) -> Result<()> {
    let tests = [compiler::BOARD_NEED, python::NEED, BROWSER, SHELLS, web::NEED];
    let needs = [&tests[..], &check::NEEDS].concat();
    let is_missing = |need: &Need| match args.no_install {
        true => !(need.is_met)(),
        false => need.meet().is_err(),
    };
    let missing: Vec<Need> = needs.into_iter().filter(is_missing).collect();
    missing.iter().for_each(|need| println!("{need}"));
    ensure!(missing.is_empty(), "{} of what tests and checks need is missing", missing.len());
    println!("everything that tests and checks need is here");
    Ok(())
}

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
