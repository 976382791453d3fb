//! λ, the width of the priors and the number of shared factors, by groups that were held out.
//!
//! Each candidate is fitted without a fold of whole groups and judged on them. λ and width are those of the least
//! squared error, relative to the mean square of each axis, averaged over the axes. A factor more is taken where
//! the readings of the held-out groups become more probable, by more than a standard error of the mean gain over the
//! folds: that sees all sensors and how they err together, of which errors of a wrench show little. Then λ is
//! chosen once more.

use std::sync::Arc;

use super::PhysicsError;
use super::candidates::{Candidate, Candidates};
use super::inversion::Inversion;
use super::loadings::FACTORS;
use super::model::{PhysicsModel, check};
use super::observations::Observation;
use crate::error::FitError;
use crate::passes::{Workers, map};

/// The λ that are tried: half decades below what Bayes' rule would take for normal loads. That itself, 1, pulls a
/// load at the edge of the range to a minimum far off, which other loads do not show.
pub const LAMBDAS: [f64; 4] = [0.01, 0.03, 0.1, 0.3];

/// The widths that are tried.
pub const WIDTHS: [f64; 3] = [0.25, 0.5, 1.0];

/// Fewest folds that tell whether factors are shared: a standard error of fewer gains says little.
const FEWEST_FOLDS: usize = 8;

/// A candidate and its score.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trial {
    /// λ.
    pub lambda: f64,
    /// Standard deviation of the priors of lo, ln h and ln ν.
    pub width: f64,
    /// Squared error on held-out groups relative to the mean square of each axis, averaged.
    pub score: f64,
}

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
    /// All candidates, widths ascending, then λ.
    pub trials: Vec<Trial>,
    /// The numbers of factors that were tried.
    pub factor_trials: Vec<FactorTrial>,
    /// The chosen candidate without each fold of groups.
    pub fold_models: Vec<FoldModel>,
}

/// The chosen candidate without one of the folds.
#[derive(Clone, Debug, PartialEq)]
pub struct FoldModel {
    /// The groups that were held out.
    pub groups: Vec<u64>,
    /// Fitted to the others.
    pub model: PhysicsModel,
}

/// What candidates are judged on.
struct Trials<'a> {
    candidates: &'a Candidates<'a>,
    /// Groups that take no part.
    without: &'a [u64],
    folds: Vec<Fold<'a>>,
    workers: Workers<'a>,
}

struct Fold<'a> {
    groups: Vec<u64>,
    held_out: Vec<&'a Observation>,
}

/// The model of a candidate without one fold, and its squared errors there for each λ.
type Judged = (Arc<PhysicsModel>, [f64; LAMBDAS.len()]);

impl Choice {
    /// Fits a model whose λ, prior width and number of factors are chosen by cross-validation.
    ///
    /// # Errors
    /// [`PhysicsError`] if there are too few observations, groups or channels; [`FitError::Interrupted`].
    pub fn fit(observations: &[Observation], workers: Workers<'_>) -> Result<Self, FitError> {
        Self::without(&[], &Candidates::new(observations), workers)
    }

    /// The same of the observations of all groups but some, in ascending order.
    pub(super) fn without(
        groups: &[u64],
        candidates: &Candidates<'_>,
        workers: Workers<'_>,
    ) -> Result<Self, FitError> {
        check(&candidates.observations(groups))?;
        let tries = Trials::new(candidates, groups, workers)?;
        let of_folds: Vec<Vec<Judged>> = tries.map(|fold| {
            let candidate = |width| Candidate { width, factors: 0 };
            (0..WIDTHS.len()).map(|width| tries.judge(fold, candidate(width))).collect()
        })?;
        let trials: Vec<Trial> = (WIDTHS.iter().enumerate())
            .flat_map(|(place, &width)| tries.scores(of_folds.iter().map(|of| &of[place]), width))
            .collect();
        let best = best(&trials);
        let mut chosen = Candidate { width: best / LAMBDAS.len(), factors: 0 };
        let mut judged: Vec<Judged> =
            of_folds.into_iter().map(|mut of| of.swap_remove(chosen.width)).collect();
        let mut lambda = trials[best].lambda;

        let mut factor_trials = Vec::new();
        let counts = if tries.folds.len() < FEWEST_FOLDS { 0..0 } else { 1..FACTORS + 1 };
        for factors in counts {
            let candidate = Candidate { factors, ..chosen };
            let of_folds = tries.map(|fold| tries.judge(fold, candidate))?;
            let trial = tries.compare(factors, &of_folds, &judged);
            factor_trials.push(trial);
            if !trial.is_taken() {
                break;
            }
            let scores = tries.scores(of_folds.iter(), WIDTHS[chosen.width]);
            lambda = scores[self::best(&scores)].lambda;
            (chosen, judged) = (candidate, of_folds);
        }

        let with_lambda = |model: PhysicsModel| PhysicsModel { lambda, ..model };
        let fold_model = |(fold, (model, _)): (Fold<'_>, Judged)| FoldModel {
            groups: fold.groups,
            model: with_lambda(Arc::unwrap_or_clone(model)),
        };
        Ok(Self {
            model: with_lambda(candidates.of_all(groups, chosen)),
            trials,
            factor_trials,
            fold_models: tries.folds.into_iter().zip(judged).map(fold_model).collect(),
        })
    }
}

