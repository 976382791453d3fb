//! The choice of model and ridge that predict new groups best, or of a smaller model that is as good.
//!
//! The score of a candidate is its squared error on held-out groups, relative to the variance of each axis: the mean
//! over folds, and the geometric mean over axes. A candidate equals the best if its error is within one standard error
//! of the [ratio of their errors](super::comparison) on the same folds. The equal one with the fewest features is
//! chosen (after Breiman et al., Classification and Regression Trees, 1984, §3.4.3; they use the standard error of the
//! best, but folds differ far more from each other than two models on one fold). Among ridges on these features, the
//! smallest error decides, because a stronger ridge would bias every prediction and make no model smaller.
//!
//! [`Advice`] puts the choice in words. It leaves out the ratio of the error on new groups to that of a random split:
//! this ratio shows how similar the rows of a group are, not which model to use.

use super::comparison::{Comparison, FoldMean, RelativeErrors, varying};
use super::cross_validation::{assign_groups, errors_on, sizes};
use super::grouped::SumsByGroup;
use crate::error::FitError;
use crate::exact::PartitionedSums;
use crate::held_out_errors::HeldOutErrors;
use crate::model::{Basis, Model};
use crate::quality::{in_units, significant};
use shell_data::wrench::{Axes, Axis, PerAxis};

/// Ridge parameters to try. Larger ones follow, up to [`LARGEST_RIDGE`], as long as the last is the best.
pub const RIDGES: [f64; 5] = [0.0, 1e-8, 1e-6, 1e-4, 1e-2];

/// The largest ridge to try; with it, features have almost no effect.
pub const LARGEST_RIDGE: f64 = 1e4;

const RIDGE_STEP: f64 = 100.0;

/// Number of folds, if there are as many groups.
pub const FOLDS: usize = 10;

#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Candidate {
    pub basis: Basis,
    pub ridge: f64,
    /// Number of coefficients per axis.
    pub features: usize,
    /// `None` if the model cannot be fitted without one of the folds.
    pub errors: Option<CandidateErrors>,
}

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct CandidateErrors {
    /// Squared error relative to each axis's variance: mean over folds, geometric mean over axes.
    pub score: f64,
    pub standard_error: f64,
    /// N and N·m.
    #[serde(with = "shell_data::by_axis")]
    pub rms: PerAxis<f64>,
}

#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Selection {
    pub folds: usize,
    /// Candidates by ascending size, then ascending ridge.
    pub candidates: Vec<Candidate>,
    /// Position of the candidate with the smallest error.
    pub best: usize,
    /// Position of the chosen candidate.
    pub chosen: usize,
}

/// A selection, with the errors of each candidate on the folds.
#[derive(Clone, Debug)]
pub struct Tried {
    pub selection: Selection,
    /// Empty for a candidate that cannot be fitted without one of the folds.
    errors: Vec<Vec<PerAxis<HeldOutErrors>>>,
    /// Variances of the measured wrench, squares of N and N·m.
    variances: PerAxis<f64>,
}

impl Tried {
    pub fn chosen_errors(&self) -> &[PerAxis<HeldOutErrors>] {
        &self.errors[self.selection.chosen]
    }

    /// Compares the errors of two candidates; `None` if they are the same.
    ///
    /// # Panics
    /// If one of them cannot be fitted.
    pub(super) fn compare(&self, first: usize, second: usize) -> Option<Comparison> {
        let [a, b] = [first, second].map(|position| &self.errors[position]);
        (first != second).then(|| Comparison::new(a, b, &self.variances))
    }
}

