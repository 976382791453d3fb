//! Reasons why two recordings cannot be aligned.

use shell_data::hint::Hint;

/// The minimum time covered by both recordings, s.
pub(crate) const LEAST_OVERLAP_S: f64 = 5.0;

/// The minimum share of the readings' changes that the reference must explain.
pub(crate) const LEAST_EXPLAINED: f64 = 0.25;

/// The highest score of another peak, relative to the best, that is not a rival.
pub(crate) const HIGHEST_RATIO: f64 = 0.7;

/// Largest plausible skew, ppm: ten times that of crystals, and enough for most resonators.
pub(crate) const LARGEST_SKEW_PPM: f64 = 1000.0;

/// Ratio of the durations of two recordings if the times of one are in ms but read as s, or the like.
pub(crate) const OTHER_UNIT: std::ops::Range<f64> = 500.0..2000.0;

pub(crate) const MOST_EDGES: usize = 4096;

#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RecordingSide {
    #[error("reference")]
    Reference,
    #[error("board log")]
    Board,
}

#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum AlignError {
    /// Columns of unequal length, or none; `expected` is the number of times.
    #[error("{side}: columns of {found} rows beside {expected} times")]
    Shape { side: RecordingSide, expected: usize, found: usize },
    /// Rows that are not later than all rows before them.
    #[error("{side}: time does not go forward in {rows} of {of} rows")]
    TimeGoesBack { side: RecordingSide, rows: usize, of: usize },
    #[error(
        "{side}: {rows} usable rows over {span_s:.3} s, where {LEAST_OVERLAP_S} s and 100 rows are needed"
    )]
    TooShort { side: RecordingSide, rows: usize, span_s: f64 },
    #[error("{0}: no column changes")]
    Constant(RecordingSide),
    /// No offset agrees. The field is the share of the readings' changes that the best offset explains.
    #[error(
        "no common load found: at the best offset the reference explains {:.0} % of the readings, needed are \
         {:.0} %",
        100.0 * .0, 100.0 * LEAST_EXPLAINED
    )]
    NoMatch(f64),
    /// Two offsets (reference minus board), and the score `ratio` of the second to the best.
    #[error(
        "ambiguous match: offset {second_s:.3} s is {:.0} % as good as the best, {best_s:.3} s (at most \
         {:.0} % allowed)",
        100.0 * ratio, 100.0 * HIGHEST_RATIO
    )]
    Ambiguous { best_s: f64, second_s: f64, ratio: f64 },
    /// Shares of the readings explained in the rows of the fit, and in other rows.
    #[error(
        "no reliable match: the best offset explains {:.0} % of the readings, but {:.0} % of held-out ones",
        100.0 * explained, 100.0 * explained_elsewhere.max(0.0)
    )]
    ByChance { explained: f64, explained_elsewhere: f64 },
    /// Durations, s, that differ by about the ratio of two units.
    #[error(
        "the reference runs for {reference_s:.0} s, the log for {board_s:.0} s: one has times in another unit"
    )]
    OtherUnit { reference_s: f64, board_s: f64 },
    #[error("the recordings overlap for {0:.3} s, where {LEAST_OVERLAP_S} s are needed")]
    ShortOverlap(f64),
    /// Last step of the offset, s. The steps left the neighbourhood of the match, or did not become small.
    #[error("the refinement of the match does not settle (last step {0:.6} s)")]
    NotConverged(f64),
    #[error(
        "{side}: {edges} edges, where a sync signal has {MOST_EDGES} at most; is it the right column?"
    )]
    TooManyEdges { side: RecordingSide, edges: usize },
    #[error(
        "edges cannot be paired: {ways} ways match {matched} pairs, and the loads do not decide between them"
    )]
    EdgesUnclear { ways: usize, matched: usize },
    #[error(
        "the clocks differ by {0:.0} ppm, more than the {LARGEST_SKEW_PPM:.0} ppm of any crystal"
    )]
    Skew(f64),
}

impl Hint for AlignError {
    fn hint(&self) -> Option<String> {
        let text = match self {
            Self::NoMatch(_) | Self::ByChance { .. } => {
                "are both of one session? While both record, tap the shell in several places at the start \
                 and the end"
            }
            Self::Ambiguous { .. } => {
                "are both of one session? Tap the shell at uneven intervals, in different places"
            }
            Self::OtherUnit { reference_s, board_s } if reference_s > board_s => {
                "name the unit of the reference's times, such as `--reference-time-unit ms`"
            }
            Self::OtherUnit { .. } => "name the unit of the log's times, such as `--time-unit ms`",
            Self::TimeGoesBack { .. } | Self::Skew(_) => {
                "check the time columns and their units, `--time-unit` and `--reference-time-unit`"
            }
            Self::TooShort { .. } | Self::ShortOverlap(_) => {
                "record for longer; `shellcal info` tells the times of a log"
            }
            Self::Constant(_) => {
                "check the cable, and that `--sensors` and `--wrench` name the right columns"
            }
            Self::NotConverged(_) => "record a few sharp taps in different directions",
            _ => return None,
        };
        Some(text.to_owned())
    }
}

impl AlignError {
    /// Returns true if the recordings could be compared, but the match is unreliable.
    pub fn is_refusal(&self) -> bool {
        matches!(
            self,
            Self::NoMatch(_)
                | Self::Ambiguous { .. }
                | Self::ByChance { .. }
                | Self::OtherUnit { .. }
                | Self::ShortOverlap(_)
                | Self::NotConverged(_)
                | Self::Skew(_)
                | Self::EdgesUnclear { .. }
        )
    }
}