impl<'a> Trials<'a> {
    fn new(
        candidates: &'a Candidates<'a>,
        without: &'a [u64],
        workers: Workers<'a>,
    ) -> Result<Self, FitError> {
        let fold = |groups: &Vec<u64>| {
            let mut groups = groups.clone();
            groups.retain(|group| !without.contains(group));
            let held_out = candidates.tried_of(&groups);
            (!held_out.is_empty()).then_some(Fold { groups, held_out })
        };
        let folds: Vec<Fold<'_>> = candidates.folds.iter().filter_map(fold).collect();
        if folds.len() < 2 {
            return Err(PhysicsError::TooFewGroups { found: folds.len() }.into());
        }
        Ok(Self { candidates, without, folds, workers })
    }

    /// What `work` makes of every fold, on all threads.
    fn map<T: Send>(&self, work: impl Fn(&Fold<'_>) -> T + Sync) -> Result<Vec<T>, FitError> {
        map(&self.folds, 0, self.workers, |fold| Ok(work(fold)))
    }

    /// A candidate without a fold, with its squared errors there.
    fn judge(&self, fold: &Fold<'_>, candidate: Candidate) -> Judged {
        let without = [self.without, &fold.groups].concat();
        let model = self.candidates.model(without, candidate);
        let mut inversion = Inversion::new(&model);
        let mut of_lambda = PhysicsModel::clone(&model);
        let square = |lambda| {
            of_lambda.lambda = lambda;
            inversion.set_prior(&of_lambda);
            relative_square(&model, &inversion, &fold.held_out)
        };
        let squares = LAMBDAS.map(square);
        (model, squares)
    }

    fn scores<'b>(&self, judged: impl Iterator<Item = &'b Judged>, width: f64) -> Vec<Trial> {
        let count = 6.0 * self.folds.iter().map(|fold| fold.held_out.len()).sum::<usize>() as f64;
        let mut sums = [0.0; LAMBDAS.len()];
        judged.for_each(|(_, squares)| sums.iter_mut().zip(squares).for_each(|(sum, s)| *sum += s));
        let trial = |(sum, lambda)| Trial { lambda, width, score: sum / count };
        sums.into_iter().zip(LAMBDAS).map(trial).collect()
    }

    /// How much more probable the readings of each fold are by the first of two models without it.
    fn compare(&self, factors: usize, judged: &[Judged], best: &[Judged]) -> FactorTrial {
        let gains: Vec<f64> = (self.folds.iter().zip(judged).zip(best))
            .map(|((fold, (model, _)), (best, _))| {
                let density = |model: &PhysicsModel| {
                    fold.held_out.iter().map(|o| model.ln_density(o)).sum::<f64>()
                };
                density(model) - density(best)
            })
            .collect();
        let count = gains.len() as f64;
        let gain = gains.iter().sum::<f64>() / count;
        let squares: f64 = gains.iter().map(|of| (of - gain).powi(2)).sum();
        FactorTrial { factors, gain, standard_error: (squares / (count * (count - 1.0))).sqrt() }
    }
}

/// The place of the least score.
fn best(trials: &[Trial]) -> usize {
    let scores = trials.iter().enumerate();
    scores.min_by(|a, b| a.1.score.total_cmp(&b.1.score)).map_or(0, |(place, _)| place)
}

/// The sum over observations and axes of squared errors in the model's scales.
fn relative_square(
    model: &PhysicsModel,
    inversion: &Inversion,
    observations: &[&Observation],
) -> f64 {
    let columns = |channel: usize| observations.iter().map(|o| o.readings[channel]).collect();
    let readings: Vec<Vec<f64>> = (0..model.channels).map(columns).collect();
    let estimates = inversion.estimates(&readings);
    let square = |(row, o): (usize, &&Observation)| {
        let relative =
            |axis: usize| (estimates.wrench[axis][row] - o.wrench[axis]) / model.wrench_scale[axis];
        (0..6).map(|axis| relative(axis).powi(2)).sum::<f64>()
    };
    observations.iter().enumerate().map(square).sum()
}
