//! λ and the width of the priors, by groups that were held out.
//!
//! Each candidate is fitted without a fold of whole groups and scored by its squared error on them,
//! relative to the mean square of each axis, averaged over the axes. The candidate of the least
//! score is chosen and fitted to all. Fits without a fold start from the fit to all, which is near.

use std::collections::BTreeMap;

use super::PhysicsError;
use super::fit::{fit, fit_from};
use super::inversion::Inversion;
use super::model::{PhysicsModel, check};
use super::observations::Observation;

/// The λ that are tried: half decades around a tenth of what Bayes' rule would take for normal loads.
pub const LAMBDAS: [f64; 5] = [0.01, 0.03, 0.1, 0.3, 1.0];

/// The widths that are tried.
pub const WIDTHS: [f64; 3] = [0.25, 0.5, 1.0];

/// Up to this many groups each is held out alone; more are dealt into [`FOLDS`] folds.
const MOST_ALONE: usize = 40;
const FOLDS: usize = 10;

/// Most observations that candidates are tried on.
const MOST_TRIED: usize = 600;

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

/// The chosen model and what it was chosen from.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// The model, fitted to all observations.
    pub model: PhysicsModel,
    /// All candidates, widths ascending, then λ.
    pub trials: Vec<Trial>,
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

impl Choice {
    /// Fits a model whose λ and prior width are chosen by cross-validation.
    ///
    /// # Errors
    /// [`PhysicsError`] if there are too few observations, groups or channels.
    pub fn fit(observations: &[Observation]) -> Result<Self, PhysicsError> {
        Self::of(&observations.iter().collect::<Vec<_>>())
    }

    fn of(observations: &[&Observation]) -> Result<Self, PhysicsError> {
        let (scales, channels) = check(observations)?;
        // Few enough to try all candidates on; neighbours in the order of cells resemble each other.
        let few = |every: usize| observations.iter().copied().step_by(every).collect::<Vec<_>>();
        let tried = few(observations.len().div_ceil(MOST_TRIED));
        let data = scales.apply(&tried);
        let folds = folds(&tried, MOST_ALONE);
        if folds.len() < 2 {
            return Err(PhysicsError::TooFewGroups { found: folds.len() });
        }
        let mut trials = Vec::with_capacity(WIDTHS.len() * LAMBDAS.len());
        let mut fits = Vec::with_capacity(WIDTHS.len());
        // One model for each candidate and fold.
        let mut models = vec![Vec::with_capacity(folds.len()); WIDTHS.len() * LAMBDAS.len()];
        for (width, models) in WIDTHS.into_iter().zip(models.chunks_mut(LAMBDAS.len())) {
            let whole = fit(&data, width);
            let mut squares = [0.0; LAMBDAS.len()];
            for fold in &folds {
                let rest = scales.apply(&fold.rest);
                let fitted = fit_from(&rest, width, &whole);
                let at = (LAMBDAS[0], width);
                let first = PhysicsModel::of_fit(channels, &scales, &rest, &fitted, at);
                // What takes long to make ready does not depend on λ.
                let mut inversion = Inversion::new(&first);
                let candidates = squares.iter_mut().zip(LAMBDAS).zip(&mut *models);
                for ((square, lambda), models) in candidates {
                    let model = PhysicsModel { lambda, ..first.clone() };
                    inversion.change_lambda(&model);
                    *square += relative_square(&inversion, &model, &fold.held_out);
                    models.push(model);
                }
            }
            let count = 6.0 * tried.len() as f64;
            let trial = |(square, lambda)| Trial { lambda, width, score: square / count };
            trials.extend(squares.into_iter().zip(LAMBDAS).map(trial));
            fits.push(whole);
        }
        let scores = || trials.iter().enumerate();
        let best = scores().min_by(|a, b| a.1.score.total_cmp(&b.1.score)).map_or(0, |(i, _)| i);
        let Trial { lambda, width, .. } = trials[best];
        let fitted = &fits[best / LAMBDAS.len()];
        let at = (lambda, width);
        let model = if tried.len() < observations.len() {
            let all = scales.apply(observations);
            let fitted = fit_from(&all, width, fitted);
            PhysicsModel::of_fit(channels, &scales, &all, &fitted, at)
        } else {
            PhysicsModel::of_fit(channels, &scales, &data, fitted, at)
        };
        let held_out = folds.iter().map(|fold| fold.groups.clone());
        let fold_models = held_out.zip(models.swap_remove(best));
        let fold_models = fold_models.map(|(groups, model)| FoldModel { groups, model }).collect();
        Ok(Self { model, trials, fold_models })
    }
}

struct Fold<'a> {
    groups: Vec<u64>,
    held_out: Vec<&'a Observation>,
    rest: Vec<&'a Observation>,
}

/// Each group alone, or, of more than `most_alone`, groups dealt in turn into [`FOLDS`].
fn folds<'a>(observations: &[&'a Observation], most_alone: usize) -> Vec<Fold<'a>> {
    let mut places = BTreeMap::new();
    observations.iter().for_each(|o| _ = places.insert(o.group, 0));
    let folds = if places.len() > most_alone { FOLDS } else { places.len() };
    places.values_mut().zip((0..folds).cycle()).for_each(|(place, fold)| *place = fold);
    let fold = |fold: usize| {
        let (held_out, rest) = observations.iter().partition(|o| places[&o.group] == fold);
        let groups = places.iter().filter(|(_, place)| **place == fold);
        Fold { groups: groups.map(|(group, _)| *group).collect(), held_out, rest }
    };
    (0..folds).map(fold).collect()
}

/// The sum over observations and axes of squared errors in the model's scales.
fn relative_square(
    inversion: &Inversion,
    model: &PhysicsModel,
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
