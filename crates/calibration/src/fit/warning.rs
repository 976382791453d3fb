//! Warnings of a fit, worded once for the terminal, the report and Python.

use least_squares::error::FitError;
use least_squares::exact::ExactError;
use least_squares::uncertainty::TooFewGroups;

#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Warning {
    #[error("not solved exactly but by refined QR: {0}")]
    NotExact(ExactError),
    #[error("not solved exactly but by refined QR: sample_weight has no whole numbers")]
    Weighted,
    #[error(
        "standard errors treat rows as independent, and are too small if rows of a group are correlated: {0}"
    )]
    NotGrouped(FitError),
    #[error(
        "no standard errors: {features} features need {least} groups of rows, found {groups}; record more or \
         use a smaller `--model`",
        features = .0.features,
        groups = .0.groups,
        least = 2 * .0.features
    )]
    FewGroups(FewGroups),
    #[error(
        "left out {0} direction{s} in which the data hardly move the readings",
        s = if *.0 > 1 { "s" } else { "" }
    )]
    DirectionsLeftOut(usize),
    #[error(
        "{rows} rows for {coefficients} coefficients: overfitted; record more poses or choose a smaller \
         `--model`"
    )]
    FewRows {
        /// Rows fitted.
        rows: u64,
        coefficients: usize,
    },
    #[error(
        "the test set leaks: {:.0} % of its rows are at poses of the training data; test on other poses",
        100.0 * .0
    )]
    TestLeaks(f64),
    #[error(
        "the groups leak: {:.0} % of the rows share a pose with other groups; give each pose one label",
        100.0 * .0
    )]
    GroupsLeak(f64),
    #[error(
        "all {0} test rows are outside the training range: check the sensor's zero and the order of the \
         columns"
    )]
    AllOutOfRange(u64),
    /// A physics model has no intervals. The verdict reports missing intervals of a polynomial.
    #[error("{0}: none will be given")]
    NoIntervalsAtAll(TooFewGroups),
    /// The ratio of moments to forces is an implausibly long lever, m.
    #[error(
        "moments / forces = {0:.1} m: moments are probably in mN·m; use `--moment-unit mnm` or rename the \
         columns"
    )]
    MomentUnit(f64),
    /// A lever this long, m, in a table of hung loads.
    #[error(
        "moments / forces = {0:.1} m: the points of the loads are probably in mm: name `x_mm`, `y_mm`, `z_mm`"
    )]
    PointUnit(f64),
    /// Numbered from 0.
    #[error("left out, because they never change: {}", names(.0))]
    DeadChannels(Vec<usize>),
    #[error("{outside} of {rows} test rows have a reading outside the range of the training data")]
    OutOfRange {
        /// Test rows outside the range.
        outside: u64,
        rows: u64,
    },
}

fn names(channels: &[usize]) -> String {
    let names: Vec<String> = channels.iter().map(|channel| format!("s{}", channel + 1)).collect();
    names.join(", ")
}

/// More features than half the groups: whatever the rank, too little is left to estimate errors from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FewGroups {
    pub features: usize,
    pub groups: usize,
}

impl FewGroups {
    /// `None` if there are enough groups.
    pub fn new(features: usize, groups: usize) -> Option<Self> {
        (2 * features > groups).then_some(Self { features, groups })
    }
}
