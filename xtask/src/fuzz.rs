//! `cargo xtask fuzz`: builds the fuzz targets of every package and runs each for some time.
//!
//! A package's targets are a workspace of their own in its folder `fuzz`, as `cargo fuzz` has them. They
//! are built here with the flags that `cargo fuzz` passes, on the stable compiler: no code of ours is
//! `unsafe`, so a sanitizer would find nothing. Inputs that a run finds are kept in `target/fuzz` and
//! begin the next one, beside the seeds in the repository.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};
use cargo_metadata::{MetadataCommand, TargetKind};

use crate::measure::installed;
use crate::need::{Need, Way};
use crate::steps::{self, cargo, workspace};

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// How long each target runs
    #[arg(long, value_name = "S", default_value_t = 60)]
    seconds: u64,

    /// Only targets whose names contain this
    target: Option<String>,
}

/// What the compiler of libFuzzer is.
pub(crate) const NEED: Need = Need {
    what: "a C++ compiler for libFuzzer",
    is_met: || installed("c++", &["--version"]),
    ways: &[Way::Packages(&["g++"])],
};

/// How much is tried of a target.
#[derive(Clone, Copy, Debug)]
enum Effort {
    /// Other inputs in every run, for so many seconds.
    Seconds(u64),
    /// So many inputs, the same in every run.
    Inputs(u64),
}

/// What a target does among the tests: that it builds, that its seeds pass, and what is found in some
/// thousand inputs more. They are the same in every run: a change fails by what it does, not by chance.
const AMONG_TESTS: Effort = Effort::Inputs(4000);

/// Counters of branches taken and of values compared (LLVM, "SanitizerCoverage"), and the checks of a
/// debug build. Unlike `cargo fuzz`, without `-Clink-dead-code`, with which `pulp` does not compile.
const FLAGS: [&str; 8] = [
    "-Cpasses=sancov-module",
    "-Cllvm-args=-sanitizer-coverage-level=4",
    "-Cllvm-args=-sanitizer-coverage-inline-8bit-counters",
    "-Cllvm-args=-sanitizer-coverage-pc-table",
    "-Cllvm-args=-sanitizer-coverage-trace-compares",
    "-Cdebug-assertions",
    "-Coverflow-checks",
    "--cfg=fuzzing",
];

/// An input that takes longer, in s, or more memory, in MiB, is a failure.
const LIMITS: [&str; 2] = ["-timeout=10", "-rss_limit_mb=2048"];

pub(crate) fn run(args: &Args) -> Result<()> {
    run_each(Effort::Seconds(args.seconds), args.target.as_deref().unwrap_or_default())
}

/// The short run among the tests.
pub(crate) fn check() -> Result<()> {
    run_each(AMONG_TESTS, "")
}

fn run_each(effort: Effort, name: &str) -> Result<()> {
    NEED.meet()?;
    let mut failed = Vec::new();
    for folder in folders()? {
        let targets: Vec<String> =
            targets(&folder)?.into_iter().filter(|target| target.contains(name)).collect();
        if targets.is_empty() {
            continue;
        }
        let programs = build(&folder)?;
        for target in targets {
            eprintln!("\n==> fuzz {target}");
            let output = fuzzer(&programs, &folder, &target, effort)?.output();
            let output = output.with_context(|| format!("cannot start `{target}`"))?;
            let said = String::from_utf8_lossy(&output.stderr);
            if output.status.success() {
                eprintln!("    {} inputs", inputs(&said).context("libFuzzer counts no inputs")?);
            } else {
                eprintln!("{said}");
                failed.push(target);
            }
        }
    }
    if !failed.is_empty() {
        bail!(
            "failed: {}; the inputs are in `{}`",
            failed.join(", "),
            kept("failures", "").display()
        );
    }
    Ok(())
}

/// The fuzz folders of the packages.
fn folders() -> Result<Vec<PathBuf>> {
    let metadata = MetadataCommand::new().current_dir(workspace()).no_deps().exec()?;
    let manifests = metadata.packages.iter().map(|package| &package.manifest_path);
    let folders = manifests.map(|manifest| manifest.with_file_name("fuzz").into_std_path_buf());
    Ok(folders.filter(|folder| folder.join("Cargo.toml").is_file()).collect())
}

fn targets(folder: &Path) -> Result<Vec<String>> {
    // The versions are those of the workspace.
    std::fs::copy(workspace().join("Cargo.lock"), folder.join("Cargo.lock"))
        .context("cannot copy Cargo.lock")?;
    let metadata = MetadataCommand::new().current_dir(folder).no_deps().exec()?;
    let targets = metadata.packages.into_iter().flat_map(|package| package.targets);
    let programs = targets.filter(|target| target.kind.contains(&TargetKind::Bin));
    Ok(programs.map(|target| target.name).collect())
}

/// Builds all targets of a folder and returns where they are.
fn build(folder: &Path) -> Result<PathBuf> {
    let host = host()?;
    let package = folder.parent().and_then(Path::file_name).unwrap_or_default();
    // With a target named, the flags are not for what runs while compiling.
    let mut build = cargo(&["build", "--release", "--bins", "--target", &host]);
    build.arg("--target-dir").arg(kept("", "")).current_dir(folder);
    build.env("RUSTFLAGS", FLAGS.join(" "));
    steps::run(&format!("fuzz targets of {}", package.display()), &mut build)?;
    Ok(kept("", "").join(host).join("release"))
}

fn fuzzer(programs: &Path, folder: &Path, target: &str, effort: Effort) -> Result<Command> {
    let (found, failures) = (kept("inputs", target), kept("failures", target));
    for folder in [&found, &failures] {
        std::fs::create_dir_all(folder).with_context(|| format!("no `{}`", folder.display()))?;
    }
    let mut fuzzer = Command::new(programs.join(target));
    fuzzer.arg(&found).args(Some(folder.join("seeds").join(target)).filter(|it| it.is_dir()));
    match effort {
        Effort::Seconds(seconds) => fuzzer.arg(format!("-max_total_time={seconds}")),
        Effort::Inputs(inputs) => fuzzer.args([format!("-runs={inputs}"), "-seed=1".to_owned()]),
    };
    fuzzer.args(LIMITS);
    fuzzer.args(["-max_len=8192", "-verbosity=0", "-print_final_stats=1"]);
    fuzzer.arg(format!("-artifact_prefix={}/", failures.display()));
    Ok(fuzzer)
}

/// How many inputs libFuzzer says that it has run.
fn inputs(said: &str) -> Option<u64> {
    let count = said.lines().find_map(|line| line.strip_prefix("stat::number_of_executed_units:"));
    count?.trim().parse().ok()
}

/// A folder in `target/fuzz`.
fn kept(what: &str, target: &str) -> PathBuf {
    workspace().join("target/fuzz").join(what).join(target)
}

fn host() -> Result<String> {
    let output = Command::new("rustc").arg("-vV").output().context("cannot start rustc")?;
    let text = String::from_utf8(output.stdout)?;
    let host = text.lines().find_map(|line| line.strip_prefix("host: "));
    Ok(host.context("rustc names no host")?.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inputs_are_read_off_the_statistics() {
        let said = "Done 7 runs\nstat::number_of_executed_units: 12902\nstat::peak_rss_mb:   29\n";
        assert_eq!(inputs(said), Some(12902));
        assert_eq!(inputs("nothing"), None);
    }
}
