//! Choice of λ, the width of the priors and the number of shared factors by cross-validation over groups.
//!
//! The chosen λ and width have the smallest squared error on held-out groups, relative to the mean square of each axis
//! and averaged over the axes. A further factor is accepted if its mean gain in the log density of the held-out
//! readings, over the folds, is more than one standard error of that mean. This criterion depends on all sensors and on
//! the correlation of their errors, which hardly shows in the errors of a wrench. Then λ is chosen once more. Fits
//! without a fold start from the fit to all observations.

use std::collections::BTreeSet;

use super::PhysicsError;
use super::factors::fit_factors;
use super::fit::{FittedParameters, Observation, Scaled, Scales, fit, fit_from};
use super::inversion::Inversion;
use super::model::PhysicsModel;
use super::response::{FACTORS, factor_count};
use super::rows::ObservationSample;
use least_squares::error::FitError;
use least_squares::passes::{Workers, map};

/// Half decades below 1. Bayes' rule gives λ = 1 for normally distributed loads, but λ = 1 pulls loads at the edge of
/// the range, and no others, to a distant minimum.
const LAMBDAS: [f64; 4] = [0.01, 0.03, 0.1, 0.3];

const WIDTHS: [f64; 3] = [0.25, 0.5, 1.0];

pub(super) const USUAL: (f64, f64) = (LAMBDAS[2], WIDTHS[1]);

/// Maximum number of groups that are held out one by one; more are assigned to [`FOLDS`] folds.
const MOST_ALONE: usize = 40;
const FOLDS: usize = 10;

/// Fewest folds to test for shared factors: with fewer, the standard error of the gain says little.
const FEWEST_FOLDS: usize = 8;

/// Comparison of a number of shared factors with the best smaller number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FactorTrial {
    pub factors: usize,
    /// Mean gain in the log density of a held-out fold's readings.
    pub gain: f64,
    pub standard_error: f64,
}

impl FactorTrial {
    pub fn is_taken(&self) -> bool {
        self.gain > self.standard_error
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// Fitted to all observations.
    pub model: PhysicsModel,
    pub factor_trials: Vec<FactorTrial>,
    /// Each fold of groups, with the chosen candidate fitted to all other groups.
    pub(super) fold_models: Vec<(BTreeSet<u64>, PhysicsModel)>,
    scales: Scales,
    /// Fit to all observations in `sample.tried`: the start for fits to most of them.
    fitted: FittedParameters,
    pub sample: ObservationSample,
}

struct CandidateData<'a> {
    scales: Scales,
    folds: Vec<ObservationFold<'a>>,
    workers: Workers<'a>,
}

type Fits = (FittedParameters, [f64; LAMBDAS.len()]);

impl Choice {
    /// Chooses λ, prior width and number of factors by cross-validation, and fits the model.
    ///
    /// # Errors
    /// [`PhysicsError`] if there are too few observations, groups or channels; [`FitError::Interrupted`].
    pub fn fit(observations: &[Observation], workers: Workers<'_>) -> Result<Self, FitError> {
        Self::fit_sample(ObservationSample::new(observations), None, workers)
    }

    /// Holds out the given `folds` of groups; without them, deals the groups to folds in turn.
    pub(super) fn fit_sample(
        sample: ObservationSample,
        folds: Option<&[Vec<u64>]>,
        workers: Workers<'_>,
    ) -> Result<Self, FitError> {
        let tried: Vec<&Observation> = sample.tried.iter().collect();
        let observations: Vec<&Observation> = sample.fitted.iter().collect();
        let scales = Scales::new(&observations)?;
        let mut data = scales.apply(&tried);
        let folds = folds.map_or_else(|| folds_in_turn(&tried), as_sets);
        if folds.len() < 2 {
            return Err(PhysicsError::TooFewGroups(folds.len()).into());
        }
        let folds = folds.into_iter().map(|fold| ObservationFold::new(fold, &tried, &scales));
        let tries = CandidateData { folds: folds.collect(), scales, workers };
        let (mut scores, mut widths) = (Vec::new(), Vec::new());
        for width in WIDTHS {
            let whole = fit(&data, width);
            let fits = tries.fits(width, |rest| fit_from(rest, width, &whole))?;
            scores.extend(tries.scores(&fits));
            widths.push((whole, fits));
        }
        let best = least(&scores);
        let position = best / LAMBDAS.len();
        let (mut lambda, width) = (LAMBDAS[best % LAMBDAS.len()], WIDTHS[position]);
        let mut chosen = widths.swap_remove(position);
        let without_factors = chosen.0.clone();
        let mut factor_trials = Vec::new();
        let counts = if tries.folds.len() < FEWEST_FOLDS { 0..0 } else { 1..FACTORS + 1 };
        for count in counts {
            let whole = fit_factors(&data, width, &without_factors, Some(count));
            let fits = tries.fits(width, |rest| fit_factors(rest, width, &whole, None))?;
            let trial = tries.compare(count, width, &fits, &chosen.1);
            factor_trials.push(trial);
            if !trial.is_taken() {
                break;
            }
            lambda = LAMBDAS[least(&tries.scores(&fits))];
            chosen = (whole, fits);
        }

        let at = (lambda, width);
        let (of_tried, of_folds) = chosen;
        let fold_model = |(fold, (fitted, _)): (usize, &Fits)| {
            (tries.folds[fold].groups.clone(), tries.model(fold, fitted, at))
        };
        let fold_models = of_folds.iter().enumerate().map(fold_model).collect();
        let mut fitted = of_tried.clone();
        if tried.len() < observations.len() {
            data = tries.scales.apply(&observations);
            fitted = refit(&data, width, &fitted);
        }
        let model = PhysicsModel::from_fit(&tries.scales, &data, &fitted, at);
        let scales = tries.scales;
        Ok(Self { model, factor_trials, fold_models, scales, fitted: of_tried, sample })
    }

