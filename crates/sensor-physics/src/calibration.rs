//! Inversion of a physics model with error estimates from held-out groups, and cross-validation.

use std::collections::{BTreeMap, BTreeSet};

use super::choice::{Choice, USUAL};
use super::fit::Observation;
use super::inversion::{Estimates, Inversion};
use super::model::PhysicsModel;
use super::rows::{ObservationSample, TrainingRows};
use least_squares::error::FitError;
use least_squares::held_out_errors::COVERAGE_LEVEL;
use least_squares::held_out_errors::HeldOutErrors;
use least_squares::passes::{Workers, map_folds};
use least_squares::uncertainty::{GroupIntervals, Scores};
use shell_data::wrench::PerAxis;

/// Weight of the model's own standard errors, as a number of groups, when held-out groups correct them.
const MODEL_GROUPS: f64 = 4.0;

/// Most rows scored in each group for its quantiles: rows of a group resemble each other.
const MOST_SCORED: usize = 64;

#[derive(Clone, Debug, PartialEq)]
pub struct PhysicsCalibration {
    inversion: Inversion,
    /// Factor for the model's standard errors: RMS of held-out errors in these standard errors.
    pub error_scale: PerAxis<f64>,
    pub intervals: Option<GroupIntervals>,
}

fn scores_of(rows: &TrainingRows, choice: &Choice) -> Scores {
    let mut scores = Scores::default();
    for (groups, model) in &choice.fold_models {
        let inversion = Inversion::new(model);
        let every = |rows: usize| rows.div_ceil(MOST_SCORED);
        let estimates = |readings: &[Vec<f64>]| inversion.estimates(readings);
        rows.convert(groups, every, estimates, |group, errors, standard_errors| {
            scores.add(group, &errors, &standard_errors);
        });
    }
    scores
}

impl PhysicsCalibration {
    /// Creates a calibration without intervals. `error_scale` multiplies the standard errors of the model.
    pub fn new(model: PhysicsModel, error_scale: PerAxis<f64>) -> Self {
        Self { inversion: Inversion::new(&model), error_scale, intervals: None }
    }

    /// Fits to rows. Held-out groups select λ, the width of the priors and the number of shared factors; their errors
    /// also scale the standard errors and give the intervals. Using the groups twice matters little, because the
    /// selection sets only three numbers.
    ///
    /// # Errors
    /// [`FitError::Physics`], [`FitError::Interrupted`].
    pub fn fit(rows: &TrainingRows, workers: Workers<'_>) -> Result<(Self, Choice), FitError> {
        Self::fit_sample(rows, ObservationSample::from_rows(rows)?, None, workers)
    }

    /// Like [`fit`](Self::fit), on a sample of the observations of these rows. Holds out `folds` of groups, if given.
    pub fn fit_sample(
        rows: &TrainingRows,
        sample: ObservationSample,
        folds: Option<&[Vec<u64>]>,
        workers: Workers<'_>,
    ) -> Result<(Self, Choice), FitError> {
        let choice = Choice::fit_sample(sample, folds, workers)?;
        let scores = scores_of(rows, &choice);
        Ok((Self::with_scores(choice.model.clone(), scores), choice))
    }

    fn with_scores(model: PhysicsModel, mut scores: Scores) -> Self {
        let error_scale = scores.rescale(MODEL_GROUPS);
        Self { intervals: Some(scores.intervals()), ..Self::new(model, error_scale) }
    }

    pub fn model(&self) -> &PhysicsModel {
        &self.inversion.model
    }

    /// Wrenches of all rows, with standard errors rescaled by held-out groups; see [`Inversion::estimates`].
    ///
    /// # Panics
    /// If `readings` does not have one column per channel of the model, or the columns differ in length.
    pub fn estimates(&self, readings: &[Vec<f64>]) -> Estimates {
        let mut estimates = self.inversion.estimates(readings);
        for (errors, scale) in estimates.standard_errors.iter_mut().zip(self.error_scale) {
            errors.iter_mut().for_each(|error| *error *= scale);
        }
        estimates
    }
}

/// Approximate maximum number of rows on which errors are computed, spread evenly over the groups: their root
/// mean square is accurate to two thousandths.
const MOST_JUDGED: usize = 200_000;

