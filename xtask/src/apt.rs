//! Programs from the distribution, where that is Debian or one that descends from it.

use std::process::{Command, Stdio};

use anyhow::{Result, bail};
use nix::unistd::geteuid;

use crate::measure::installed;
use crate::steps;

/// Installs packages, which the user may do by hand where this program may not.
pub(crate) fn install(packages: &[&str], what_for: &str) -> Result<()> {
    let line = format!("apt-get install --no-install-recommends {}", packages.join(" "));
    if !installed("apt-get", &["--version"]) {
        bail!("{what_for} is missing; on Debian it comes with `{line}`");
    }
    if !geteuid().is_root() {
        bail!("{what_for} is missing; install it with `sudo {line}`");
    }
    let apt = |arguments: &[&str]| {
        let mut command = Command::new("apt-get");
        command.args(["--quiet", "--yes"]).args(arguments).stdin(Stdio::null());
        command.env("DEBIAN_FRONTEND", "noninteractive").stdout(Stdio::null());
        command
    };
    steps::run("update the distribution's list of packages", &mut apt(&["update"]))?;
    let install = [&["install", "--no-install-recommends"], packages].concat();
    steps::run(&format!("{what_for}: {line}"), &mut apt(&install))
}
