//! Running other programs, one step after the other, and saying what was run.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, Result, bail};

/// The root of the workspace.
pub(crate) fn workspace() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("xtask lies in the workspace")
}

/// The cargo that runs this task, to be run in the root of the workspace.
pub(crate) fn cargo(args: &[&str]) -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args(args).current_dir(workspace());
    command
}

/// Runs `command` with its output on the terminal; an error unless it succeeds.
pub(crate) fn run(title: &str, command: &mut Command) -> Result<()> {
    eprintln!("\n==> {title}");
    let start = Instant::now();
    let status = command.status().with_context(|| format!("cannot start {command:?}"))?;
    if !status.success() {
        bail!("{title}: {status}");
    }
    eprintln!("    {:.1} s", start.elapsed().as_secs_f64());
    Ok(())
}

/// Builds the released `shellcal` and returns where it is.
pub(crate) fn build_shellcal() -> Result<PathBuf> {
    run("build shellcal", &mut cargo(&["build", "--release", "--package", "shellcal"]))?;
    Ok(target().join("release").join("shellcal"))
}

/// Where cargo puts what it builds.
pub(crate) fn target() -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR")
        .map_or_else(|| workspace().join("target"), |dir| workspace().join(dir))
}

/// A directory below `target` for what a benchmark makes.
pub(crate) fn scratch(name: &str) -> Result<PathBuf> {
    let dir = workspace().join("target").join(name);
    std::fs::create_dir_all(&dir).with_context(|| format!("cannot make `{}`", dir.display()))?;
    Ok(dir)
}
