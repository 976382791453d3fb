//! Rows in which time has nothing to say.

use std::fmt;

use crate::fit::has_poses;
use shell_data::dataset::Dataset;
use shell_data::statistics::RunningVariance;

/// Neighbouring loads of a recording in time resemble each other far more than this (correlation).
const SHUFFLED_BELOW: f64 = 0.3;

/// Rows whose order is looked at.
const MOST_ROWS: usize = 20_000;

/// Why neither lag nor memory was searched for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NotSearched {
    /// Nothing moves within a pose.
    Poses,
    /// Neighbouring rows have nothing to do with each other; this is their largest correlation.
    Shuffled(f64),
    /// There are too few rows to hold some out.
    FewRows,
    /// Rows count more or less than one another.
    Weights,
}

impl fmt::Display for NotSearched {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Poses => f.write_str("the loads are constant in each pose"),
            Self::Shuffled(correlation) => write!(
                f,
                "the rows are not in the order of time: neighbouring loads are not alike \
                 (correlation {correlation:.2})"
            ),
            Self::FewRows => f.write_str("there are too few rows to hold some out"),
            Self::Weights => f.write_str("rows with weights are not in the order of time"),
        }
    }
}

/// Why nothing should be searched for in these rows, if there is a reason.
pub(super) fn reason(data: &Dataset) -> Option<NotSearched> {
    if data.has_weights() {
        return Some(NotSearched::Weights);
    }
    // Before poses, which loads in any order might seem to be.
    let correlation = neighbour_correlation(data);
    if correlation < SHUFFLED_BELOW {
        return Some(NotSearched::Shuffled(correlation));
    }
    has_poses(data).then_some(NotSearched::Poses)
}

/// The correlation of the loads of neighbouring rows, on the axis where it is largest.
fn neighbour_correlation(data: &Dataset) -> f64 {
    let correlation = |axis: usize| {
        let columns = || data.blocks().map(|(_, block)| &block.rows.wrench[axis][..]);
        let mut rest = MOST_ROWS;
        let columns: Vec<&[f64]> = columns()
            .map(|column| {
                let some = &column[..column.len().min(rest)];
                rest -= some.len();
                some
            })
            .collect();
        let mut all = RunningVariance::default();
        columns.iter().for_each(|column| all.merge(&RunningVariance::of(column)));
        let of_pair = |pair: &[f64]| (pair[0] - all.mean) * (pair[1] - all.mean);
        let products: f64 = columns.iter().flat_map(|column| column.windows(2)).map(of_pair).sum();
        if all.squares > 0.0 { products / all.squares } else { 0.0 }
    };
    (0..6).map(correlation).fold(0.0, f64::max)
}
