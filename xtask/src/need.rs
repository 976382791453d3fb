//! Programs and compilers that a task needs and a machine may lack, and the commands that get them.

use std::fmt;
use std::process::{Command, Stdio};
use std::sync::OnceLock;

use anyhow::{Result, bail};
use nix::unistd::geteuid;

use crate::steps::{self, installed, workspace};

/// Something that has to be on the machine.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Need {
    pub(crate) what: &'static str,
    pub(crate) is_met: fn() -> bool,
    /// Ways to get it, the best first.
    pub(crate) ways: &'static [Way],
}

/// A command that may give what is needed.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Way {
    /// Arguments of rustup: the standard library of another target, or a tool of the compiler.
    Rustup(&'static [&'static str]),
    /// Packages of Debian and its descendants.
    Packages(&'static [&'static str]),
}

impl Need {
    /// Gets what is needed, unless it is there; an error if no way leads to it.
    pub(crate) fn meet(&self) -> Result<()> {
        for way in self.ways.iter().filter(|way| way.is_open()) {
            // rustup's target is tried even where the distribution's compiler is there: it is quicker to build
            // with, and of the same version as the rest.
            let is_better =
                matches!(way, Way::Rustup(["target", "add", target]) if !has_target(target));
            if (self.is_met)() && !is_better {
                break;
            }
            match way.take(self.what) {
                Ok(()) => eprintln!("    got {} by {way}", self.what),
                Err(error) => eprintln!("    {error:#}"),
            }
        }
        if (self.is_met)() { Ok(()) } else { bail!("{self}") }
    }
}

impl fmt::Display for Need {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ways: Vec<_> = self.ways.iter().map(ToString::to_string).collect();
        write!(f, "{} is missing; to get it: {}", self.what, ways.join(" or "))
    }
}

/// Whether the compiler in use has the standard library of a target.
fn has_target(target: &str) -> bool {
    let folder =
        steps::output(Command::new("rustc").args(["--print", "target-libdir", "--target", target]));
    folder.is_ok_and(|folder| std::path::Path::new(folder.trim()).is_dir())
}

impl Way {
    /// Whether this machine has the program for it.
    fn is_open(self) -> bool {
        let program = if matches!(self, Self::Rustup(_)) { "rustup" } else { "apt-get" };
        installed(program, &["--version"])
    }

    fn take(self, what: &str) -> Result<()> {
        let packages = match self {
            Self::Packages(packages) => packages,
            Self::Rustup(arguments) => {
                let mut rustup = Command::new("rustup");
                rustup.args(arguments).current_dir(workspace()).stdin(Stdio::null());
                // Without a network it gives up at once.
                return steps::run(what, rustup.env("RUSTUP_MAX_RETRIES", "0"));
            }
        };
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
}

impl fmt::Display for Way {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Packages(packages) => write!(f, "`{}` on Debian", line(packages)),
            Self::Rustup(arguments) => write!(f, "`rustup {}`", arguments.join(" ")),
        }
    }
}

/// The command that installs packages, for who has to do it by hand.
fn line(packages: &[&str]) -> String {
    format!("apt-get install --no-install-recommends {}", packages.join(" "))
}

/// Waits for another installer to finish, asks nothing, and tells what goes wrong.
fn apt_get(arguments: &[&str]) -> Command {
    let mut command = Command::new("apt-get");
    command.args(["--quiet", "--yes", "--option", "DPkg::Lock::Timeout=600"]).args(arguments);
    command.env("DEBIAN_FRONTEND", "noninteractive").stdin(Stdio::null()).stdout(Stdio::null());
    command
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_there_is_not_fetched() {
        let ways = &[
            Way::Rustup(&["component", "add", "no-such-component"]),
            Way::Packages(&["no-such-package"]),
        ];
        assert!(Need { what: "air", is_met: || true, ways }.meet().is_ok());
    }

    #[test]
    fn what_no_way_leads_to_is_named_with_the_commands() {
        let need = Need { what: "air", is_met: || false, ways: &[] };
        assert!(need.meet().is_err());
        let ways = &[Way::Rustup(&["target", "add", "moon"]), Way::Packages(&["air", "water"])];
        assert_eq!(
            Need { ways, ..need }.to_string(),
            "air is missing; to get it: `rustup target add moon` or `apt-get install \
             --no-install-recommends air water` on Debian"
        );
    }
}
