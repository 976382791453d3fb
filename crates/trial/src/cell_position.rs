//! Where a value stands in a text, and what is wrong there.

use std::fmt;

use serde::Serialize;
use serde::de::DeserializeOwned;

/// A line and a column of a manifest or a profile, from 1; columns in characters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct CellPosition {
    /// The line.
    pub line: usize,
    /// The column.
    pub column: usize,
}

impl CellPosition {
    pub(crate) const START: Self = Self { line: 1, column: 1 };

    /// That of a byte of a text.
    pub(crate) fn of_byte(text: &str, byte: usize) -> Self {
        let before = text.get(..byte).unwrap_or(text);
        let line_start = before.rfind('\n').map_or(0, |at| at + 1);
        let column = 1 + before[line_start..].chars().count();
        Self { line: 1 + before.matches('\n').count(), column }
    }
}

impl fmt::Display for CellPosition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.line, self.column)
    }
}

/// What is wrong at some position of a manifest, a profile or a table.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{position}: {message}")]
pub struct ManifestProblem {
    /// Where.
    pub position: CellPosition,
    /// What.
    pub message: String,
}

impl ManifestProblem {
    pub(crate) fn new(position: CellPosition, message: String) -> Self {
        Self { position, message }
    }

    /// At a byte of `text`.
    pub(crate) fn at(text: &str, byte: usize, message: String) -> Self {
        Self { position: CellPosition::of_byte(text, byte), message }
    }

    /// At a `key` of a `[table]`.
    pub(crate) fn at_key(text: &str, table: &str, key: &str, message: String) -> Self {
        let header = text.find(&format!("[{table}]")).unwrap_or(0);
        let byte = header + text[header..].find(key).unwrap_or(0);
        Self::at(text, byte, message)
    }
}

/// Reads a TOML document.
pub(crate) fn parse_toml<T: DeserializeOwned>(text: &str) -> Result<T, ManifestProblem> {
    toml::from_str(text).map_err(|error| {
        let byte = error.span().map_or(0, |span| span.start);
        // One line, as all messages are.
        ManifestProblem::at(text, byte, error.message().replace('\n', ", "))
    })
}
