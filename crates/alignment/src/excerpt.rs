//! A stretch of one channel beside its prediction.

/// A channel around its steepest change: what it read and what the aligned reference predicts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Excerpt {
    /// The channel, from 0, of those that change.
    pub channel: usize,
    /// Board time (s), reading and prediction (counts).
    pub points: Vec<[f64; 3]>,
}
