//! Partial fits as files: the exact sums over some rows, to be merged with those over others.
//!
//! One JSON document. Merging is exact, so in whatever order and grouping partial fits are merged,
//! the result is the one fit over all their rows, bit for bit.
//!
//! | field | content |
//! |---|---|
//! | `partial_schema_version` | [`PARTIAL_SCHEMA_VERSION`] |
//! | `made_by`, `date` | program and version, UTC |
//! | `model` | features and intercept |
//! | `skipped_rows`, `repeated_rows` | wrong rows left out, rows that repeat their readings |
//! | `sources` | files, their checksums and rows |
//! | `moments` | rows, the range of each channel, and the sums, as decimal integers |
//! | `checksum` | XXH3 of 128 bits of all bytes before it; absent in files of earlier programs |

use std::path::Path;

use serde::{Deserialize, Serialize};
use twox_hash::XxHash3_128;

use super::layout::to_json;
use super::moments::MomentsDocument;
use super::problem::problem;
use super::stored::{Stored, StoredModel, StoredSource};
use super::{CalibrationFileError, Problem, Source};
use crate::input;
use calibration::exact::{ExactError, Moments};
use calibration::model::Model;

/// The version of the document that this program writes and reads.
pub const PARTIAL_SCHEMA_VERSION: u64 = 1;

/// The exact sums over some rows, with their origin.
#[derive(Clone, Debug, PartialEq)]
pub struct PartialFit {
    /// Program and version.
    pub made_by: String,
    /// When, in UTC, RFC 3339.
    pub date: String,
    /// What is to be fitted.
    pub model: Model,
    /// Wrong rows that were left out.
    pub skipped_rows: u64,
    /// Rows whose readings repeat those of the row before.
    pub repeated_rows: u64,
    /// The files it was made from.
    pub sources: Vec<Source>,
    /// The sums.
    pub moments: Moments,
}

/// The document.
#[derive(Serialize, Deserialize)]
struct Document {
    partial_schema_version: u64,
    made_by: String,
    date: String,
    model: StoredModel,
    skipped_rows: u64,
    repeated_rows: u64,
    sources: Vec<StoredSource>,
    moments: MomentsDocument,
}

#[derive(Deserialize)]
struct Version {
    partial_schema_version: u64,
}

/// Why two partial fits cannot be merged.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MergeError {
    /// They are parts of different fits.
    #[error("it is for `{found}`, expected `{expected}`")]
    Model {
        /// The model of the first.
        expected: String,
        /// The model of the other.
        found: String,
    },
    /// They are for different sensors.
    #[error("it has `{found}` channels, expected `{expected}`")]
    Channels {
        /// Channels of the first.
        expected: usize,
        /// Channels of the other.
        found: usize,
    },
    /// A file would be counted twice.
    #[error("its rows of `{0}` have been counted already")]
    Twice(String),
    /// The sums of both together cannot be exact.
    #[error(transparent)]
    NotExact(#[from] ExactError),
}

impl PartialFit {
    /// A partial fit of `model` with these sums, of unknown origin.
    pub fn new(model: Model, moments: Moments) -> Self {
        Self {
            made_by: String::new(),
            date: String::new(),
            model,
            skipped_rows: 0,
            repeated_rows: 0,
            sources: Vec::new(),
            moments,
        }
    }

    /// Reads the JSON document at `path`.
    ///
    /// # Errors
    /// [`CalibrationFileError`] if it cannot be read or is no partial fit of this version.
    pub fn read(path: &Path) -> Result<Self, CalibrationFileError> {
        let problem = |problem| CalibrationFileError { path: path.to_path_buf(), problem };
        let text = input::read(path, input::Document::Json)
            .map_err(|error| problem(Problem::Io(error)))?;
        Self::parse(&text).map_err(problem)
    }

    fn parse(text: &[u8]) -> Result<Self, Problem> {
        let version: Version = serde_json::from_slice(text).map_err(problem)?;
        let found = version.partial_schema_version;
        if found != PARTIAL_SCHEMA_VERSION {
            return Err(Problem::SchemaVersion { found });
        }
        let document: Document = serde_json::from_slice(text).map_err(problem)?;
        let model = document.model.value();
        let moments = document.moments.value().map_err(Problem::Inconsistent)?;
        if model.channels != moments.channels() || model.basis != moments.basis() {
            return Err(Problem::Inconsistent("`moments` are not those of `model`".to_owned()));
        }
        // Last: what can be named says more.
        check(text).map_err(Problem::Inconsistent)?;
        Ok(Self {
            made_by: document.made_by,
            date: document.date,
            model,
            skipped_rows: document.skipped_rows,
            repeated_rows: document.repeated_rows,
            sources: document.sources.value(),
            moments,
        })
    }

    /// The JSON document.
    pub fn to_json(&self) -> String {
        with_checksum(to_json(&Document {
            partial_schema_version: PARTIAL_SCHEMA_VERSION,
            made_by: self.made_by.clone(),
            date: self.date.clone(),
            model: Stored::of(&self.model),
            skipped_rows: self.skipped_rows,
            repeated_rows: self.repeated_rows,
            sources: Stored::of(&self.sources),
            moments: MomentsDocument::of(&self.moments),
        }))
    }

    /// Adds the rows of `other`.
    ///
    /// # Errors
    /// [`MergeError`] if both are not parts of one fit; `self` is then as it was.
    pub fn merge(&mut self, other: &PartialFit) -> Result<(), MergeError> {
        if self.model.channels != other.model.channels {
            let (expected, found) = (self.model.channels, other.model.channels);
            return Err(MergeError::Channels { expected, found });
        }
        if self.model != other.model {
            let (expected, found) = (self.model.name(), other.model.name());
            return Err(MergeError::Model { expected, found });
        }
        let same = |a: &Source, b: &Source| a.checksum.is_some() && a.checksum == b.checksum;
        let twice = other.sources.iter().find(|b| self.sources.iter().any(|a| same(a, b)));
        if let Some(source) = twice {
            return Err(MergeError::Twice(source.path.display().to_string()));
        }
        self.moments.merge(&other.moments)?;
        self.skipped_rows += other.skipped_rows;
        self.repeated_rows += other.repeated_rows;
        self.sources.extend(other.sources.iter().cloned());
        Ok(())
    }
}

/// How every document ends.
const END: &str = "\n}\n";

/// What stands before the checksum, which is of all that stands before this.
const CHECKSUM: &str = ",\n  \"checksum\": \"xxh128:";

/// The document with a checksum as its last field.
fn with_checksum(document: String) -> String {
    let content = document.strip_suffix(END).unwrap_or(&document);
    format!("{content}{CHECKSUM}{:032x}\"{END}", XxHash3_128::oneshot(content.as_bytes()))
}

/// Whether the document is what its checksum is of, where it has one.
fn check(document: &[u8]) -> Result<(), String> {
    let Some(at) = memchr::memmem::rfind(document, CHECKSUM.as_bytes()) else { return Ok(()) };
    let (content, end) = document.split_at(at);
    let expected = format!("{CHECKSUM}{:032x}\"{END}", XxHash3_128::oneshot(content));
    match expected.as_bytes() == end {
        true => Ok(()),
        false => Err("it is not what was written: the checksum does not match".to_owned()),
    }
}
