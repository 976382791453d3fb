//! Exact sums by group.

use crate::exact::{ExactError, Moments};

/// Sums over all rows, apart by group.
#[derive(Clone, Debug, PartialEq)]
pub struct GroupedMoments {
    /// Label and sums of each group, in the order of their first rows.
    pub groups: Vec<(String, Moments)>,
    /// The sums of rows that were drawn at random from the same ones.
    pub random: Vec<Moments>,
    pub(super) total: Option<Moments>,
}

impl GroupedMoments {
    /// The sums over the rows of all groups; `None` for zero groups.
    pub fn total(&self) -> Option<&Moments> {
        self.total.as_ref()
    }
}

/// The sums of all `parts`.
pub(crate) fn total<'a>(
    parts: impl IntoIterator<Item = &'a Moments>,
) -> Result<Option<Moments>, ExactError> {
    let mut parts = parts.into_iter();
    let Some(first) = parts.next() else { return Ok(None) };
    let mut total = first.clone();
    for part in parts {
        total.merge(part)?;
    }
    Ok(Some(total))
}
