//! References to columns by name or position, and names without case and punctuation.

use std::fmt;

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ColumnRef {
    Name(String),
    /// The position in the row; the first column is 1.
    Position(usize),
}

impl fmt::Display for ColumnRef {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ColumnRef::Name(name) => f.write_str(name),
            ColumnRef::Position(position) => write!(f, "column {position}"),
        }
    }
}

/// Parses a reference to a column: a number is a position, anything else is a name.
///
/// # Errors
/// A message if the text is blank or zero.
pub fn parse_column(text: &str) -> Result<ColumnRef, String> {
    match (text.trim(), text.trim().parse()) {
        ("", _) => Err("expected the name or position of a column".to_owned()),
        (_, Ok(0)) => Err("the first column is 1".to_owned()),
        (_, Ok(position)) => Ok(ColumnRef::Position(position)),
        (name, Err(_)) => Ok(ColumnRef::Name(name.to_owned())),
    }
}

/// Returns the letters and digits of a name, in lower case.
pub(super) fn plain(name: &str) -> String {
    name.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}