/// Compares all models within the summed basis, with each of `ridges`, and larger ones while the last is best.
///
/// # Errors
/// [`FitError`] if there are too few groups, or no model can be fitted.
pub fn select(sums: &SumsByGroup, intercept: bool, ridges: &[f64]) -> Result<Tried, FitError> {
    let whole = sums.all_of_several()?;
    let folds = folds(sums)?;
    let variances = Axis::ALL.map(|axis| whole.variance(axis));
    let model = |basis| Model { basis, intercept, channels: whole.channels(), memory: 0 };
    let errors_of = |basis: Basis| -> Option<ErrorsByRidge<'_>> {
        let parts = PartitionedSums::new(whole, &model(basis)).ok()?;
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

/// The errors on each fold by ridge; `None` if the model cannot be fitted without one of the folds.
pub(super) type ErrorsByRidge<'a> = Box<dyn Fn(f64) -> Option<Vec<PerAxis<HeldOutErrors>>> + 'a>;

/// `errors_of` returns `None` for a family that cannot be fitted.
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

fn is_best(candidates: &[Candidate]) -> bool {
    let score = |candidate: &Candidate| candidate.errors.map_or(f64::INFINITY, |of| of.score);
    let Some((last, others)) = candidates.split_last() else { return false };
    others.iter().all(|other| score(last) < score(other))
}

/// The folds that [`select`] holds out, as positions of groups in `sums`.
///
/// # Errors
/// [`FitError`] if there are too few groups.
pub fn folds(sums: &SumsByGroup) -> Result<Vec<Vec<usize>>, FitError> {
    assign_groups(&sizes(sums), sums.groups.len().min(FOLDS))
}

/// Errors of a model on each of `folds`, as positions of groups in `sums`; `None` if it cannot be fitted without one.
///
/// # Errors
/// [`FitError`] if there are too few groups.
pub fn errors_by_fold(
    sums: &SumsByGroup,
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

/// The recommended models, with comparisons of their errors.
#[derive(Clone, Debug, PartialEq)]
pub struct Advice {
    pub folds: usize,
    pub best: Candidate,
    /// Model with the fewest features within a standard error of the best.
    pub cautious: Candidate,
    /// Errors of the cautious choice and of the best; `None` if they are the same model.
    pub caution: Option<Comparison>,
    /// Errors of the best and of the requested model, if they differ.
    pub given: Option<Comparison>,
    /// True if the best ridge is the largest that was tried, so a larger one may be better.
    pub ridge_is_at_limit: bool,
}

impl Advice {
    /// Derives advice from a selection; `given` is the position of the requested model.
    pub fn new(tried: &Tried, given: Option<usize>) -> Self {
        let Selection { folds, candidates, best, chosen } = &tried.selection;
        Self {
            folds: *folds,
            best: candidates[*best].clone(),
            cautious: candidates[*chosen].clone(),
            caution: tried.compare(*chosen, *best),
            given: given.and_then(|given| tried.compare(*best, given)),
            ridge_is_at_limit: candidates[*best].ridge >= LARGEST_RIDGE,
        }
    }

    /// Returns true if another model predicts new groups better by more than a standard error of the ratio.
    pub fn another_is_better(&self) -> bool {
        self.given.is_some_and(|given| given.all.first_is_better())
    }

    pub fn words(&self, axes: Axes) -> String {
        let score = |of: &Candidate| {
            let errors =
                of.errors.map(|of| [of.score, of.standard_error].map(|x| significant(x, 2)));
            errors.map_or_else(String::new, |[score, error]| format!("{score} ± {error}"))
        };
        let (best, cautious) = (&self.best, &self.cautious);
        let mut said = format!(
            "best on new groups: {}, squared error {} of the variance of the loads (standard error over \
             {} folds)",
            name(best),
            score(best),
            self.folds
        );
        match &self.caution {
            None => said += "; nothing smaller is within a standard error of it",
            Some(comparison) => {
                let larger = comparison.all.reversed();
                said += &format!(
                    "; cautious choice: {}, {} rather than {} features and within a standard error of the \
                     best. The larger errs {larger}{}: {}",
                    name(cautious),
                    cautious.features,
                    best.features,
                    if larger.first_is_better() { "" } else { ", no more than chance" },
                    worth(comparison, axes),
                );
            }
        }
        if self.ridge_is_at_limit {
            said += "; its ridge is the largest that was tried, a larger one may be better";
        }
        said
    }

    /// Describes the model that predicts new groups better than the requested one, if there is one.
    pub fn better_words(&self, model: Basis, axes: Axes) -> Option<String> {
        let given = self.given.as_ref().filter(|_| self.another_is_better())?;
        let best = &self.best;
        Some(format!(
            "{} predicts new groups better than {}, it errs {}: {}; take `--model {}` or record more poses",
            name(best),
            model.name(),
            given.all,
            worth(given, axes),
            best.basis.name(),
        ))
    }
}

fn name(of: &Candidate) -> String {
    match of.ridge > 0.0 {
        true => format!("{} with ridge {:e}", of.basis.name(), of.ridge),
        false => of.basis.name().to_owned(),
    }
}

/// Formats the errors of the second of two models and of the first.
fn worth(comparison: &Comparison, axes: Axes) -> String {
    in_units(axes.iter(), |axis| {
        let [first, second] = comparison.rms.map(|rms| significant(rms[axis], 3));
        format!("{second} → {first}")
    })
}
