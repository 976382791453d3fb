//! Programs from the distribution, where that is Debian or one that descends from it.

use std::process::{Command, Stdio};
use std::sync::OnceLock;

use anyhow::{Result, bail};
use nix::unistd::geteuid;

use crate::measure::installed;
use crate::steps;

/// Whether this machine has the distribution's installer.
pub(crate) fn is_open() -> bool {
    installed("apt-get", &["--version"])
}

/// The command that installs packages, for who has to do it by hand.
pub(crate) fn line(packages: &[&str]) -> String {
    format!("apt-get install --no-install-recommends {}", packages.join(" "))
}

/// Installs packages, which the user may do by hand where this program may not.
pub(crate) fn install(packages: &[&str], what: &str) -> Result<()> {
    static UPDATED: OnceLock<()> = OnceLock::new();
    if !geteuid().is_root() {
        bail!("not root: run `sudo {}`", line(packages));
    }
    if UPDATED.set(()).is_ok() {
        steps::run("the distribution's list of packages", &mut apt_get(&["update"]))?;
    }
    let install = [&["install", "--no-install-recommends"], packages].concat();
    steps::run(what, &mut apt_get(&install))
}

/// Waits for another installer to finish, asks nothing, and tells what goes wrong.
fn apt_get(arguments: &[&str]) -> Command {
    let mut command = Command::new("apt-get");
    command.args(["--quiet", "--yes", "--option", "DPkg::Lock::Timeout=600"]).args(arguments);
    command.env("DEBIAN_FRONTEND", "noninteractive").stdin(Stdio::null()).stdout(Stdio::null());
    command
}
