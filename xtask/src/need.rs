//! Programs and compilers that a task needs, and the commands that install them.

use std::fmt;
use std::process::{Command, Stdio};
use std::sync::Once;

use anyhow::{Context, Result, ensure};
use system_tests::chromium;

use crate::compiler::{BOARD_TARGET, Compiler, PAGE_TARGET, SYSTEMS};
use crate::steps::{self, installed, workspace};

#[derive(Clone, Copy, Debug)]
pub(crate) enum Need {
    Target(&'static str),
    Linters,
    Packages { what: &'static str, is_met: fn() -> bool, packages: &'static [&'static str] },
}

pub(crate) const BROWSER: Need = Need::Packages {
    what: "Chromium",
    is_met: || chromium::find().is_some(),
    packages: &["chromium"],
};

/// Packages for the tests of completions, manual and installation script.
pub(crate) const SHELLS: Need = Need::Packages {
    what: "zsh, fish, groff and curl",
    is_met: || ["zsh", "fish", "groff", "curl"].iter().all(|name| installed(name, &["--version"])),
    packages: &["zsh", "fish", "groff-base", "curl"],
};

/// The oldest Python that the package supports, with the tool for environments.
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
    /// Install nothing: list the missing requirements and how to get them; exit code 1 if any is missing
    #[arg(long)]
    no_install: bool,
}

pub(crate) fn set_up(args: SetupArgs) -> Result<()> {
    let is_here = |need: &Need| if args.no_install { need.is_met() } else { need.meet().is_ok() };
    let missing: Vec<Need> = ALL.into_iter().filter(|need| !is_here(need)).collect();
    missing.iter().for_each(|need| println!("{need}"));
    ensure!(missing.is_empty(), "{} of what tests and checks need is missing", missing.len());
    println!("everything that tests and checks need is here");
    Ok(())
}

pub(crate) fn compiler(target: &'static str) -> Result<Compiler> {
    Need::Target(target).meet()?;
    Compiler::find(target).context("the compiler is gone")
}

impl Need {
    /// Installs the requirement if missing; an error if no command can.
    pub(crate) fn meet(&self) -> Result<()> {
        // rustup's target is tried even if there is the distribution's compiler: it builds faster,
        // and has the version of the rest.
        let is_slow = |target| Compiler::find(target).is_some_and(|it| it.std_parts.is_some());
        if self.is_met() && !matches!(self, Self::Target(target) if is_slow(target)) {
            return Ok(());
        }
        for command in self.commands() {
            if installed(command[0], &["--version"])
                && let Err(error) = get(&command)
            {
                eprintln!("    {error:#}");
            }
            if self.is_met() {
                return Ok(());
            }
        }
        Err(anyhow::Error::msg(self.to_string()))
    }

    fn is_met(&self) -> bool {
        match self {
            Self::Target(target) => Compiler::find(target).is_some(),
            Self::Linters => {
                ["fmt", "clippy"].iter().all(|tool| installed("cargo", &[tool, "--version"]))
            }
            Self::Packages { is_met, .. } => is_met(),
        }
    }

    fn commands(&self) -> Vec<Vec<&'static str>> {
        let install = |packages: &[&'static str]| {
            [&["apt-get", "install", "--no-install-recommends"], packages].concat()
        };
        // Debian's packages named `web` follow the browsers, which need a recent compiler.
        let distribution = ["cargo-web", "rustc-web", "rust-web-src", "binutils-arm-none-eabi"];
        match *self {
            Self::Target(PAGE_TARGET) => vec![vec!["rustup", "target", "add", PAGE_TARGET]],
            Self::Target(target) => {
                vec![vec!["rustup", "target", "add", target], install(&distribution)]
            }
            Self::Linters => vec![vec!["rustup", "component", "add", "rustfmt", "clippy"]],
            Self::Packages { packages, .. } => vec![install(packages)],
        }
    }
}

impl fmt::Display for Need {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Target(target) => write!(f, "a compiler for {target}")?,
            Self::Linters => write!(f, "rustfmt or clippy")?,
            Self::Packages { what, .. } => write!(f, "{what}")?,
        }
        let commands: Vec<_> =
            self.commands().iter().map(|command| format!("`{}`", command.join(" "))).collect();
        write!(f, " is missing; to get it: {}", commands.join(" or "))
    }
}

/// Runs rustup or apt-get; updates the package list before the first apt-get.
fn get(command: &[&str]) -> Result<()> {
    static UPDATED: Once = Once::new();
    let by_apt = command[0] == "apt-get";
    if by_apt && !UPDATED.is_completed() {
        UPDATED.call_once(|| ());
        get(&["apt-get", "update"])?;
    }
    let mut get = Command::new(command[0]);
    get.args(&command[1..]).current_dir(workspace()).stdin(Stdio::null()).stdout(Stdio::null());
    if by_apt {
        // Waits for another installer to finish, and does not prompt.
        get.args(["--quiet", "--yes", "--option", "DPkg::Lock::Timeout=600"]);
        get.env("DEBIAN_FRONTEND", "noninteractive");
    }
    // Without a network rustup gives up at once.
    steps::run("installation", get.env("RUSTUP_MAX_RETRIES", "0"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const AIR: Need =
        Need::Packages { what: "air", is_met: || true, packages: &["no-such-package"] };

    #[test]
    fn present_requirements_are_not_installed() {
        assert!(AIR.meet().is_ok());
    }

    #[test]
    fn missing_requirements_are_named_with_their_commands() {
        let need = Need::Packages { what: "air", is_met: || false, packages: &["no-such-package"] };
        assert_eq!(
            need.to_string(),
            "air is missing; to get it: `apt-get install --no-install-recommends no-such-package`"
        );
        assert_eq!(
            Need::Target("moon").to_string(),
            "a compiler for moon is missing; to get it: `rustup target add moon` or `apt-get install \
             --no-install-recommends cargo-web rustc-web rust-web-src binutils-arm-none-eabi`"
        );
    }
}
