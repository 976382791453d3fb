//! What a fit has to say beside its figures, worded once for terminal, report and Python.

use least_squares::error::FitError;
use least_squares::exact::ExactError;
use least_squares::uncertainty::TooFewGroups;

/// What a user of a calibration should know of it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Warning {
    /// The exact solver was asked for and cannot take the rows.
    #[error("not solved exactly but by refined QR: {0}")]
    NotExact(ExactError),
    /// The exact solver was asked for, and no sum of rows with such weights is exact.
    #[error("not solved exactly but by refined QR: sample_weight has no whole numbers")]
    Weighted,
    /// Standard errors by group cannot be had.
    #[error(
        "standard errors take rows as independent, and are too small where rows of a group resemble each other: {0}"
    )]
    NotGrouped(FitError),
    /// There are no standard errors.
    #[error(
        "no standard errors and intervals: {features} features for {groups} groups of rows; it takes twice as many \
         groups as features, {least}, for the groups to tell how far to trust the rest. Record more, or take a smaller \
         model or `--model physics`",
        features = .0.features,
        groups = .0.groups,
        least = 2 * .0.features
    )]
    FewGroups(FewGroups),
    /// Directions that the data hardly excite.
    #[error(
        "left out {0} direction{s} in which the data hardly move the readings",
        s = if *.0 > 1 { "s" } else { "" }
    )]
    DirectionsLeftOut(usize),
    /// A fit of about as many coefficients as rows goes through every point, whatever they are.
    #[error(
        "{rows} rows for {coefficients} coefficients: the errors on the training logs say little; record more poses or \
         choose a smaller `--model`"
    )]
    FewRows {
        /// Rows fitted.
        rows: u64,
        /// Independent coefficients of an axis.
        coefficients: usize,
    },
    /// The share of test rows at poses of the training data.
    #[error(
        "the test set leaks: {:.0} % of its rows were recorded at poses of the training data, with the same loads and \
         readings, as after a random split of rows. Its errors and R² are those of training; test on other poses",
        100.0 * .0
    )]
    TestLeaks(f64),
    /// The share of training rows whose pose other groups have rows of, too.
    #[error(
        "the groups leak: {:.0} % of the rows share their pose with rows of other groups, as where labels were \
         assigned at random. Errors on held-out groups are those of training; give one label to each pose",
        100.0 * .0
    )]
    GroupsLeak(f64),
    /// All test rows, so many, are outside the range of the training data.
    #[error(
        "none of the {0} test rows lies within the range of the training data: their errors are of a guess beyond it. \
         Was the sensor zeroed anew, or the columns taken in another order?"
    )]
    AllOutOfRange(u64),
    /// A physics model without intervals; what a polynomial lacks the verdict says.
    #[error("{0}: none will be given")]
    NoIntervalsAtAll(TooFewGroups),
    /// Moments over forces make so long a lever, m.
    #[error(
        "moments over forces make a lever of {0:.1} m: the moments are in mN·m, it seems; give `--moment-unit mnm`, or \
         name the columns so"
    )]
    MomentUnit(f64),
    /// Channels that never change, from 0.
    #[error("left out, because they never change: {}", names(.0))]
    DeadChannels(Vec<usize>),
    /// Some test rows are outside the range of the training data.
    #[error("{outside} of {rows} test rows have a reading outside the range of the training data")]
    OutOfRange {
        /// So many.
        outside: u64,
        /// Of so many.
        rows: u64,
    },
}

/// Channel names, from `s1`.
fn names(channels: &[usize]) -> String {
    let names: Vec<String> = channels.iter().map(|channel| format!("s{}", channel + 1)).collect();
    names.join(", ")
}

/// More than half as many features as groups: whatever the rank, what the groups leave to tell errors
/// from is too little.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FewGroups {
    /// Features of the model.
    pub features: usize,
    /// Groups of rows.
    pub groups: usize,
}

impl FewGroups {
    /// Of a model with so many features; `None` where the groups are enough.
    pub fn new(features: usize, groups: usize) -> Option<Self> {
        (2 * features > groups).then_some(Self { features, groups })
    }
}
