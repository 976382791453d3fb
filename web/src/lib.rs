//! What the page does, over the libraries of the program: a request and files in memory go in, a document and files
//! come out.
//!
//! ```text
//! page.js ─▶ worker.js ─▶ abi ─▶ answer ─▶ examine | fit | convert ─▶ Answer ─▶ worker.js ─▶ page.js
//! port ◀─▶ board.js ◀─▶ worker.js ◀─▶ abi ◀─▶ BoardSession
//! ```
//!
//! [`answer`] and [`BoardSession`] are pure, and tested without a browser. Every request gets a fresh instance of the
//! module, so that nothing is left of the one before, not even of one that was cancelled; a connection with a board
//! has one of its own.

#[cfg(target_family = "wasm")]
mod abi;
mod board;
mod convert;
mod examine;
mod fit;
mod request;

use std::error::Error;
use std::sync::Arc;

use board_link::RecordError;
use calibration::FitError;
use log_file::LogError;
use output_file::OutputError;
use serde::Deserialize;
use serde_json::{Value, json};
use shell_data::hint::{Hint, with_causes};
use shellcal::workflow::WorkflowError;

pub use board::BoardSession;
use convert::Convert;
use examine::Examine;
use fit::FitRequest;

/// What a page gets for a request.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// What to show; `error` and perhaps `hint` where it could not be done.
    pub document: Value,
    /// Files to save, by name.
    pub files: Vec<(String, Vec<u8>)>,
}

impl From<Value> for Answer {
    fn from(document: Value) -> Self {
        Self { document, files: Vec::new() }
    }
}

/// Why something could not be done, as the terminal says it: an error with its causes, and the next step.
struct Failure {
    error: String,
    hint: Option<String>,
}

impl Failure {
    fn new(error: &dyn Error, hint: Option<String>) -> Self {
        Self { error: with_causes(error), hint }
    }

    /// The same of some files.
    fn about(self, names: &str) -> Self {
        Self { error: format!("{names}: {}", self.error), ..self }
    }
}

impl From<String> for Failure {
    fn from(error: String) -> Self {
        Self { error, hint: None }
    }
}

impl From<serde_json::Error> for Failure {
    fn from(error: serde_json::Error) -> Self {
        Self::new(&error, None)
    }
}

macro_rules! with_hint {
    ($($error:ty),*) => {$(
        impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                let hint = error.hint();
                Self::new(&error, hint)
            }
        }
    )*};
}

with_hint!(FitError, LogError, OutputError, RecordError, WorkflowError);

impl From<Failure> for Answer {
    fn from(Failure { error, hint }: Failure) -> Self {
        json!({ "error": error, "hint": hint }).into()
    }
}

/// Who is told how far the work is.
#[derive(Clone, Copy)]
pub struct Progress<'a> {
    /// How many bytes of logs have been read.
    pub bytes: &'a (dyn Fn(u64) + Sync),
    /// How many folds of the physics model are done, and of how many.
    pub folds: &'a (dyn Fn(usize, usize) + Sync),
}

/// What a page can ask for.
#[derive(Deserialize)]
#[serde(tag = "task", rename_all = "snake_case")]
enum PageRequest {
    /// What a file is, and what is wrong with it.
    Examine(Examine),
    /// From training logs to a calibration.
    Fit(FitRequest),
    /// From readings to forces.
    Convert(Convert),
}

/// Does what is asked for in JSON with `files`, which the request numbers in this order.
pub fn answer(request: &[u8], files: &[Arc<[u8]>], progress: Progress<'_>) -> Answer {
    let work = || match serde_json::from_slice(request)? {
        PageRequest::Examine(examine) => examine.run(files, progress.bytes),
        PageRequest::Fit(fit) => fit.run(files, progress),
        PageRequest::Convert(convert) => convert.run(files, progress.bytes),
    };
    work().unwrap_or_else(|failure: Failure| failure.into())
}
