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
mod failure;
mod fit;
mod request;

use std::sync::Arc;

use serde::Deserialize;
use serde_json::Value;

pub use board::BoardSession;
use convert::Convert;
use examine::Examine;
use failure::Failure;
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
