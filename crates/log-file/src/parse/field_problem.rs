//! The error in one field of a row.

/// An error in a field. Its text says what was expected.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FieldProblem {
    #[error("a number")]
    Empty,
    #[error("a number")]
    NotANumber,
    /// The field is not a date, but others in the column are.
    #[error("a date and time such as 2026-03-01T12:00:00.25")]
    NotADate,
    /// The field is NaN, infinite, or too large for a double.
    #[error("a finite number")]
    NotFinite,
    /// The value exceeds the range of any converter or sensor: it is damaged, or a different quantity.
    #[error("{0}")]
    BeyondLimit(&'static str),
}
