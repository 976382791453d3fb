//! Which model, and which ridge: the one that predicts new groups best, or a smaller one that is
//! as good.
//!
//! The score of a candidate is its error on groups that it was not trained on, relative to the standard deviation of each
//! axis, squared: the mean over folds, and the geometric mean over axes. Of all candidates that err no more than the best,
//! within one standard error of the [ratio of their errors](super::comparison) on the same folds, the one with the fewest
//! features is chosen (after Breiman et al., Classification and Regression Trees, 1984, §3.4.3, whose standard error is
//! that of the best: folds differ far more from each other than two models on one of them); of several ridges on these,
//! the one with the smallest error: a ridge stronger than need be would bias every prediction and make no model smaller.

use super::comparison::{Comparison, FoldMean, RelativeErrors, varying};
use super::cross_validation::{assign_groups, errors_on, sizes};
use super::grouped::GroupedMoments;
use crate::error::FitError;
use crate::exact::{HeldOutErrors, PartitionedMoments};
use crate::model::{Basis, Model};
use shell_data::wrench::{Axis, PerAxis};

/// Ridge parameters that are tried; larger ones follow, up to [`LARGEST_RIDGE`], as long as the last
/// is the best.
pub const RIDGES: [f64; 5] = [0.0, 1e-8, 1e-6, 1e-4, 1e-2];

/// The largest ridge that is tried: features count for next to nothing against it.
pub const LARGEST_RIDGE: f64 = 1e4;

/// How much larger each ridge is than the one before.
const RIDGE_STEP: f64 = 100.0;

/// Folds that groups are assigned to, where there are as many groups.
pub const FOLDS: usize = 10;

/// A model that was tried.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Candidate {
    /// The family of features.
    pub basis: Basis,
    /// The ridge parameter.
    pub ridge: f64,
    /// Coefficients of each axis.
    pub features: usize,
    /// Its errors on new groups; `None` if it cannot be fitted without one of the folds.
    pub errors: Option<CandidateErrors>,
}

/// How well a model predicts groups that it was not trained on.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct CandidateErrors {
    /// The square of the error relative to the standard deviation of each axis, mean over folds and geometric mean over axes.
    pub score: f64,
    /// Standard error of the score.
    pub standard_error: f64,
    /// Root mean square error, N and N·m.
    #[serde(with = "shell_data::by_axis")]
    pub rms: PerAxis<f64>,
}

/// What was tried and what was chosen.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Selection {
    /// Folds of groups.
    pub folds: usize,
    /// All candidates: smallest models first, smallest ridges first.
    pub candidates: Vec<Candidate>,
    /// The position of the one with the smallest error.
    pub best: usize,
    /// The position of the one chosen.
    pub chosen: usize,
}

/// What was tried, with the errors of each candidate on the folds.
#[derive(Clone, Debug)]
pub struct Tried {
    /// The candidates and the choice.
    pub selection: Selection,
    /// The errors on each fold; none of a candidate that cannot be fitted without one of them.
    errors: Vec<Vec<PerAxis<HeldOutErrors>>>,
    /// Those of the measured wrench, squares of N and N·m.
    variances: PerAxis<f64>,
}

impl Tried {
    /// The errors of one candidate beside those of another, if that is another.
    ///
    /// # Panics
    /// If one of them cannot be fitted.
    pub(super) fn compare(&self, first: usize, second: usize) -> Option<Comparison> {
        let [a, b] = [first, second].map(|position| &self.errors[position]);
        (first != second).then(|| Comparison::new(a, b, &self.variances))
    }
}

/// Compares all models within the basis that was summed, with each of `ridges`; where those are several
/// and the last is the best, with larger ones until one is not.
///
/// # Errors
/// [`FitError`] if there are too few groups, or no model can be fitted.
pub fn select(sums: &GroupedMoments, intercept: bool, ridges: &[f64]) -> Result<Tried, FitError> {
    let whole = sums.all_of_several()?;
    let folds = folds(sums)?;
    let variances = Axis::ALL.map(|axis| whole.variance(axis));
    let model = |basis| Model { basis, intercept, channels: whole.channels(), memory: 0 };
    let errors_of = |basis: Basis| -> Option<ErrorsByRidge<'_>> {
        let parts = PartitionedMoments::new(whole, &model(basis)).ok()?;
        // The sums of a fold are the same for every ridge.
        let of_fold = |fold: &Vec<usize>| {
            let moments = sums.of_fold(fold);
            let part = parts.part(&moments);
            (moments, part)
        };
        let of_folds: Vec<_> = folds.iter().map(of_fold).collect();
        Some(Box::new(move |ridge| {
            let errors = of_folds.iter().map(|(all, part)| parts.held_out(all, part, ridge));
            errors.map(Result::ok).collect()
        }))
    };
    choose(model, ridges, variances, errors_of)
}

