//! Errors of the whole procedure on groups that it has not seen.

use std::collections::{BTreeMap, BTreeSet};

use super::calibration::PhysicsCalibration;
use super::choice::{Choice, usual};
use super::observation::ObservationSample;
use super::rows::TrainingRows;
use crate::error::FitError;
use crate::exact::HeldOutErrors;
use crate::passes::{Workers, map_folds};
use shell_data::wrench::PerAxis;

/// The level of the intervals whose coverage is counted.
pub const COVERAGE_LEVEL: f64 = 0.95;

/// Errors are computed on about this many rows at most, evenly spread over the groups: the root mean square of so many
/// is right to two thousandths.
const MOST_JUDGED: usize = 200_000;

/// Groups whose rows were each converted by a model that was fitted, choice of λ and prior width
/// included, without their fold.
#[derive(Clone, Debug, PartialEq)]
pub struct PhysicsValidation {
    /// For each fold, its groups in ascending order.
    pub folds: Vec<Vec<GroupErrors>>,
}

/// Errors on one group.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GroupErrors {
    /// The group.
    pub group: u64,
    /// Predicted less measured.
    pub errors: PerAxis<HeldOutErrors>,
    /// Rows within their intervals of [`COVERAGE_LEVEL`]; `None` if those could not be given.
    pub covered: Option<PerAxis<u64>>,
    /// Sum over the rows of half the width of those, N and N·m.
    pub half_widths: PerAxis<f64>,
    /// Sum over the rows of the squares of their errors in standard errors.
    pub scores: PerAxis<f64>,
}

impl PhysicsValidation {
    /// Fits without each of `folds` of groups, started from the choice for all `rows`, and converts their rows.
    /// Folds are fitted on several threads.
    ///
    /// # Errors
    /// [`FitError::Physics`], of any part that is left; [`FitError::Interrupted`].
    pub fn new(
        rows: &TrainingRows,
        folds: &[Vec<u64>],
        whole: &Choice,
        workers: Workers<'_>,
    ) -> Result<Self, FitError> {
        let of_fold = |fold: &Vec<u64>| {
            let held_out: BTreeSet<u64> = fold.iter().copied().collect();
            let rest = whole.sample.without(&held_out);
            let (fitted, _) = PhysicsCalibration::fit_from(rows, rest, Some(whole), Workers::ONE)?;
            Ok(errors(rows, &held_out, &fitted))
        };
        Ok(Self { folds: map_folds(folds, workers, of_fold)? })
    }

    /// All groups.
    pub fn groups(&self) -> impl Iterator<Item = &GroupErrors> {
        self.folds.iter().flatten()
    }

    /// The errors on all rows.
    pub fn total(&self) -> PerAxis<HeldOutErrors> {
        total(self.groups())
    }

    /// The errors on the rows of each fold.
    pub fn by_fold(&self) -> Vec<PerAxis<HeldOutErrors>> {
        self.folds.iter().map(total).collect()
    }

    /// The median over the groups of the size of their mean error, N and N·m.
    pub fn median(&self) -> PerAxis<f64> {
        std::array::from_fn(|axis| {
            let mut sizes: Vec<f64> =
                self.groups().map(|group| group.errors[axis].bias().abs()).collect();
            sizes.sort_unstable_by(f64::total_cmp);
            let middle = |last: usize| f64::midpoint(sizes[last / 2], sizes[last.div_ceil(2)]);
            sizes.len().checked_sub(1).map_or(f64::NAN, middle)
        })
    }

    /// The root mean square over the rows of their errors in standard errors: 1 where those are right.
    pub fn scores(&self) -> PerAxis<f64> {
        let rows: u64 = self.groups().map(|group| group.errors[0].rows).sum();
        std::array::from_fn(|axis| {
            let squares: f64 = self.groups().map(|group| group.scores[axis]).sum();
            (squares / rows as f64).sqrt()
        })
    }

    /// The share of rows within their intervals of [`COVERAGE_LEVEL`], each group with the same
    /// weight, and half the mean width of those; `None` if they could not be given.
    pub fn coverage(&self) -> Option<PerAxis<(f64, f64)>> {
        let mut sums = PerAxis::<(f64, f64)>::default();
        let mut count = 0.0;
        for group in self.groups() {
            let (covered, rows) = (group.covered?, group.errors[0].rows as f64);
            count += 1.0;
            for (axis, sum) in sums.iter_mut().enumerate() {
                sum.0 += covered[axis] as f64 / rows;
                sum.1 += group.half_widths[axis] / rows;
            }
        }
        Some(sums.map(|(covered, width)| (covered / count, width / count)))
    }
}

/// Errors on each of some folds of groups of the model with usual priors, fitted without the fold: a first look.
///
/// # Errors
/// [`FitError::Physics`], of any part that is left; [`FitError::Interrupted`].
pub(crate) fn usual_errors(
    rows: &TrainingRows,
    sample: &ObservationSample,
    folds: &[Vec<u64>],
    workers: Workers<'_>,
) -> Result<Vec<PerAxis<HeldOutErrors>>, FitError> {
    let of_fold = |fold: &Vec<u64>| {
        let held_out: BTreeSet<u64> = fold.iter().copied().collect();
        let model = usual(&sample.without(&held_out))?;
        let fitted = PhysicsCalibration::new(model, [1.0; 6]);
        Ok(total(&errors(rows, &held_out, &fitted)))
    };
    map_folds(folds, workers, of_fold)
}

fn total<'a>(groups: impl IntoIterator<Item = &'a GroupErrors>) -> PerAxis<HeldOutErrors> {
    HeldOutErrors::total(groups.into_iter().map(|group| &group.errors))
}

fn errors(
    rows: &TrainingRows,
    held_out: &BTreeSet<u64>,
    fitted: &PhysicsCalibration,
) -> Vec<GroupErrors> {
    let factors = fitted.intervals.as_ref().and_then(|of| of.factors(COVERAGE_LEVEL).ok());
    let mut groups = BTreeMap::<u64, GroupErrors>::new();
    let every = rows.row_count().div_ceil(MOST_JUDGED);
    let all = rows.convert(held_out, |_| every, |readings| fitted.estimates(readings));
    for row in all {
        let of = groups.entry(row.group).or_insert_with(|| GroupErrors {
            group: row.group,
            covered: factors.map(|_| PerAxis::default()),
            ..GroupErrors::default()
        });
        for axis in 0..6 {
            let (error, standard_error) = (row.errors[axis], row.standard_errors[axis]);
            let one = HeldOutErrors { rows: 1, sum: error, squares: error * error };
            of.errors[axis].merge(&one);
            of.scores[axis] += (error / standard_error).powi(2);
            if let (Some(covered), Some(factors)) = (&mut of.covered, &factors) {
                let half = factors[axis] * standard_error;
                covered[axis] += u64::from(error.abs() <= half);
                of.half_widths[axis] += half;
            }
        }
    }
    groups.into_values().collect()
}