    /// Folds of groups that were held out for the choice.
    pub fn folds(&self) -> Vec<Vec<u64>> {
        self.fold_models.iter().map(|(fold, _)| fold.iter().copied().collect()).collect()
    }

    pub fn without(&self, groups: &BTreeSet<u64>) -> PhysicsModel {
        if let Some((_, known)) = self.fold_models.iter().find(|(fold, _)| fold == groups) {
            return known.clone();
        }
        let tried: Vec<&Observation> = self.sample.tried.iter().collect();
        let rest = ObservationFold::new(groups.clone(), &tried, &self.scales).rest;
        let fitted = refit(&rest, self.model.prior_width, &self.fitted);
        let at = (self.model.lambda, self.model.prior_width);
        PhysicsModel::from_fit(&self.scales, &rest, &fitted, at)
    }
}

/// Refits with the same number of factors, from the result for nearly the same observations.
fn refit(data: &Scaled, width: f64, start: &FittedParameters) -> FittedParameters {
    match factor_count(&start.loadings) {
        0 => fit_from(data, width, start),
        _ => fit_factors(data, width, start, None),
    }
}

impl CandidateData<'_> {
    fn model(&self, fold: usize, fitted: &FittedParameters, at: (f64, f64)) -> PhysicsModel {
        PhysicsModel::from_fit(&self.scales, &self.folds[fold].rest, fitted, at)
    }

    /// Fits without each fold, on all threads, and computes the squared errors on the fold.
    fn fits(
        &self,
        width: f64,
        fit: impl Fn(&Scaled) -> FittedParameters + Sync,
    ) -> Result<Vec<Fits>, FitError> {
        let folds: Vec<usize> = (0..self.folds.len()).collect();
        map(&folds, self.workers, |&fold| {
            let fitted = fit(&self.folds[fold].rest);
            let model = self.model(fold, &fitted, (LAMBDAS[0], width));
            let mut inversion = Inversion::new(&model);
            let held_out = &self.folds[fold].held_out;
            let squares = LAMBDAS.map(|lambda| {
                inversion.set_lambda(lambda);
                inversion.squared_errors(held_out, &model.wrench_scale).iter().sum()
            });
            Ok((fitted, squares))
        })
    }

    /// Squared held-out error for each λ, relative to the mean square of each axis and averaged over the axes.
    fn scores(&self, fits: &[Fits]) -> [f64; LAMBDAS.len()] {
        let count = 6.0 * self.folds.iter().map(|fold| fold.held_out.len()).sum::<usize>() as f64;
        let sum = |at: usize| fits.iter().map(|(_, squares)| squares[at]).sum::<f64>();
        std::array::from_fn(|at| sum(at) / count)
    }

    /// Mean gain in the log density of a fold's readings, from the fits `best` to `fits`.
    fn compare(&self, factors: usize, width: f64, fits: &[Fits], best: &[Fits]) -> FactorTrial {
        let gains: Vec<f64> = (fits.iter().zip(best).enumerate())
            .map(|(fold, (fit, best))| {
                let density = |fitted| {
                    let model = self.model(fold, fitted, (LAMBDAS[0], width));
                    self.folds[fold].held_out.iter().map(|o| model.ln_density(o)).sum::<f64>()
                };
                density(&fit.0) - density(&best.0)
            })
            .collect();
        let count = gains.len() as f64;
        let gain = gains.iter().sum::<f64>() / count;
        let squares: f64 = gains.iter().map(|of| (of - gain).powi(2)).sum();
        FactorTrial { factors, gain, standard_error: (squares / (count * (count - 1.0))).sqrt() }
    }
}

fn least(scores: &[f64]) -> usize {
    let scores = scores.iter().enumerate();
    scores.min_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |(position, _)| position)
}

struct ObservationFold<'a> {
    groups: BTreeSet<u64>,
    held_out: Vec<&'a Observation>,
    rest: Scaled,
}

impl<'a> ObservationFold<'a> {
    fn new(groups: BTreeSet<u64>, observations: &[&'a Observation], scales: &Scales) -> Self {
        let is_held_out = |o: &&&Observation| groups.contains(&o.group);
        let (held_out, rest): (_, Vec<&Observation>) = observations.iter().partition(is_held_out);
        Self { groups, held_out, rest: scales.apply(&rest) }
    }
}

fn as_sets(folds: &[Vec<u64>]) -> Vec<BTreeSet<u64>> {
    folds.iter().map(|fold| fold.iter().copied().collect()).collect()
}

/// Puts each of up to [`MOST_ALONE`] groups into a separate fold; deals more to [`FOLDS`] folds.
fn folds_in_turn(observations: &[&Observation]) -> Vec<BTreeSet<u64>> {
    let groups: BTreeSet<u64> = observations.iter().map(|o| o.group).collect();
    let count = if groups.len() > MOST_ALONE { FOLDS } else { groups.len() };
    let mut folds = vec![BTreeSet::new(); count];
    for (position, group) in groups.into_iter().enumerate() {
        folds[position % count].insert(group);
    }
    folds
}
