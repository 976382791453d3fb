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

/// Runs all jobs, the first ones first, `at_once` at a time, and each that `next` has after one that ended. The output
/// of one that fails is printed as it ends.
pub(crate) fn run(
    jobs: Vec<Job>,
    at_once: usize,
    next: impl Fn(&EndedJob) -> Option<Job> + Sync,
) -> Result<Vec<EndedJob>> {
    let queue = Mutex::new(VecDeque::from(jobs));
    let ended = Mutex::new(Vec::new());
    let waiting = || queue.lock().unwrap_or_else(PoisonError::into_inner);
    let first = || waiting().pop_front();
    let worker = || -> Result<()> {
        while let Some(Job { name, mut command }) = first() {
            let start = Instant::now();
            let run = command.stdin(Stdio::null()).output();
            let run = run.with_context(|| format!("cannot start {command:?}"))?;
            let output =
                String::from_utf8_lossy(&run.stdout) + String::from_utf8_lossy(&run.stderr);
            let (output, succeeded) = (output.into_owned(), run.status.success());
            let job = EndedJob { name, succeeded, output };
            if let Some(next) = next(&job) {
                waiting().push_front(next);
            }
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
    fn all_jobs_run_and_tell_how_they_ended() {
        let job = |name: &str, code: &str| {
            let mut command = Command::new("sh");
            command.args(["-c", &format!("echo out; echo err >&2; exit {code}")]);
            Job { name: name.to_owned(), command }
        };
        let next = |ended: &EndedJob| (ended.name == "b").then(|| job("after b", "0"));
        let jobs = vec![job("a", "0"), job("b", "3"), job("c", "0")];
        let mut ended = run(jobs, 2, next).unwrap();
        ended.sort_by(|a, b| a.name.cmp(&b.name));
        let succeeded: Vec<_> = ended.iter().map(|it| (&*it.name, it.succeeded)).collect();
        assert_eq!(succeeded, [("a", true), ("after b", true), ("b", false), ("c", true)]);
        assert!(ended.iter().all(|it| it.output == "out\nerr\n"));
    }
}
