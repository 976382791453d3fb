//! The logs of a live view, as files with numbers in their names; and when a view ends.

use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use board_link::{AppendWriter, LogSink};
use output_file::OutputError;
use shellcal::workflow::live::{LiveSession, LogMaker};

/// What tells a view to end: whoever runs it, its time, and its source.
pub(super) struct Until<'a> {
    pub(super) is_stopped: &'a dyn Fn() -> bool,
    pub(super) is_over: &'a dyn Fn() -> bool,
    pub(super) started: Instant,
    pub(super) duration: Option<Duration>,
}

impl Until<'_> {
    /// Takes the frames that have come; whether to go on.
    pub(super) fn advance(&self, session: &mut LiveSession) -> anyhow::Result<bool> {
        let elapsed = self.started.elapsed();
        let is_gone = session.advance(elapsed, (self.is_over)())?;
        let is_out_of_time = self.duration.is_some_and(|end| elapsed >= end);
        Ok(!((self.is_stopped)() || is_out_of_time || is_gone))
    }
}

/// Makes `log.csv`, then the first of `log-2.csv`, `log-3.csv`, … that is not there.
#[derive(Debug)]
pub(super) struct LogFiles {
    /// The first of them, if it has a name.
    pub(super) path: Option<PathBuf>,
    pub(super) overwrite: bool,
}

impl LogMaker for LogFiles {
    fn next(&mut self, made: usize) -> Result<Box<dyn LogSink>, OutputError> {
        let base = self.path.clone().unwrap_or_else(|| PathBuf::from("live.csv"));
        let mut number = made + 1;
        loop {
            let path = numbered(&base, number);
            // A name that was given is meant; one that was made must not be in the way.
            let is_given = number == 1 && self.path.is_some();
            match AppendWriter::create(&path, self.overwrite && is_given) {
                Err(OutputError::Failed { source, .. })
                    if !is_given && source.kind() == io::ErrorKind::AlreadyExists =>
                {
                    number += 1;
                }
                writer => return Ok(Box::new(writer?)),
            }
        }
    }
}

fn numbered(base: &Path, number: usize) -> PathBuf {
    if number == 1 {
        return base.to_path_buf();
    }
    let stem = base.file_stem().unwrap_or_default().to_string_lossy();
    let ending = base.extension().map(|ending| format!(".{}", ending.to_string_lossy()));
    base.with_file_name(format!("{stem}-{number}{}", ending.unwrap_or_default()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logs_are_numbered_and_none_is_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("run.csv");
        std::fs::write(dir.path().join("run-2.csv"), "mine").unwrap();
        let mut logs = LogFiles { path: Some(path.clone()), overwrite: false };
        let writers = [logs.next(0).unwrap(), logs.next(1).unwrap()];
        let names = writers.each_ref().map(|log| log.path().file_name().unwrap().to_owned());
        assert_eq!(names, ["run.csv", "run-3.csv"]);
        assert_eq!(std::fs::read(dir.path().join("run-2.csv")).unwrap(), b"mine");
        drop(writers);
        let mut again = LogFiles { path: Some(path), overwrite: false };
        assert!(again.next(0).is_err(), "a name that was given is taken");
    }
}
