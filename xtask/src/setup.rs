//! `cargo xtask setup`: all that the whole test run needs of a machine.

use anyhow::{Result, bail};
use system_tests::chromium;

use crate::measure::installed;
use crate::need::{Need, Way};
use crate::{cross, emulator, fuzz, toolchain};

#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub(crate) struct Args {
    /// Install nothing: name what is missing and how to get it; exit code 1 if anything is
    #[arg(long)]
    no_install: bool,
}

const FORMATTER: Need = Need {
    what: "rustfmt",
    is_met: || installed("cargo", &["fmt", "--version"]),
    ways: &[Way::RustupComponent("rustfmt")],
};

const LINTER: Need = Need {
    what: "clippy",
    is_met: || installed("cargo", &["clippy", "--version"]),
    ways: &[Way::RustupComponent("clippy")],
};

/// For the tests of the report.
pub(crate) const BROWSER: Need = Need {
    what: "Chromium",
    is_met: || chromium::find().is_some(),
    ways: &[Way::Packages(&["chromium"])],
};

/// For the tests of completions and of the manual.
pub(crate) const SHELLS: Need = Need {
    what: "zsh, fish and groff",
    is_met: || ["zsh", "fish", "groff"].iter().all(|program| installed(program, &["--version"])),
    ways: &[Way::Packages(&["zsh", "fish", "groff-base"])],
};

/// What every run needs.
pub(crate) const TOOLS: [Need; 2] = [FORMATTER, LINTER];

pub(crate) fn run(args: Args) -> Result<()> {
    let others = [toolchain::NEED, emulator::NEED, BROWSER, SHELLS, fuzz::NEED];
    let needs = [&TOOLS[..], &others, &cross::NEEDS].concat();
    let missing: Vec<Need> = needs
        .into_iter()
        .filter(|need| if args.no_install { !(need.is_met)() } else { need.meet().is_err() })
        .collect();
    missing.iter().for_each(|need| println!("{need}"));
    match missing.len() {
        0 => println!("everything that the test run needs is here"),
        1 => bail!("1 thing is missing"),
        count => bail!("{count} things are missing"),
    }
    Ok(())
}
