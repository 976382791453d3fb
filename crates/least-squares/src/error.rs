use std::path::PathBuf;

use crate::features::Features;
use crate::model::TooLarge;
use crate::r_factor::LeastSquaresError;
use crate::rank_loss::RankLoss;
use crate::reading_ranges::ReadingRanges;
use shell_data::hint::Hint;
use shell_data::wrench::{Axes, Axis};

#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FitError {
    #[error("`{rows}` rows are too few for the `{coefficients}` coefficients of each axis")]
    TooFewRows { rows: u64, coefficients: usize },
    #[error("all `{0}` rows have the same readings")]
    IdenticalRows(u64),
    #[error(transparent)]
    TooLarge(#[from] TooLarge),
    #[error("{0}")]
    RankDeficient(RankLoss),
    #[error(transparent)]
    Solver(#[from] LeastSquaresError),
    /// The features are independent, but too nearly dependent to compute their coefficients.
    #[error("the features are so nearly dependent that their coefficients cannot be computed")]
    NearlyDependent,
    #[error("the exact solver cannot take these rows: {0}")]
    NotExact(#[from] ExactError),
    #[error("a time constant of `{0}` is not positive")]
    TimeConstant(f64),
    #[error("`{}` has no time column; the calibration's memory terms and lag need one", .0.display())]
    NoTime(PathBuf),
    #[error("memory terms and a lag need single rows, not means")]
    DynamicsOfMeans,
    #[error("the sums are for `{kept}` features, not for `{asked}`")]
    OtherFeatures {
        /// Largest model that can be fitted.
        kept: String,
        asked: String,
    },
    #[error("`{column}` is not a finite number in row `{row}` of a block")]
    NotFinite {
        column: String,
        /// The row within its block, from 0.
        row: usize,
    },
    /// Finite values whose features overflow.
    #[error("readings or wrenches are too large: products of them overflow")]
    Overflow,
    #[error("expected `{expected}` channels, found `{found}`")]
    Channels { expected: usize, found: usize },
    #[error("the ridge parameter is `{0}`, expected a finite number that is not negative")]
    Ridge(f64),
    #[error(transparent)]
    Physics(#[from] PhysicsError),
    #[error("the physics model needs all six axes of the wrench; found {0}")]
    PhysicsAxes(Axes),
    #[error("at least `2` groups are needed, found `{found}`")]
    TooFewGroups { found: usize },
    #[error("more than `{limit}` groups")]
    TooManyGroups { limit: usize },
    #[error("`{folds}` folds of `{groups}` groups, expected `2` to the number of groups")]
    Folds { folds: usize, groups: usize },
    #[error("the model cannot be fitted without any one of the groups: {0}")]
    Undetermined(Box<FitError>),
    /// A coefficient is undetermined without one of the groups, so the scatter between groups is unknown.
    #[error("without {} the model cannot be fitted", names(groups))]
    Alone { groups: Vec<String> },
    #[error("the rows determine none of the models")]
    NoModel,
    #[error(
        "nothing to hold out: no groups, plateaus of constant load or jumps of time; add logs or `--group`"
    )]
    NoGroups,
    #[error("the partial fits keep no sums of groups to hold out")]
    NoGroupSums,
    #[error("no covariance by groups: {0}")]
    NoGroupCovariance(Box<FitError>),
    /// Weighted rows, for a method that needs equal or whole-number weights.
    #[error("{0} needs rows of equal weight, or whole-number weights")]
    Weights(&'static str),
    /// A log is a copy of another: it would be counted twice, or tested against itself.
    #[error("`{}` has the same rows as `{}`", later.display(), earlier.display())]
    Copy { earlier: PathBuf, later: PathBuf },
    #[error("no training rows are left")]
    NoRows,
    #[error("it was interrupted")]
    Interrupted,
}

/// The largest number of rows: sums of 2³⁰ sixth powers of 16-bit readings stay below 2¹²⁶.
pub const MAX_ROWS: u64 = 1 << 30;

#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ExactError {
    /// A reading is neither a 16-bit integer nor such an integer divided by a power of two or ten.
    #[error("reading `{value}` of channel `s{}` is no 16-bit integer, nor one divided by a power of 2 or 10", channel + 1)]
    NotAnInteger {
        /// Channel, from 0.
        channel: usize,
        value: f64,
    },
    #[error("readings of channel `s{}` span more than 16 bits", channel + 1)]
    TooWide {
        /// Channel, from 0.
        channel: usize,
    },
    #[error("`{}` has a value that is not finite", axis.name())]
    NotFinite { axis: Axis },
    #[error("the magnitudes of `{}` span too many powers of two", axis.name())]
    TooManyPlaces { axis: Axis },
    #[error("memory terms are not integers")]
    MemoryTerms,
    #[error("more than `{MAX_ROWS}` rows")]
    TooManyRows,
}

#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PhysicsError {
    #[error("`{found}` poses are too few for the `{needed}` parameters of a sensor")]
    TooFewObservations { found: usize, needed: usize },
    #[error("`{0}` channels vary, at least `6` are needed for six axes")]
    TooFewChannels(usize),
    #[error("expected `1` to `16` channels, found `{0}`")]
    Channels(usize),
    #[error("at least `2` groups are needed to choose the priors, found `{0}`")]
    TooFewGroups(usize),
    #[error("a reading or wrench is not a finite number")]
    NotFinite,
}

