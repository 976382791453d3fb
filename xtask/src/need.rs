//! Programs and libraries that tasks need and a machine may lack, and the commands that get them.

use std::fmt;
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};
use system_tests::chromium;

use crate::steps::{self, installed, workspace};

pub(crate) const BOARD_TARGET: &str = "thumbv7em-none-eabihf";
pub(crate) const PAGE_TARGET: &str = "wasm32-unknown-unknown";

/// Other systems that the program compiles for. Windows with the compiler's own tools: with GNU's, the standard
/// library needs those to compile.
pub(crate) const SYSTEMS: [&str; 2] = ["x86_64-pc-windows-msvc", "aarch64-unknown-linux-gnu"];

/// Something that has to be on the machine.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Need {
    /// The compiler's library for a target.
    Target(&'static str),
    /// rustfmt and clippy.
    Linters,
    /// Programs in packages of Debian and its descendants.
    Packages { what: &'static str, is_met: fn() -> bool, packages: &'static [&'static str] },
}

pub(crate) const BROWSER: Need = Need::Packages {
    what: "Chromium",
    is_met: || chromium::find().is_some(),
    packages: &["chromium"],
};

/// For the tests of completions, of the manual and of the installation script.
pub(crate) const SHELLS: Need = Need::Packages {
    what: "zsh, fish, groff and curl",
    is_met: || ["zsh", "fish", "groff", "curl"].iter().all(|name| installed(name, &["--version"])),
    packages: &["zsh", "fish", "groff-base", "curl"],
};

/// The oldest that the package is for, with what makes an environment.
pub(crate) const PYTHON: Need = Need::Packages {
    what: "Python 3.10 or later",
    is_met: || {
        let check = "import ensurepip, sys, venv; sys.exit(sys.version_info < (3, 10))";
        installed("python3", &["-c", check])
    },
    packages: &["python3", "python3-venv"],
};

pub(crate) const FUZZER: Need = Need::Packages {
    what: "a C++ compiler for libFuzzer",
    is_met: || installed("c++", &["--version"]),
    packages: &["g++"],
};

const ALL: [Need; 9] = [
    Need::Target(BOARD_TARGET),
    Need::Target(PAGE_TARGET),
    Need::Target(SYSTEMS[0]),
    Need::Target(SYSTEMS[1]),
    Need::Linters,
    PYTHON,
    BROWSER,
    SHELLS,
    FUZZER,
];

#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub(crate) struct SetupArgs {
    /// Install nothing: name what is missing and how to get it; exit code 1 if anything is
    #[arg(long)]
    no_install: bool,
}

/// `cargo xtask setup`: what tests and checks need of a machine.
pub(crate) fn set_up(args: SetupArgs) -> Result<()> {
    let is_here = |need: &Need| if args.no_install { need.is_met() } else { need.meet().is_ok() };
    let missing: Vec<Need> = ALL.into_iter().filter(|need| !is_here(need)).collect();
    missing.iter().for_each(|need| println!("{need}"));
    ensure!(missing.is_empty(), "{} of what tests and checks need is missing", missing.len());
    println!("everything that tests and checks need is here");
    Ok(())
}

impl Need {
    /// Gets what is needed, unless it is there.
    pub(crate) fn meet(&self) -> Result<()> {
        if self.is_met() {
            return Ok(());
        }
        let get = || {
            if let Self::Packages { .. } = self {
                steps::run(
                    "list of packages",
                    Command::new("apt-get").args(["--quiet", "update"]),
                )?;
            }
            steps::run("installation", &mut self.command())
        };
        get().with_context(|| self.to_string())?;
        ensure!(self.is_met(), "{self}");
        Ok(())
    }

    fn is_met(&self) -> bool {
        match self {
            Self::Target(target) => {
                let folder = ["--print", "target-libdir", "--target", target];
                let folder = steps::output(Command::new("rustc").args(folder));
                folder.is_ok_and(|folder| Path::new(folder.trim()).is_dir())
            }
            Self::Linters => {
                ["fmt", "clippy"].iter().all(|tool| installed("cargo", &[tool, "--version"]))
            }
            Self::Packages { is_met, .. } => is_met(),
        }
    }

    /// What gets it: asks nothing, and without a network gives up at once.
    fn command(&self) -> Command {
        let (program, arguments, names) = match self {
            Self::Target(target) => ("rustup", &["target", "add"][..], &[*target][..]),
            Self::Linters => ("rustup", &["component", "add"][..], &["rustfmt", "clippy"][..]),
            Self::Packages { packages, .. } => {
                ("apt-get", &["install", "--yes", "--no-install-recommends"][..], *packages)
            }
        };
        let mut command = Command::new(program);
        command.args(arguments).args(names).current_dir(workspace()).stdin(Stdio::null());
        command.env("RUSTUP_MAX_RETRIES", "0").env("DEBIAN_FRONTEND", "noninteractive");
        command
    }
}

impl fmt::Display for Need {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Target(target) => write!(f, "the standard library for {target}")?,
            Self::Linters => write!(f, "rustfmt or clippy")?,
            Self::Packages { what, .. } => write!(f, "{what}")?,
        }
        write!(f, " is missing; to get it: `{}`", steps::line(&self.command()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AIR: Need =
        Need::Packages { what: "air", is_met: || true, packages: &["no-such-package"] };

    #[test]
    fn what_is_there_is_not_fetched() {
        assert!(AIR.meet().is_ok());
    }

    #[test]
    fn what_is_missing_is_named_with_the_command() {
        assert!(Need::Target("moon").meet().is_err());
        assert_eq!(
            Need::Target("moon").to_string(),
            "the standard library for moon is missing; to get it: `rustup target add moon`"
        );
        assert_eq!(
            AIR.to_string(),
            "air is missing; to get it: `apt-get install --yes --no-install-recommends no-such-package`"
        );
    }
}