/// The errors on each fold by ridge; `None` where the model cannot be fitted without one of them.
pub(super) type ErrorsByRidge<'a> = Box<dyn Fn(f64) -> Option<Vec<PerAxis<HeldOutErrors>>> + 'a>;

/// Compares models by the errors that `errors_of` gives of a family, if that can be fitted at all.
pub(super) fn choose<'a>(
    model: impl Fn(Basis) -> Model,
    ridges: &[f64],
    variances: PerAxis<f64>,
    errors_of: impl Fn(Basis) -> Option<ErrorsByRidge<'a>>,
) -> Result<Tried, FitError> {
    let mut candidates = Vec::new();
    let mut tried: Vec<Vec<PerAxis<HeldOutErrors>>> = Vec::new();
    for basis in Basis::ALL {
        let Some(errors) = errors_of(basis) else { continue };
        let mut try_ridge = |ridge: f64| {
            let errors = errors(ridge);
            tried.push(errors.clone().unwrap_or_default());
            let errors = errors.map(|errors| summarise(&errors, &variances));
            Candidate { basis, ridge, features: model(basis).term_count(), errors }
        };
        let first = candidates.len();
        candidates.extend(ridges.iter().map(|&ridge| try_ridge(ridge)));
        while ridges.len() > 1
            && let [.., last] = &candidates[first..]
            && last.ridge < LARGEST_RIDGE
            && is_best(&candidates[first..])
        {
            let next = last.ridge * RIDGE_STEP;
            candidates.push(try_ridge(next));
        }
    }
    let scored = || candidates.iter().enumerate().filter_map(|(i, c)| Some((i, c, c.errors?)));
    let (best, ..) =
        scored().min_by(|a, b| a.2.score.total_cmp(&b.2.score)).ok_or(FitError::NoModel)?;
    let is_as_good =
        |i: usize| !Comparison::new(&tried[i], &tried[best], &variances).all.second_is_better();
    let chosen = scored()
        .filter(|&(i, ..)| is_as_good(i))
        .min_by(|a, b| a.1.features.cmp(&b.1.features).then(a.2.score.total_cmp(&b.2.score)))
        .map_or(best, |(i, ..)| i);
    let selection = Selection { folds: tried[best].len(), candidates, best, chosen };
    Ok(Tried { selection, errors: tried, variances })
}

/// Whether the last of some candidates has the smallest error.
fn is_best(candidates: &[Candidate]) -> bool {
    let score = |candidate: &Candidate| candidate.errors.map_or(f64::INFINITY, |of| of.score);
    let Some((last, others)) = candidates.split_last() else { return false };
    others.iter().all(|other| score(last) < score(other))
}

/// The folds that [`select`] holds out, as positions of groups in `sums`.
///
/// # Errors
/// [`FitError`] if there are too few groups.
pub fn folds(sums: &GroupedMoments) -> Result<Vec<Vec<usize>>, FitError> {
    assign_groups(&sizes(sums), sums.groups.len().min(FOLDS))
}

/// The errors of a model on each of `folds`, positions of groups in `sums`; `None` if it cannot be fitted without one
/// of them.
///
/// # Errors
/// [`FitError`] if there are too few groups.
pub fn errors_by_fold(
    sums: &GroupedMoments,
    model: &Model,
    ridge: f64,
    folds: &[Vec<usize>],
) -> Result<Option<Vec<PerAxis<HeldOutErrors>>>, FitError> {
    let parts = sums.partitioned(model)?;
    Ok(folds.iter().map(|fold| errors_on(&parts, &sums.of_fold(fold), ridge).ok()).collect())
}

fn summarise(folds: &[PerAxis<HeldOutErrors>], variances: &PerAxis<f64>) -> CandidateErrors {
    let relative = RelativeErrors::new(folds, variances);
    let FoldMean { value, standard_error } = relative.log(&varying(variances));
    let score = libm::exp(2.0 * value);
    CandidateErrors {
        score,
        standard_error: 2.0 * score * standard_error,
        rms: HeldOutErrors::total(folds).map(|errors| errors.rms()),
    }
}
