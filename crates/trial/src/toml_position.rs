//! TOML documents whose errors name a line and a column.

use serde::de::DeserializeOwned;

use super::cell_position::CellPosition;

/// What is wrong with a document, and where.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {}, column {}: {message}", position.line, position.column)]
pub struct TomlError {
    /// Where.
    pub position: CellPosition,
    /// What is wrong.
    pub message: String,
}

impl TomlError {
    /// An error at a byte of `text`.
    pub(super) fn at(text: &str, byte: usize, message: String) -> Self {
        Self { position: CellPosition::of_byte(text, byte), message }
    }

    /// An error at a `key` of a `[table]`.
    pub(super) fn at_key(text: &str, table: &str, key: &str, message: String) -> Self {
        let header = text.find(&format!("[{table}]")).unwrap_or(0);
        let byte = header + text[header..].find(key).unwrap_or(0);
        Self::at(text, byte, message)
    }
}

/// Reads a document.
pub(super) fn parse<T: DeserializeOwned>(text: &str) -> Result<T, TomlError> {
    toml::from_str(text).map_err(|error| {
        let byte = error.span().map_or(0, |span| span.start);
        // One line, as all messages are.
        let message = error.message().replace('\n', ", ");
        TomlError::at(text, byte, message)
    })
}
