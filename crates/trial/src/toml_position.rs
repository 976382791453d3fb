//! TOML documents whose errors name a line and a column.

use serde::de::DeserializeOwned;

use super::cell_position::ManifestProblem;

/// Reads a document.
pub(super) fn parse<T: DeserializeOwned>(text: &str) -> Result<T, ManifestProblem> {
    toml::from_str(text).map_err(|error| {
        let byte = error.span().map_or(0, |span| span.start);
        // One line, as all messages are.
        ManifestProblem::at(text, byte, error.message().replace('\n', ", "))
    })
}
