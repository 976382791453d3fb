//! Programs that run side by side, because many of them wait: for a board's line, an emulator, a browser.

use std::collections::VecDeque;
use std::process::{Command, Stdio};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::Instant;

use anyhow::{Context, Result};

/// A program with a name for it.
pub(crate) struct Job {
    pub(crate) name: String,
    pub(crate) command: Command,
}

/// How a job ended.
#[derive(Debug)]
pub(crate) struct EndedJob {
    pub(crate) name: String,
    pub(crate) succeeded: bool,
    /// What it has printed, errors last.
    pub(crate) output: String,
}

/// Runs all jobs, the first ones first, `at_once` at a time. The output of one that fails is printed as it ends.
pub(crate) fn run(jobs: Vec<Job>, at_once: usize) -> Result<Vec<EndedJob>> {
    let total = jobs.len();
    let queue = Mutex::new(VecDeque::from(jobs));
    let ended = Mutex::new(Vec::new());
    let next = || queue.lock().unwrap_or_else(PoisonError::into_inner).pop_front();
    let worker = || -> Result<()> {
        while let Some(Job { name, mut command }) = next() {
            let start = Instant::now();
            let run = command.stdin(Stdio::null()).output();
            let run = run.with_context(|| format!("cannot start {command:?}"))?;
            let output =
                String::from_utf8_lossy(&run.stdout) + String::from_utf8_lossy(&run.stderr);
            let (output, succeeded) = (output.into_owned(), run.status.success());
            let mut ended = ended.lock().unwrap_or_else(PoisonError::into_inner);
            if !succeeded {
                println!("{output}");
            }
            let result = if succeeded { "ok" } else { "FAILED" };
            let (count, taken) = (ended.len() + 1, start.elapsed().as_secs_f64());
            println!("{count:>3} of {total}  {result:<6} {taken:>6.1} s  {name}");
            ended.push(EndedJob { name, succeeded, output });
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
    fn all_jobs_run_and_tell_how_they_ended() {
        let job = |name: &str, code: &str| {
            let mut command = Command::new("sh");
            command.args(["-c", &format!("echo out; echo err >&2; exit {code}")]);
            Job { name: name.to_owned(), command }
        };
        let mut ended = run(vec![job("a", "0"), job("b", "3"), job("c", "0")], 2).unwrap();
        ended.sort_by(|a, b| a.name.cmp(&b.name));
        assert_eq!(ended.iter().map(|it| it.succeeded).collect::<Vec<_>>(), [true, false, true]);
        assert!(ended.iter().all(|it| it.output == "out\nerr\n"));
    }
}
