//! λ, the width of the priors and the number of shared factors, by groups that were held out.
//!
//! Each candidate is fitted without a fold of whole groups and judged on them. λ and width are those of the least
//! squared error, relative to the mean square of each axis, averaged over the axes. A factor more is taken where
//! the readings of the held-out groups become more probable, by more than a standard error of the mean gain over the
//! folds: that sees all sensors and how they err together, of which errors of a wrench show little. Then λ is
//! chosen once more. Fits without a fold start from the fit to all, which is near.

use std::collections::{BTreeMap, BTreeSet};

use super::PhysicsError;
use super::factors::fit_factors;
use super::fit::{FittedParameters, Observation, Scaled, Scales, fit, fit_from};
use super::inversion::Inversion;
use super::model::PhysicsModel;
use super::response::FACTORS;
use super::rows::ObservationSample;
use least_squares::error::FitError;
use least_squares::passes::{Workers, map};

/// The λ that are tried: half decades below what Bayes' rule would take for normal loads. That itself, 1, pulls a
/// load at the edge of the range to a minimum far off, which other loads do not show.
const LAMBDAS: [f64; 4] = [0.01, 0.03, 0.1, 0.3];

/// The widths that are tried.
const WIDTHS: [f64; 3] = [0.25, 0.5, 1.0];

/// λ and width that are mostly near the chosen ones.
pub(super) const USUAL: (f64, f64) = (LAMBDAS[2], WIDTHS[1]);

/// Up to this many groups each is held out alone; more are assigned to [`FOLDS`] folds.
const MOST_ALONE: usize = 40;
const FOLDS: usize = 10;

/// Folds of up to [`MOST_ALONE`] groups in a fit that is itself without a fold. Of 31 poses each held out alone they
/// choose alike, in half the time.
const FOLDS_WITHIN: usize = 15;

/// Fewest folds that tell whether factors are shared: a standard error of fewer gains says little.
const FEWEST_FOLDS: usize = 8;

/// A number of shared factors beside the best of fewer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FactorTrial {
    /// Factors.
    pub factors: usize,
    /// Mean gain of the log density of a held-out fold's readings.
    pub gain: f64,
    /// Its standard error.
    pub standard_error: f64,
}

impl FactorTrial {
    /// Whether the gain is more than a standard error.
    pub fn is_taken(&self) -> bool {
        self.gain > self.standard_error
    }
}

/// The chosen model and what it was chosen from.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// The model, fitted to all observations.
    pub model: PhysicsModel,
    /// The numbers of factors that were tried.
    pub factor_trials: Vec<FactorTrial>,
    /// The chosen candidate without each fold of groups: those that were held out, and what was fitted to the others.
    pub(super) fold_models: Vec<(BTreeSet<u64>, PhysicsModel)>,
    /// Fits to all observations, from which those to most of them start: their scales, those of each width without
    /// factors, and those with one factor, two, as far as those were tried.
    scales: Scales,
    widths: Vec<FittedParameters>,
    factors: Vec<FittedParameters>,
    /// What it was chosen on.
    pub sample: ObservationSample,
}

/// What all candidates are fitted to.
struct CandidateData<'a> {
    scales: Scales,
    folds: Vec<ObservationFold<'a>>,
    workers: Workers<'a>,
}

/// Fits without one fold and their squared errors on it for each λ.
type Fits = (FittedParameters, [f64; LAMBDAS.len()]);

impl Choice {
    /// Fits a model whose λ, prior width and number of factors are chosen by cross-validation.
    ///
    /// # Errors
    /// [`PhysicsError`] if there are too few observations, groups or channels; [`FitError::Interrupted`].
    pub fn fit(observations: &[Observation], workers: Workers<'_>) -> Result<Self, FitError> {
        Self::fit_from(ObservationSample::new(observations), None, workers)
    }

