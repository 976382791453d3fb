//! Programs and compilers that a task needs and a machine may lack, and the commands that get them.

use std::fmt;
use std::process::{Command, Stdio};
use std::time::Duration;

use anyhow::{Result, bail};

use crate::apt;
use crate::measure::installed;
use crate::steps;

/// How long rustup may try: without a network it takes its time to give up.
const RUSTUP_TIME: Duration = Duration::from_secs(180);

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
    /// The standard library of another target.
    RustupTarget(&'static str),
    /// A tool of the compiler.
    RustupComponent(&'static str),
    /// Packages of Debian and its descendants.
    Packages(&'static [&'static str]),
}

impl Need {
    /// Gets what is needed, unless it is there; an error if no way leads to it.
    pub(crate) fn meet(&self) -> Result<()> {
        if (self.is_met)() {
            return Ok(());
        }
        for way in self.ways.iter().filter(|way| way.is_open()) {
            if let Err(error) = way.take(self.what) {
                eprintln!("    {error:#}");
            }
            if (self.is_met)() {
                return Ok(());
            }
        }
        bail!("{self}")
    }
}

impl fmt::Display for Need {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ways: Vec<_> = self.ways.iter().map(ToString::to_string).collect();
        write!(f, "{} is missing; to get it: {}", self.what, ways.join(" or "))
    }
}

impl Way {
    /// Whether this machine has the program for it.
    fn is_open(self) -> bool {
        match self {
            Self::RustupTarget(_) | Self::RustupComponent(_) => installed("rustup", &["--version"]),
            Self::Packages(_) => apt::is_open(),
        }
    }

    fn take(self, what: &str) -> Result<()> {
        match self {
            Self::RustupTarget(_) | Self::RustupComponent(_) => {
                let mut rustup = Command::new("rustup");
                rustup.args(self.rustup_arguments()).current_dir(steps::workspace());
                steps::run_within(what, rustup.stdin(Stdio::null()), RUSTUP_TIME)
            }
            Self::Packages(packages) => apt::install(packages, what),
        }
    }

    fn rustup_arguments(self) -> Vec<&'static str> {
        match self {
            Self::RustupTarget(target) => vec!["target", "add", target],
            Self::RustupComponent(component) => vec!["component", "add", component],
            Self::Packages(_) => Vec::new(),
        }
    }
}

impl fmt::Display for Way {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Packages(packages) => write!(f, "on Debian `{}`", apt::line(packages)),
            _ => write!(f, "`rustup {}`", self.rustup_arguments().join(" ")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_there_is_not_fetched() {
        let way = &[Way::RustupTarget("no-such-target")];
        let need = Need { what: "air", is_met: || true, ways: way };
        assert!(need.meet().is_ok());
    }

    #[test]
    fn what_no_way_leads_to_is_named_with_the_commands() {
        let need = Need { what: "air", is_met: || false, ways: &[] };
        assert!(need.meet().is_err());
        let ways = &[Way::RustupTarget("moon"), Way::Packages(&["air", "water"])];
        assert_eq!(
            Need { ways, ..need }.to_string(),
            "air is missing; to get it: `rustup target add moon` or on Debian `apt-get install \
             --no-install-recommends air water`"
        );
    }
}
