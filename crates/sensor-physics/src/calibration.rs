//! A physics model as a calibration: inverted, with what is known of its errors; and the errors of the whole procedure on
//! groups that it has not seen.

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

/// Groups that the model's own standard errors count as, when held-out groups correct them.
const MODEL_GROUPS: f64 = 4.0;

/// Rows of each group that tell its quantiles: rows of a group resemble each other.
const MOST_SCORED: usize = 64;

/// A physics model, ready to convert readings.
#[derive(Clone, Debug, PartialEq)]
pub struct PhysicsCalibration {
    inversion: Inversion,
    /// What the model's standard errors are multiplied by on each axis: the root mean square of held-out errors in
    /// them.
    pub error_scale: PerAxis<f64>,
    /// Intervals from groups that were held out, where those are known.
    pub intervals: Option<GroupIntervals>,
}

/// The scores of some rows of each group, by the model that was fitted without it.
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
    /// Makes a model ready, without intervals. Its standard errors are multiplied by `error_scale`.
    pub fn new(model: PhysicsModel, error_scale: PerAxis<f64>) -> Self {
        Self { inversion: Inversion::new(&model), error_scale, intervals: None }
    }

    /// Fits to rows: chooses λ, the width of the priors and shared factors by groups that are held out, whose
    /// errors scale the standard errors and give the intervals. They were chosen on these groups, too: three
    /// numbers, for all of them.
    ///
    /// # Errors
    /// [`FitError::Physics`], [`FitError::Interrupted`].
    pub fn fit(rows: &TrainingRows, workers: Workers<'_>) -> Result<(Self, Choice), FitError> {
        Self::fit_sample(rows, ObservationSample::from_rows(rows)?, None, workers)
    }

    /// Like [`fit`](Self::fit), on a sample of the observations of these rows; holds out `folds` of groups, where they
    /// are given.
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

    /// A model with the standard errors and intervals that scores of held-out rows tell.
    fn with_scores(model: PhysicsModel, mut scores: Scores) -> Self {
        let error_scale = scores.rescale(MODEL_GROUPS);
        Self { intervals: Some(scores.intervals()), ..Self::new(model, error_scale) }
    }

    /// The model.
    pub fn model(&self) -> &PhysicsModel {
        &self.inversion.model
    }

    /// The wrenches of all rows, with standard errors as held-out groups have them; see [`Inversion::estimates`].
    ///
    /// # Panics
    /// If `readings` are not the model's channels, or of different lengths.
    pub fn estimates(&self, readings: &[Vec<f64>]) -> Estimates {
        let mut estimates = self.inversion.estimates(readings);
        for (errors, scale) in estimates.standard_errors.iter_mut().zip(self.error_scale) {
            errors.iter_mut().for_each(|error| *error *= scale);
        }
        estimates
    }
}

/// Errors are computed on about this many rows at most, evenly spread over the groups: the root mean square of so many
/// is right to two thousandths.
const MOST_JUDGED: usize = 200_000;

/// Groups whose rows were each converted by a model that was fitted without their fold, with the priors that were chosen
/// on all folds: three numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct PhysicsValidation {
    /// For each fold, its groups in ascending order.
    pub folds: Vec<Vec<GroupErrors>>,
}

/// Errors on one group.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GroupErrors {
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
    /// Converts the rows of each of `folds` by the chosen model, fitted without the fold, with intervals from the scores of
    /// all other groups. The folds that it was chosen on are known; others are fitted, on several threads.
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

    /// Like [`new`](Self::new), by the model with usual priors, without factors: tells what it is worth here, in a tenth of
    /// the time of a choice.
    ///
    /// # Errors
    /// [`FitError::Physics`], of any part that is left; [`FitError::Interrupted`].
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

    /// Fits without each fold, and converts the rows of the fold.
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
        let of = groups.entry(group).or_insert(GroupErrors { covered, ..GroupErrors::default() });
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
