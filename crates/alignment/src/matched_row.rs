//! One row of the board, matched with the reference.

use super::optics::Straight;

/// One row of the board beside what the reference says.
pub(super) struct MatchedRow<'a> {
    /// Time from the pivot, s.
    pub(super) from_pivot_s: f64,
    pub(super) features: &'a [f64],
    /// The change of the predicted straight readings with the offset, counts/s.
    pub(super) slope: &'a [f64],
    pub(super) readings: &'a [f64],
    /// The readings made straight.
    pub(super) straight: &'a [Straight],
    /// What the row counts: 1, or less for an outlier.
    pub(super) weight: f64,
    /// Straight reading less the predicted one, counts.
    pub(super) residual: &'a [f64],
}
