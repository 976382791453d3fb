//! Why a calibration cannot be fitted.

use std::path::PathBuf;

use crate::features::Features;
use crate::model::TooLarge;
use crate::r_factor::LeastSquaresError;
use crate::rank_loss::RankLoss;
use crate::reading_ranges::ReadingRanges;
use shell_data::hint::Hint;
use shell_data::wrench::{Axes, Axis};

/// Why a calibration cannot be fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FitError {
    /// Fewer rows than coefficients.
    #[error("`{rows}` rows are too few for the `{coefficients}` coefficients of each axis")]
    TooFewRows {
        /// Rows used.
        rows: u64,
        /// Coefficients of each axis.
        coefficients: usize,
    },
    /// Every row has the same readings.
    #[error("all `{0}` rows have the same readings")]
    IdenticalRows(u64),
    /// More coefficients than are fitted.
    #[error(transparent)]
    TooLarge(#[from] TooLarge),
    /// The features are not independent.
    #[error("{0}")]
    RankDeficient(RankLoss),
    /// The features are so nearly dependent that the solver cannot tell what the rows say, or does not come to rest.
    #[error(transparent)]
    Solver(#[from] LeastSquaresError),
    /// The features are independent, but so nearly not that the coefficients cannot be computed.
    #[error("the features are so nearly dependent that their coefficients cannot be computed")]
    NearlyDependent,
    /// The rows cannot be summed exactly; another solver can do with them.
    #[error("the exact solver cannot take these rows: {0}")]
    NotExact(#[from] ExactError),
    /// A time constant that is none.
    #[error("a time constant of `{0}` is not positive")]
    TimeConstant(f64),
    /// Memory terms or a lag by time, of a log that has no clock.
    #[error("`{}` has no time, which memory terms and lag of the calibration are by", .0.display())]
    NoTime(PathBuf),
    /// Memory terms or a lag were asked for of rows that are reduced to means.
    #[error("memory terms and a lag are of single rows, not of means")]
    DynamicsOfMeans,
    /// A model of other features than were kept.
    #[error("the sums are for `{kept}` features, not for `{asked}`")]
    OtherFeatures {
        /// The largest model that can be fitted.
        kept: String,
        /// The model that was asked for.
        asked: String,
    },
    /// A value is infinite or not a number.
    #[error("`{column}` is not a finite number in row `{row}` of a block")]
    NotFinite {
        /// The channel or axis.
        column: String,
        /// The row within its block, from 0.
        row: usize,
    },
    /// Finite values whose features are not.
    #[error("readings or wrenches are too large: products of them overflow")]
    Overflow,
    /// Not the number of channels of the model.
    #[error("expected `{expected}` channels, found `{found}`")]
    Channels {
        /// Channels of the model.
        expected: usize,
        /// Channels of the rows.
        found: usize,
    },
    /// A ridge parameter that is not a finite number from zero up.
    #[error("the ridge parameter is `{0}`, expected a finite number that is not negative")]
    Ridge(f64),
    /// The rows do not determine a physics model.
    #[error(transparent)]
    Physics(#[from] PhysicsError),
    /// A model of all six axes, of rows that have fewer.
    #[error(
        "the physics model takes all six axes of the wrench, as sensors answer to each; there are {0}"
    )]
    PhysicsAxes(Axes),
    /// Nothing to hold out, or nothing left.
    #[error("at least `2` groups are needed, found `{found}`")]
    TooFewGroups {
        /// Groups.
        found: usize,
    },
    /// A column that is no group label, most likely.
    #[error("more than `{limit}` groups")]
    TooManyGroups {
        /// The largest number.
        limit: usize,
    },
    /// Folds that the groups do not fill.
    #[error("`{folds}` folds of `{groups}` groups, expected `2` to the number of groups")]
    Folds {
        /// Folds asked for.
        folds: usize,
        /// Groups.
        groups: usize,
    },
    /// No fold leaves enough rows to fit the model.
    #[error("the model cannot be fitted without any one of the groups: {0}")]
    Undetermined(Box<FitError>),
    /// Some groups determine a coefficient alone, so that nothing can be learned from how groups
    /// scatter.
    #[error("without {} the model cannot be fitted", names(groups))]
    Alone {
        /// Their labels.
        groups: Vec<String>,
    },
    /// None of the models can be fitted.
    #[error("the rows determine none of the models")]
    NoModel,
    /// The rows have no groups, and none are found in them.
    #[error(
        "there is nothing to hold out: the log has no group column, no plateaus of constant load and no \
         jumps of time; give several logs, or a column that is one value in each pose (`--group`)"
    )]
    NoGroups,
    /// Sums that know nothing of groups, where something is asked of these.
    #[error("the partial fits keep no sums of groups to hold out")]
    NoGroupSums,
    /// Standard errors by group were asked for and cannot be had.
    #[error("no covariance by groups: {0}")]
    NoGroupCovariance(Box<FitError>),
    /// Rows that count more or less than one another, where each has to count as itself.
    #[error("{0} takes rows that all count the same, or weights that are whole numbers")]
    Weights(&'static str),
    /// A log is a copy of another, and would be counted twice or tested on itself.
    #[error("`{}` has the same rows as `{}`", later.display(), earlier.display())]
    Copy {
        /// The one that was given first.
        earlier: PathBuf,
        /// The other.
        later: PathBuf,
    },
    /// Nothing was left to fit.
    #[error("no training rows are left")]
    NoRows,
    /// The caller wanted no more of it.
    #[error("it was interrupted")]
    Interrupted,
}

