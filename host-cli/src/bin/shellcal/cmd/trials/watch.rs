//! Does a job again whenever one of its files changes.

use std::path::{Path, PathBuf};
use std::time::Duration;

use shellcal::workflow::batch::{FileStamp, stamp};

use crate::printer::{Outcome, Printer};

/// How often files are looked at. A look costs a system call a file.
const EVERY: Duration = Duration::from_millis(300);

/// Does `job` now and whenever one of `files` changes, comes or goes; until the program is ended.
pub(super) fn run(
    printer: &Printer,
    files: impl Fn() -> Vec<PathBuf>,
    mut job: impl FnMut(),
) -> anyhow::Result<Outcome> {
    let stamps = |files: &[PathBuf]| -> Vec<FileStamp> {
        files.iter().map(PathBuf::as_path).map(stamp).collect()
    };
    loop {
        // Looked at before the job: what changes meanwhile has changed.
        let files = files();
        let seen = stamps(&files);
        job();
        printer.note(format!("watching {} files; Ctrl-C ends", files.len()));
        while stamps(&files) == seen {
            std::thread::sleep(EVERY);
        }
        let changed = files.iter().zip(&seen).filter(|(file, seen)| stamp(file) != **seen);
        let changed: Vec<&Path> = changed.map(|(file, _)| file.as_path()).collect();
        if let Some(first) = changed.first() {
            let more = match changed.len() {
                1 => String::new(),
                files => format!(" and {} more", files - 1),
            };
            printer.note(format!("`{}`{more} changed", first.display()));
        }
    }
}
