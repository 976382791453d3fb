//! `cargo xtask test`: everything that must hold before a change lands.

use std::path::PathBuf;

use anyhow::{Context, Result};
use system_tests::emulation::IMAGE;

use crate::steps::{cargo, run as step};
use crate::{axe, book, cross, firmware, fuzz, layers, licences, model, python, setup};

/// Names the directory of the real recordings, which are not part of the repository.
const REAL_DATA: &str = "SHELLCAL_REAL_DATA";

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Only what takes no longer than two minutes where all is built: formatting, lints, layers,
    /// licences, unit and command tests
    #[arg(long, conflicts_with_all = ["tests_only", "without_board", "without_browser"])]
    quick: bool,

    /// Only the tests: no formatting, lints, layers, licences, other systems, fuzz targets or
    /// documentation
    #[arg(long)]
    tests_only: bool,

    /// Leave out the firmware on its target: no compiler for the board and no emulator is needed
    #[arg(long)]
    without_board: bool,

    /// Do not install Chromium where there is none: tests in a browser are then skipped
    #[arg(long)]
    without_browser: bool,

    /// Leave out the Python package: no packages are fetched for its tests
    #[arg(long, conflicts_with = "quick")]
    without_python: bool,
}

/// The profile of the tests: optimised, with the checks of a debug build.
const PROFILE: [&str; 2] = ["--profile", "checked"];

pub(crate) fn run(args: &Args) -> Result<()> {
    if args.quick { quick() } else { whole(args) }
}

/// What to run while working.
fn quick() -> Result<()> {
    style()?;
    let units = ["test", "--workspace", "--lib", "--bins"];
    step("unit tests", &mut cargo(&[&units[..], &PROFILE].concat()))?;
    let commands = ["test", "--package", "shellcal", "--test", "it"];
    let names = ["--", "_command::", "_cli::"];
    step("tests of the commands", &mut cargo(&[&commands[..], &PROFILE, &names].concat()))
}

/// What to run before a change lands.
fn whole(args: &Args) -> Result<()> {
    let real_data = real_data()?;
    if real_data.is_none() {
        eprintln!("{REAL_DATA} is not set: tests on real recordings will be skipped");
    }
    if !args.tests_only {
        style()?;
        cross::check()?;
        fuzz::check()?;
    }
    let image = if args.without_board {
        eprintln!("the emulated board's tests will be skipped");
        None
    } else {
        Some(firmware::check()?)
    };
    set_up_browser(args.without_browser);
    if let Err(error) = setup::SHELLS.meet() {
        eprintln!("{error:#}: tests of completions or of the manual will be skipped");
    }
    let mut tests = cargo(&[&["test", "--workspace"][..], &PROFILE].concat());
    tests.envs(real_data.map(|path| (REAL_DATA, path))).envs(image.map(|path| (IMAGE, path)));
    tests.envs(model::environment(!args.without_board));
    if std::env::var_os(book::SCREENS).is_none() {
        // For the book.
        std::fs::create_dir_all(book::screens())?;
        tests.env(book::SCREENS, book::screens());
    }
    if !args.without_browser {
        match axe::find() {
            Ok(file) => {
                tests.env(axe::AXE, file);
            }
            Err(reason) => eprintln!("{reason:#}: reports are not held against axe-core"),
        }
    }
    step("tests", &mut tests)?;
    if args.without_python {
        eprintln!("the tests of the Python package are left out");
    } else {
        python::test(&PROFILE)?;
    }
    if !args.tests_only {
        let doc = ["doc", "--workspace", "--no-deps", "--document-private-items"];
        let mut doc = cargo(&[&doc[..], &PROFILE].concat());
        step("documentation", doc.env("RUSTDOCFLAGS", "-D warnings"))?;
        book::check()?;
    }
    Ok(())
}

/// What can be said of the code without running it.
fn style() -> Result<()> {
    setup::TOOLS.iter().try_for_each(|tool| tool.meet())?;
    step("formatting", &mut cargo(&["fmt", "--all", "--check"]))?;
    let clippy = ["clippy", "--workspace", "--all-targets"];
    let deny = ["--", "-D", "warnings"];
    step("lints", &mut cargo(&[&clippy[..], &PROFILE, &deny].concat()))?;
    // What is not in the program unless it is asked for.
    let optional = ["clippy", "--package", "shellcal", "--bins", "--features", "foxglove"];
    step("lints of features", &mut cargo(&[&optional[..], &PROFILE, &deny].concat()))?;
    eprintln!("\n==> layers");
    layers::run(&layers::Args::default())?;
    licences::check()
}

/// Gets a Chromium where there is none; without one the report's tests say that they were skipped.
fn set_up_browser(without: bool) {
    let found = setup::BROWSER.is_met;
    if without && !found() {
        eprintln!("{}: tests in a browser will be skipped", setup::BROWSER);
    } else if let Err(error) = setup::BROWSER.meet() {
        eprintln!("{error:#}: tests in a browser will be skipped");
    }
}

/// The directory of the real recordings as an absolute path, because every package's tests run in
/// a directory of their own.
fn real_data() -> Result<Option<PathBuf>> {
    let Some(path) = std::env::var_os(REAL_DATA) else { return Ok(None) };
    let path = PathBuf::from(path);
    let absolute =
        path.canonicalize().with_context(|| format!("{REAL_DATA} names `{}`", path.display()))?;
    Ok(Some(absolute))
}