/// Rows that fit: sums of 2³⁰ sixth powers of 16-bit readings stay below 2¹²⁶.
pub const MAX_ROWS: u64 = 1 << 30;

/// Why sums cannot be exact.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ExactError {
    /// A reading is not an integer, nor one over a power of two or ten.
    #[error("reading `{value}` of channel `s{}` is not an integer of 16 bits, nor that over a power of two or ten", channel + 1)]
    NotAnInteger {
        /// The channel, from 0.
        channel: usize,
        /// The reading.
        value: f64,
    },
    /// The readings of a channel span more than 16 bits.
    #[error("readings of channel `s{}` span more than 16 bits", channel + 1)]
    TooWide {
        /// The channel, from 0.
        channel: usize,
    },
    /// A component of the wrench is infinite or not a number.
    #[error("`{}` is not finite in some row", axis.name())]
    NotFinite {
        /// The axis.
        axis: Axis,
    },
    /// The magnitudes on an axis differ too much for fixed-point numbers.
    #[error("the magnitudes of `{}` span too many powers of two", axis.name())]
    TooManyPlaces {
        /// The axis.
        axis: Axis,
    },
    /// There are memory terms, which are no integers.
    #[error("memory terms are not integers")]
    MemoryTerms,
    /// More than [`MAX_ROWS`] rows.
    #[error("more than `{MAX_ROWS}` rows")]
    TooManyRows,
}

/// Why a physics model cannot be fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PhysicsError {
    /// Fewer observations than parameters of a sensor.
    #[error("`{found}` poses are too few for the `{needed}` parameters of a sensor")]
    TooFewObservations {
        /// Observations.
        found: usize,
        /// Parameters.
        needed: usize,
    },
    /// Fewer channels that vary than axes.
    #[error("`{0}` channels vary, at least `6` are needed for six axes")]
    TooFewChannels(usize),
    /// Too many channels, or none.
    #[error("expected `1` to `16` channels, found `{0}`")]
    Channels(usize),
    /// Nothing to hold out.
    #[error("at least `2` groups are needed to choose the priors, found `{0}`")]
    TooFewGroups(usize),
    /// An infinite value or one that is not a number.
    #[error("a reading or wrench is not a finite number")]
    NotFinite,
}

/// The first few of `labels`.
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
                "record loads that move the channels independently, drop a channel with `--sensors`, \
                 choose a smaller `--model`, or accept a damped answer with `--ridge 1e-6`"
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
                "record more poses, choose a smaller `--model`, or accept a damped answer with \
                 `--ridge 1e-6`"
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
    /// Whether it says what is wrong with the groups of the rows.
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

    /// Whether it says what is wrong with the training rows, and so which logs they are of matters.
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

    /// An error of the least-squares solver in terms of channels and features.
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