/// Cross-validation over folds of groups. The priors, three numbers, were chosen on all folds.
#[derive(Clone, Debug, PartialEq)]
pub struct PhysicsValidation {
    /// Groups of each fold, in ascending order.
    pub folds: Vec<Vec<GroupErrors>>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GroupErrors {
    pub group: u64,
    /// Predicted minus measured.
    pub errors: PerAxis<HeldOutErrors>,
    /// Rows within their intervals of [`COVERAGE_LEVEL`]; `None` without intervals.
    pub covered: Option<PerAxis<u64>>,
    /// Sums of the half-widths of these intervals, N and N·m.
    pub half_widths: PerAxis<f64>,
    /// Sums of the squared errors, in squared standard errors.
    pub scores: PerAxis<f64>,
}

impl PhysicsValidation {
    /// Converts the rows of each of `folds` with the chosen model, refitted without the fold. Intervals come from the
    /// scores of all other groups. Models that the choice has not fitted yet are fitted on several threads.
    ///
    /// # Errors
    /// [`FitError::Interrupted`].
    pub fn new(
        rows: &TrainingRows,
        folds: &[Vec<u64>],
        choice: &Choice,
        workers: Workers<'_>,
    ) -> Result<Self, FitError> {
        let scores = scores_of(rows, choice);
        let fit = |held_out: &BTreeSet<u64>| {
            let scores = scores.without(held_out);
            Ok(PhysicsCalibration::with_scores(choice.without(held_out), scores))
        };
        Self::by(fit, rows, folds, workers)
    }

    /// Like [`new`](Self::new), with the usual priors and no shared factors: a preview in a tenth of a choice's time.
    ///
    /// # Errors
    /// [`FitError::Physics`] if rows outside of a fold cannot be fitted; [`FitError::Interrupted`].
    pub fn usual(
        rows: &TrainingRows,
        sample: &ObservationSample,
        folds: &[Vec<u64>],
        workers: Workers<'_>,
    ) -> Result<Self, FitError> {
        let fit = |held_out: &BTreeSet<u64>| {
            let rest: Vec<Observation> =
                sample.tried.iter().filter(|o| !held_out.contains(&o.group)).cloned().collect();
            let model = PhysicsModel::fit(&rest, USUAL.0, USUAL.1)?;
            Ok(PhysicsCalibration::new(model, [1.0; 6]))
        };
        Self::by(fit, rows, folds, workers)
    }

    fn by(
        fit: impl Fn(&BTreeSet<u64>) -> Result<PhysicsCalibration, FitError> + Sync,
        rows: &TrainingRows,
        folds: &[Vec<u64>],
        workers: Workers<'_>,
    ) -> Result<Self, FitError> {
        let of_fold = |fold: &Vec<u64>| {
            let held_out: BTreeSet<u64> = fold.iter().copied().collect();
            Ok(errors(rows, &held_out, &fit(&held_out)?))
        };
        Ok(Self { folds: map_folds(folds, workers, of_fold)? })
    }

    pub fn groups(&self) -> impl Iterator<Item = &GroupErrors> {
        self.folds.iter().flatten()
    }

    pub fn total(&self) -> PerAxis<HeldOutErrors> {
        total(self.groups())
    }

    pub fn by_fold(&self) -> Vec<PerAxis<HeldOutErrors>> {
        self.folds.iter().map(total).collect()
    }

    /// Median over the groups of the absolute mean error, N and N·m.
    pub fn median(&self) -> PerAxis<f64> {
        std::array::from_fn(|axis| {
            let mut sizes: Vec<f64> =
                self.groups().map(|group| group.errors[axis].bias().abs()).collect();
            sizes.sort_unstable_by(f64::total_cmp);
            let middle = |last: usize| f64::midpoint(sizes[last / 2], sizes[last.div_ceil(2)]);
            sizes.len().checked_sub(1).map_or(f64::NAN, middle)
        })
    }

    /// Root mean square error in standard errors: 1 if these are right.
    pub fn scores(&self) -> PerAxis<f64> {
        let rows: u64 = self.groups().map(|group| group.errors[0].rows).sum();
        std::array::from_fn(|axis| {
            let squares: f64 = self.groups().map(|group| group.scores[axis]).sum();
            (squares / rows as f64).sqrt()
        })
    }

    /// Share of rows within their intervals of [`COVERAGE_LEVEL`], and mean half-width, with equal weights of groups;
    /// `None` if a group has no intervals.
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
    let take = |group, errors: PerAxis<f64>, standard_errors: PerAxis<f64>| {
        let covered = factors.map(|_| PerAxis::default());
        let of =
            groups.entry(group).or_insert(GroupErrors { group, covered, ..GroupErrors::default() });
        for (axis, (error, standard_error)) in errors.into_iter().zip(standard_errors).enumerate() {
            let one = HeldOutErrors { rows: 1, sum: error, squares: error * error };
            of.errors[axis].merge(&one);
            of.scores[axis] += (error / standard_error).powi(2);
            if let (Some(covered), Some(factors)) = (&mut of.covered, &factors) {
                let half = factors[axis] * standard_error;
                covered[axis] += u64::from(error.abs() <= half);
                of.half_widths[axis] += half;
            }
        }
    };
    rows.convert(held_out, |_| every, |readings| fitted.estimates(readings), take);
    groups.into_values().collect()
}