    /// The same for a sample of observations; `before` is the choice for a larger sample, where the fits start.
    pub(super) fn fit_from(
        sample: ObservationSample,
        before: Option<&Self>,
        workers: Workers<'_>,
    ) -> Result<Self, FitError> {
        let tried: Vec<&Observation> = sample.tried.iter().collect();
        let observations: Vec<&Observation> = sample.fitted.iter().collect();
        let scales = Scales::new(&observations)?;
        let mut data = scales.apply(&tried);
        let most_alone = if before.is_some() { FOLDS_WITHIN } else { MOST_ALONE };
        let folds = folds(&tried, &scales, most_alone);
        if folds.len() < 2 {
            return Err(PhysicsError::TooFewGroups(folds.len()).into());
        }
        let before = before.filter(|of| of.scales.has_channels_of(&scales));
        let tries = CandidateData { scales, folds, workers };
        let (mut scores, mut tried_widths) = (Vec::new(), Vec::new());
        for (position, width) in WIDTHS.into_iter().enumerate() {
            let whole = match before {
                Some(of) => {
                    let start = of.widths[position].rescaled(&of.scales, &tries.scales);
                    fit_from(&data, width, &start)
                }
                None => fit(&data, width),
            };
            let fits = tries.fits(width, |rest| fit_from(rest, width, &whole))?;
            scores.extend(tries.scores(&fits));
            tried_widths.push((whole, fits));
        }
        let widths: Vec<FittedParameters> =
            tried_widths.iter().map(|(whole, _)| whole.clone()).collect();
        let best = least(&scores);
        let position = best / LAMBDAS.len();
        let (mut lambda, width) = (LAMBDAS[best % LAMBDAS.len()], WIDTHS[position]);
        let mut chosen = tried_widths.swap_remove(position);
        let (mut factor_trials, mut factors) = (Vec::new(), Vec::new());
        let counts = if tries.folds.len() < FEWEST_FOLDS { 0..0 } else { 1..FACTORS + 1 };
        for count in counts {
            let start = before.and_then(|of| {
                Some(of.factors.get(count - 1)?.rescaled(&of.scales, &tries.scales))
            });
            let whole = match start {
                Some(start) => fit_factors(&data, width, &start, None),
                None => fit_factors(&data, width, &widths[position], Some(count)),
            };
            let fits = tries.fits(width, |rest| fit_factors(rest, width, &whole, None))?;
            let trial = tries.compare(count, width, &fits, &chosen.1);
            factor_trials.push(trial);
            factors.push(whole.clone());
            if !trial.is_taken() {
                break;
            }
            lambda = LAMBDAS[least(&tries.scores(&fits))];
            chosen = (whole, fits);
        }

        let at = (lambda, width);
        let (mut fitted, of_folds) = chosen;
        if tried.len() < observations.len() {
            data = tries.scales.apply(&observations);
            fitted = match factor_trials.iter().any(FactorTrial::is_taken) {
                true => fit_factors(&data, width, &fitted, None),
                false => fit_from(&data, width, &fitted),
            };
        }
        let model = PhysicsModel::from_fit(&tries.scales, &data, &fitted, at);
        let fold_model = |(fold, (fitted, _)): (usize, &Fits)| {
            (tries.folds[fold].groups.clone(), tries.model(fold, fitted, at))
        };
        let fold_models = of_folds.iter().enumerate().map(fold_model).collect();
        let scales = tries.scales.clone();
        Ok(Self { model, factor_trials, fold_models, scales, widths, factors, sample })
    }
}

impl CandidateData<'_> {
    fn model(&self, fold: usize, fitted: &FittedParameters, at: (f64, f64)) -> PhysicsModel {
        PhysicsModel::from_fit(&self.scales, &self.folds[fold].rest, fitted, at)
    }

    /// Fits without each fold, on all threads, with their squared errors there.
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

    /// For each λ the squared error on held-out groups relative to the mean square of each axis, averaged.
    fn scores(&self, fits: &[Fits]) -> [f64; LAMBDAS.len()] {
        let count = 6.0 * self.folds.iter().map(|fold| fold.held_out.len()).sum::<usize>() as f64;
        let sum = |at: usize| fits.iter().map(|(_, squares)| squares[at]).sum::<f64>();
        std::array::from_fn(|at| sum(at) / count)
    }

    /// How much more probable the readings of each fold are by the first of two fits without it.
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

/// The position of the least score.
fn least(scores: &[f64]) -> usize {
    let scores = scores.iter().enumerate();
    scores.min_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |(position, _)| position)
}

struct ObservationFold<'a> {
    groups: BTreeSet<u64>,
    held_out: Vec<&'a Observation>,
    /// The observations of all other folds.
    rest: Scaled,
}

/// Groups assigned in turn to at most `most_alone` folds, or, if there are more than [`MOST_ALONE`], to [`FOLDS`].
fn folds<'a>(
    observations: &[&'a Observation],
    scales: &Scales,
    most_alone: usize,
) -> Vec<ObservationFold<'a>> {
    let mut positions = BTreeMap::new();
    observations.iter().for_each(|o| _ = positions.insert(o.group, 0));
    let folds = if positions.len() > MOST_ALONE { FOLDS } else { positions.len().min(most_alone) };
    positions.values_mut().zip((0..folds).cycle()).for_each(|(position, fold)| *position = fold);
    let fold = |fold: usize| {
        let is_held_out = |o: &&&Observation| positions[&o.group] == fold;
        let (held_out, rest): (_, Vec<&Observation>) = observations.iter().partition(is_held_out);
        let groups = positions.iter().filter(|(_, position)| **position == fold);
        let groups = groups.map(|(group, _)| *group).collect();
        ObservationFold { groups, held_out, rest: scales.apply(&rest) }
    };
    (0..folds).map(fold).collect()
}