fn names(labels: &[String]) -> String {
    const SHOWN: usize = 5;
    let shown: Vec<String> = labels.iter().take(SHOWN).map(|label| format!("`{label}`")).collect();
    let more = if labels.len() > SHOWN { " or any of others" } else { "" };
    format!("the group {}{more}", shown.join(" or "))
}

impl Hint for FitError {
    fn hint(&self) -> Option<String> {
        let text = match self {
            Self::TooFewRows { .. } => "record more poses, or choose a smaller `--model`",
            Self::IdenticalRows(_) => {
                "the readings never move: check the cable and the shell, and that `--sensors` names the \
                 right columns"
            }
            Self::Solver(_) => "use `--solver exact`, or choose a smaller `--model`",
            Self::RankDeficient(_) | Self::NearlyDependent => {
                "record loads that move the channels independently, choose a smaller `--model`, or use \
                 `--ridge 1e-6`"
            }
            Self::TooLarge(_) => {
                "choose a smaller `--model`, or name fewer columns with `--sensors`"
            }
            Self::Overflow => "check the units of the readings and of the wrench",
            Self::TooFewGroups { .. } => {
                "record more poses, give several logs, or name the column of groups with `--group`"
            }
            Self::TooManyGroups { .. } => {
                "name the column of groups with `--group`, or assign them to K folds with `--cv=K`"
            }
            Self::Folds { .. } => "leave the number out to hold out one group at a time",
            Self::Undetermined(_) | Self::NoModel => {
                "record more poses, choose a smaller `--model`, or use `--ridge 1e-6`"
            }
            Self::Copy { .. } => {
                "leave one of them out: errors on a copy say nothing about other data"
            }
            Self::NoGroupSums => "make the partial fits with `shellcal fit --partial --groups`",
            _ => return None,
        };
        Some(text.to_owned())
    }
}

impl FitError {
    pub fn is_about_groups(&self) -> bool {
        matches!(
            self,
            Self::TooFewGroups { .. }
                | Self::TooManyGroups { .. }
                | Self::Folds { .. }
                | Self::Undetermined(_)
                | Self::Alone { .. }
                | Self::NoModel
        )
    }

    /// Returns true if the error concerns the training rows; a message should then name their logs.
    pub fn is_about_rows(&self) -> bool {
        let is_other = matches!(
            self,
            Self::Physics(_)
                | Self::PhysicsAxes(_)
                | Self::NoGroups
                | Self::NoGroupSums
                | Self::NoGroupCovariance(_)
                | Self::Weights(_)
                | Self::TimeConstant(_)
                | Self::DynamicsOfMeans
                | Self::Copy { .. }
                | Self::NoRows
                | Self::Interrupted
        );
        !is_other && !self.is_about_groups()
    }

    pub(crate) fn from_least_squares(
        error: LeastSquaresError,
        features: &Features,
        ranges: &ReadingRanges,
    ) -> Self {
        match error {
            LeastSquaresError::TooFewRows { rows, columns } => {
                FitError::TooFewRows { rows, coefficients: columns }
            }
            LeastSquaresError::RankDeficient { .. }
                if ranges.constant_channels().len() == ranges.channels.len() =>
            {
                FitError::IdenticalRows(ranges.rows)
            }
            LeastSquaresError::RankDeficient { null_space, r_factor, .. } => {
                let (r, null_space) = (r_factor.as_ref().as_ref(), null_space.as_ref());
                FitError::RankDeficient(RankLoss::explain(features, ranges, r, null_space))
            }
            LeastSquaresError::NotFinite => FitError::Overflow,
            error => FitError::Solver(error),
        }
    }
}
