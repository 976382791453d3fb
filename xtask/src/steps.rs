//! Runs other programs, one after the other or in parallel, which pays off because many wait: for a
//! board's line, an emulator, a browser.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::Instant;

use anyhow::{Context, Result, ensure};

/// Directory of the real recordings, which are not part of the repository.
pub(crate) const REAL_DATA: &str = "SHELLCAL_REAL_DATA";

/// Profile of tests and lints: optimised, with the checks of a debug build.
pub(crate) const PROFILE: [&str; 2] = ["--profile", "checked"];

/// Everything that is tested: other packages would have other features, and recompile everything.
pub(crate) const BUILD: [&str; 5] = ["build", "--workspace", "--lib", "--bins", "--tests"];

pub(crate) fn workspace() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("xtask lies in the workspace")
}

/// Returns the cargo that runs this task, in the workspace's root. The variable of the recordings
/// is always the same, because build scripts depend on it.
pub(crate) fn cargo(args: &[&str]) -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args(args).current_dir(workspace());
    match real_data() {
        Some(path) => command.env(REAL_DATA, path),
        None => command.env_remove(REAL_DATA),
    };
    command
}

/// Returns the directory of the real recordings, absolute since tests run in their package's. An
/// empty variable counts as unset.
pub(crate) fn real_data() -> Option<PathBuf> {
    let path = std::env::var_os(REAL_DATA).filter(|path| !path.is_empty())?;
    Some(std::path::absolute(&path).unwrap_or_else(|_| path.into()))
}

/// Folder where tests leave screens, in base64.
pub(crate) const SCREENS: &str = "SHELLCAL_SCREENSHOTS";

pub(crate) fn screens() -> PathBuf {
    std::env::var_os(SCREENS).map_or_else(|| target().join("screens"), PathBuf::from)
}

pub(crate) fn run(title: &str, command: &mut Command) -> Result<()> {
    eprintln!("\n==> {title}: {}", line(command));
    let start = Instant::now();
    let status = command.status().with_context(|| format!("cannot start {command:?}"))?;
    ensure!(status.success(), "{title}: {status}");
    eprintln!("    {:.1} s", start.elapsed().as_secs_f64());
    Ok(())
}

pub(crate) fn build_shellcal() -> Result<PathBuf> {
    run("build", &mut cargo(&[&BUILD[..], &PROFILE].concat()))?;
    Ok(target().join("checked").join("shellcal"))
}

pub(crate) fn output(command: &mut Command) -> Result<String> {
    let output = command.output().with_context(|| format!("cannot start {command:?}"))?;
    let errors = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "{}: {}", line(command), errors.trim_end());
    Ok(String::from_utf8(output.stdout)?)
}

/// Returns a command as a user would type it, without its folder and environment.
pub(crate) fn line(command: &Command) -> String {
    let program = Path::new(command.get_program());
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

pub(crate) fn installed(program: &str, check: &[&str]) -> bool {
    let run =
        Command::new(program).args(check).stdout(Stdio::null()).stderr(Stdio::null()).status();
    run.is_ok_and(|status| status.success())
}

pub(crate) fn target() -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR")
        .map_or_else(|| workspace().join("target"), |dir| workspace().join(dir))
}

pub(crate) fn scratch(name: &str) -> Result<PathBuf> {
    let dir = workspace().join("target").join(name);
    std::fs::create_dir_all(&dir).with_context(|| format!("cannot make `{}`", dir.display()))?;
    Ok(dir)
}

pub(crate) struct Job {
    pub(crate) name: String,
    pub(crate) command: Command,
}

#[derive(Debug)]
pub(crate) struct EndedJob {
    pub(crate) name: String,
    pub(crate) succeeded: bool,
    pub(crate) output: String,
}

/// Runs all jobs, `at_once` at a time, and those from `next`. Prints the output of failed ones.
pub(crate) fn run_side_by_side(
    jobs: Vec<Job>,
    at_once: usize,
    next: impl Fn(&EndedJob) -> Option<Job> + Sync,
) -> Result<Vec<EndedJob>> {
    let queue = Mutex::new(jobs.into_iter());
    let ended = Mutex::new(Vec::new());
    let first = || queue.lock().unwrap_or_else(PoisonError::into_inner).next();
    let worker = || -> Result<()> {
        let mut more = None;
        while let Some(Job { name, mut command }) = more.take().or_else(first) {
            let start = Instant::now();
            let run = command.stdin(Stdio::null()).output();
            let run = run.with_context(|| format!("cannot start {command:?}"))?;
            let output =
                String::from_utf8_lossy(&run.stdout) + String::from_utf8_lossy(&run.stderr);
            let (output, succeeded) = (output.into_owned(), run.status.success());
            let job = EndedJob { name, succeeded, output };
            more = next(&job);
            let mut ended = ended.lock().unwrap_or_else(PoisonError::into_inner);
            if !succeeded {
                println!("{}", job.output);
            }
            let result = if succeeded { "ok" } else { "FAILED" };
            let (count, taken) = (ended.len() + 1, start.elapsed().as_secs_f64());
            println!("{count:>3}  {result:<6} {taken:>6.1} s  {}", job.name);
            ended.push(job);
        }
        Ok(())
    };
    thread::scope(|scope| {
        let workers: Vec<_> = (0..at_once).map(|_| scope.spawn(worker)).collect();
        workers.into_iter().try_for_each(|worker| worker.join().expect("a worker does not panic"))
    })?;
    Ok(ended.into_inner().unwrap_or_else(PoisonError::into_inner))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_jobs_run_and_report_their_results() {
        let job = |name: &str, code: &str| {
            let mut command = Command::new("sh");
            command.args(["-c", &format!("echo out; echo err >&2; exit {code}")]);
            Job { name: name.to_owned(), command }
        };
        let next = |ended: &EndedJob| (ended.name == "b").then(|| job("after b", "0"));
        let jobs = vec![job("a", "0"), job("b", "3"), job("c", "0")];
        let mut ended = run_side_by_side(jobs, 2, next).unwrap();
        ended.sort_by(|a, b| a.name.cmp(&b.name));
        let succeeded: Vec<_> = ended.iter().map(|it| (&*it.name, it.succeeded)).collect();
        assert_eq!(succeeded, [("a", true), ("after b", true), ("b", false), ("c", true)]);
        assert!(ended.iter().all(|it| it.output == "out\nerr\n"));
    }
}
