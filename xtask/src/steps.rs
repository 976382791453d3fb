//! Running other programs, one step after the other, and saying what was run.

use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus};
use std::time::{Duration, Instant};

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
    run_within(title, command, Duration::MAX)
}

/// The same, for no longer than `limit`.
pub(crate) fn run_within(title: &str, command: &mut Command, limit: Duration) -> Result<()> {
    eprintln!("\n==> {title}: {}", line(command));
    let start = Instant::now();
    let status = wait(command, limit).with_context(|| format!("cannot start {command:?}"))?;
    let taken = start.elapsed().as_secs_f64();
    match status {
        Some(status) if status.success() => eprintln!("    {taken:.1} s"),
        Some(status) => bail!("{title}: {status}"),
        None => bail!("{title}: stopped after {taken:.0} s"),
    }
    Ok(())
}

/// `None` where the time is up.
fn wait(command: &mut Command, limit: Duration) -> std::io::Result<Option<ExitStatus>> {
    if limit == Duration::MAX {
        return command.status().map(Some);
    }
    let (start, mut child) = (Instant::now(), command.spawn()?);
    while start.elapsed() < limit {
        if let Some(status) = child.try_wait()? {
            return Ok(Some(status));
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    child.kill()?;
    child.wait()?;
    Ok(None)
}

/// A command as one would type it, without its folder and environment.
pub(crate) fn line(command: &Command) -> String {
    let program = Path::new(command.get_program());
    // The path of the cargo that runs this task says nothing.
    let program = if program.file_stem().is_some_and(|name| name == "cargo") {
        "cargo".into()
    } else {
        program.to_string_lossy()
    };
    let quoted = command.get_args().map(|argument| match argument.to_string_lossy() {
        text if text.contains(' ') => format!("'{text}'"),
        text => text.into_owned(),
    });
    [program.into_owned()].into_iter().chain(quoted).collect::<Vec<_>>().join(" ")
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
