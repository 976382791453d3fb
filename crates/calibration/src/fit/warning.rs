//! What a fit has to say beside its figures, worded once for terminal, report and Python.

use std::fmt;

use super::model_choice::FewGroups;
use crate::exact::ExactError;
use crate::physics::TooFewGroups;
use crate::validation::ValidationError;

/// What a user of a calibration should know of it.
#[derive(Clone, Debug, PartialEq)]
pub enum Warning {
    /// The exact solver was asked for and cannot take the rows.
    NotExact(ExactError),
    /// The exact solver was asked for, and no sum of rows with such weights is exact.
    Weighted,
    /// Standard errors by group cannot be had.
    NotGrouped(ValidationError),
    /// There are no standard errors.
    FewGroups(FewGroups),
    /// Directions that the data hardly excite.
    DirectionsLeftOut(usize),
    /// A fit of about as many coefficients as rows goes through every point, whatever they are.
    FewRows {
        /// Rows fitted.
        rows: u64,
        /// Independent coefficients of an axis.
        coefficients: usize,
    },
    /// The share of test rows at poses of the training data.
    TestLeaks(f64),
    /// The share of training rows whose pose other groups have rows of, too.
    GroupsLeak(f64),
    /// All test rows, so many, are outside the range of the training data.
    AllOutOfRange(u64),
    /// A physics model without intervals; what a polynomial lacks the verdict says.
    NoIntervalsAtAll(TooFewGroups),
    /// Moments over forces make so long a lever, m.
    MomentUnit(f64),
    /// Channels that never change, from 0.
    DeadChannels(Vec<usize>),
    /// Some test rows are outside the range of the training data.
    OutOfRange {
        /// So many.
        outside: u64,
        /// Of so many.
        rows: u64,
    },
}

impl Warning {
    /// Whether it only says how something was done.
    pub fn is_note(&self) -> bool {
        matches!(self, Self::OutOfRange { .. })
    }
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotExact(reason) => {
                write!(f, "not solved exactly but by refined QR: {reason}")
            }
            Self::Weighted => f.write_str(
                "not solved exactly but by refined QR: sample_weight has no whole numbers",
            ),
            Self::NotGrouped(reason) => write!(
                f,
                "standard errors take rows as independent, and are too small where rows of a group \
                 resemble each other: {reason}"
            ),
            Self::FewGroups(FewGroups { features, groups }) => write!(
                f,
                "no standard errors and intervals: {features} features for {groups} groups of rows; it \
                 takes twice as many groups as features, {}, for the groups to tell how far to trust \
                 the rest. Record more, or take a smaller model or `--model physics`",
                2 * features
            ),
            Self::DirectionsLeftOut(count) => {
                let s = if *count > 1 { "s" } else { "" };
                write!(
                    f,
                    "left out {count} direction{s} in which the data hardly move the readings"
                )
            }
            Self::FewRows { rows, coefficients } => write!(
                f,
                "{rows} rows for {coefficients} coefficients: the errors on the training logs say little; \
                 record more poses or choose a smaller `--model`"
            ),
            Self::TestLeaks(share) => write!(
                f,
                "the test set leaks: {:.0} % of its rows were recorded at poses of the training data, with the \
                 same loads and readings, as after a random split of rows. Its errors and R² are those of \
                 training; test on other poses",
                100.0 * share
            ),
            Self::GroupsLeak(share) => write!(
                f,
                "the groups leak: {:.0} % of the rows share their pose with rows of other groups, as where \
                 labels were assigned at random. Errors on held-out groups are those of training; give one label \
                 to each pose",
                100.0 * share
            ),
            Self::AllOutOfRange(rows) => write!(
                f,
                "none of the {rows} test rows lies within the range of the training data: their errors are of a \
                 guess beyond it. Was the sensor zeroed anew, or the columns taken in another order?"
            ),
            Self::NoIntervalsAtAll(reason) => write!(f, "{reason}: none will be given"),
            Self::MomentUnit(lever_m) => write!(
                f,
                "moments over forces make a lever of {lever_m:.1} m: the moments are in mN·m, it seems; give \
                 `--moment-unit mnm`, or name the columns so"
            ),
            Self::DeadChannels(channels) => {
                let names: Vec<String> =
                    channels.iter().map(|channel| format!("s{}", channel + 1)).collect();
                write!(f, "left out, because they never change: {}", names.join(", "))
            }
            Self::OutOfRange { outside, rows } => write!(
                f,
                "{outside} of {rows} test rows have a reading outside the range of the training data"
            ),
        }
    }
}
