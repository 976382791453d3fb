//! Where a value stands in a text.

use std::fmt;

use serde::Serialize;

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
