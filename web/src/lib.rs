//! The functions of the page, based on the libraries of the program: a request and files in memory
//! go in, a document and files come out.
//!
//! ```text
//! page.js ─▶ worker.js ─▶ abi ─▶ answer ─▶ examine | fit | convert ─▶ Answer ─▶ worker.js ─▶ page.js
//! port ◀─▶ board.js ◀─▶ worker.js ◀─▶ abi ◀─▶ BoardSession
//! ```
//!
//! [`answer`] and [`BoardSession`] are pure, and tested without a browser. Every request gets a fresh instance of the
//! module, so that no state remains from a previous or cancelled one. A connection with a board has its own instance.

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

#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// The document to show; contains `error` and possibly `hint` after a failure.
    pub document: Value,
    pub files: Vec<(String, Vec<u8>)>,
}

impl From<Value> for Answer {
    fn from(document: Value) -> Self {
        Self { document, files: Vec::new() }
    }
}

/// An error as the terminal shows it: with its causes, and a hint on the next step.
struct Failure {
    error: String,
    hint: Option<String>,
}

impl Failure {
    fn new(error: &dyn Error, hint: Option<String>) -> Self {
        Self { error: with_causes(error), hint }
    }

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

#[derive(Clone, Copy)]
pub struct Progress<'a> {
    /// Receives the number of bytes of logs read so far.
    pub bytes: &'a (dyn Fn(u64) + Sync),
    /// Receives the number of completed folds of the physics model, and the total.
    pub folds: &'a (dyn Fn(usize, usize) + Sync),
}

#[derive(Deserialize)]
#[serde(tag = "task", rename_all = "snake_case")]
enum PageRequest {
    /// Detect a file's kind and its faults.
    Examine(Examine),
    Fit(FitRequest),
    /// Convert readings to forces.
    Convert(Convert),
}

/// Executes a request in JSON with `files`, which it refers to by position.
pub fn answer(request: &[u8], files: &[Arc<[u8]>], progress: Progress<'_>) -> Answer {
    let work = || match serde_json::from_slice(request)? {
        PageRequest::Examine(examine) => examine.run(files, progress.bytes),
        PageRequest::Fit(fit) => fit.run(files, progress),
        PageRequest::Convert(convert) => convert.run(files, progress.bytes),
    };
    work().unwrap_or_else(|failure: Failure| failure.into())
}
