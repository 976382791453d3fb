//! Fits of candidates without some groups, each made once.
//!
//! A choice is judged on folds that were held out, and so is the whole procedure: without a fold of its own, and,
//! for the choice within, without one of the others. Without folds 3 and 5 the rest are the same whichever of them
//! was the outer one, so every such fit serves both. Fits without a group start from the fit to all, which is near; a
//! fit depends on what it is asked for alone, not on what was made before.

use std::collections::{BTreeSet, HashMap};
use std::sync::{Arc, Mutex, OnceLock};

use super::choice::{LAMBDAS, WIDTHS};
use super::factors::{fit_factors, fit_factors_from};
use super::fit::{Fitted, Scaled, Scales, fit, fit_from};
use super::model::PhysicsModel;
use super::observations::Observation;

/// Up to this many groups each is held out alone; more are dealt into [`FOLDS`] folds.
const MOST_ALONE: usize = 40;
const FOLDS: usize = 10;

/// Most observations that candidates are tried on.
const MOST_TRIED: usize = 600;

/// What is tried, λ aside, which takes no part in a fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Candidate {
    /// Its place in [`WIDTHS`].
    pub(super) width: usize,
    /// Shared factors.
    pub(super) factors: usize,
}

/// A candidate and the groups that it is fitted without, in ascending order.
type Key = (Vec<u64>, Candidate);

/// Observations, and the models that were fitted to them.
pub(super) struct Candidates<'a> {
    all: &'a [Observation],
    /// Few enough to try all candidates on.
    tried: Vec<&'a Observation>,
    /// Groups that are held out together.
    pub(super) folds: Vec<Vec<u64>>,
    made: Mutex<HashMap<Key, Arc<OnceLock<Arc<PhysicsModel>>>>>,
}

impl<'a> Candidates<'a> {
    pub(super) fn new(observations: &'a [Observation]) -> Self {
        // Neighbours in the order of cells resemble each other.
        let every = observations.len().div_ceil(MOST_TRIED).max(1);
        let tried: Vec<&Observation> = observations.iter().step_by(every).collect();
        Self { all: observations, folds: folds(&tried), tried, made: Mutex::default() }
    }

    /// All observations but those of some groups.
    pub(super) fn observations(&self, without: &[u64]) -> Vec<&'a Observation> {
        self.all.iter().filter(|o| !without.contains(&o.group)).collect()
    }

    /// Those of some groups on which candidates are tried.
    pub(super) fn tried_of(&self, groups: &[u64]) -> Vec<&'a Observation> {
        self.tried.iter().copied().filter(|o| groups.contains(&o.group)).collect()
    }

    /// A candidate, fitted to what it is tried on without some groups, with the least λ.
    pub(super) fn model(&self, mut without: Vec<u64>, of: Candidate) -> Arc<PhysicsModel> {
        without.sort_unstable();
        let place = {
            let mut made = self.made.lock().expect("no thread fails while it looks a fit up");
            made.entry((without.clone(), of)).or_default().clone()
        };
        place.get_or_init(|| Arc::new(self.fit(&without, of))).clone()
    }

    /// A candidate, fitted to all observations without some groups, with the least λ.
    pub(super) fn of_all(&self, without: &[u64], of: Candidate) -> PhysicsModel {
        let model = self.model(without.to_vec(), of);
        match self.tried.len() < self.all.len() {
            true => fit_near(&self.observations(without), of, &model)
                .unwrap_or_else(|| PhysicsModel::clone(&model)),
            false => Arc::unwrap_or_clone(model),
        }
    }

    fn fit(&self, without: &[u64], of: Candidate) -> PhysicsModel {
        let is_left = |o: &&Observation| !without.contains(&o.group);
        let observations: Vec<&Observation> = self.tried.iter().copied().filter(is_left).collect();
        let whole = (!without.is_empty()).then(|| self.model(Vec::new(), of));
        if let Some(model) = whole.and_then(|whole| fit_near(&observations, of, &whole)) {
            return model;
        }
        let (scales, data) = scaled(&observations);
        let width = WIDTHS[of.width];
        let fitted = match of.factors {
            0 => fit(&data, width),
            count => {
                let without_factors = Candidate { factors: 0, ..of };
                let start = self.model(without.to_vec(), without_factors);
                let start = Fitted::of_model(&start, &scales).expect("the same observations");
                fit_factors(&data, width, &start, count)
            }
        };
        model(&observations, (&scales, &data), &fitted, width)
    }
}

/// A candidate, fitted to nearly the observations of `start`; `None` if other channels vary in them.
fn fit_near(
    observations: &[&Observation],
    of: Candidate,
    start: &PhysicsModel,
) -> Option<PhysicsModel> {
    let (scales, data) = scaled(observations);
    let start = Fitted::of_model(start, &scales)?;
    let width = WIDTHS[of.width];
    let fitted = match of.factors {
        0 => fit_from(&data, width, &start),
        _ => fit_factors_from(&data, width, &start),
    };
    Some(model(observations, (&scales, &data), &fitted, width))
}

fn scaled(observations: &[&Observation]) -> (Scales, Scaled) {
    let scales = Scales::of(observations);
    let data = scales.apply(observations);
    (scales, data)
}

fn model(
    observations: &[&Observation],
    (scales, data): (&Scales, &Scaled),
    fitted: &Fitted,
    width: f64,
) -> PhysicsModel {
    let channels = observations.first().map_or(0, |o| o.readings.len());
    PhysicsModel::of_fit(channels, scales, data, fitted, (LAMBDAS[0], width))
}

/// Each group alone, or, of more than [`MOST_ALONE`], groups dealt in turn into [`FOLDS`].
fn folds(observations: &[&Observation]) -> Vec<Vec<u64>> {
    let groups: BTreeSet<u64> = observations.iter().map(|o| o.group).collect();
    let folds = if groups.len() > MOST_ALONE { FOLDS } else { groups.len() };
    let mut dealt = vec![Vec::new(); folds];
    for (place, group) in groups.into_iter().enumerate() {
        dealt[place % folds].push(group);
    }
    dealt
}
