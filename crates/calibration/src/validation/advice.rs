//! What held-out errors say to do: the model that predicts new groups best, the smallest that is as good
//! as far as one can tell, and what lies between them.
//!
//! Models are compared with each other on the same groups, by the [paired difference](super::comparison)
//! of their errors. How many times the error of a random split a model's error on new groups is says how
//! alike the rows of a group are, and nothing of which model to take.

use super::ValidationError;
use super::comparison::Comparison;
use super::grouped::GroupedMoments;
use super::selection::{Candidate, LARGEST_RIDGE, Selection, errors_by_fold};
use crate::model::Model;
use shell_data::wrench::Axis;

/// The models to choose from, and what the choice is worth.
#[derive(Clone, Debug, PartialEq)]
pub struct Advice {
    /// Folds of groups.
    pub folds: usize,
    /// The model that predicts new groups best.
    pub best: Candidate,
    /// The one with the fewest features within a standard error of it.
    pub cautious: Candidate,
    /// Errors of the cautious choice and of the best; `None` where they are one.
    pub caution: Option<Comparison>,
    /// The errors of the best and of the model that was asked for, where that is another.
    pub given: Option<Comparison>,
    /// Whether the best ridge is the largest that was tried, and a larger one may be better.
    pub ridge_is_at_limit: bool,
}

impl Advice {
    /// Of what was tried; `given` is the place of the model that was asked for.
    ///
    /// # Errors
    /// [`ValidationError`] if the models cannot be fitted to the groups.
    pub fn of(
        sums: &GroupedMoments,
        intercept: bool,
        selection: &Selection,
        given: Option<usize>,
    ) -> Result<Self, ValidationError> {
        let whole = sums.total().ok_or(ValidationError::NoModel)?;
        let variances = Axis::ALL.map(|axis| whole.variance(axis));
        let errors = |at: usize| {
            let candidate = &selection.candidates[at];
            let model = Model { basis: candidate.basis, intercept, channels: whole.channels() };
            errors_by_fold(sums, &model, candidate.ridge)?.ok_or(ValidationError::NoModel)
        };
        let compare = |first: usize, second: usize| -> Result<_, ValidationError> {
            match first == second {
                true => Ok(None),
                false => Ok(Some(Comparison::of(&errors(first)?, &errors(second)?, &variances))),
            }
        };
        let Selection { folds, candidates, best, chosen } = selection;
        Ok(Self {
            folds: *folds,
            best: candidates[*best].clone(),
            cautious: candidates[*chosen].clone(),
            caution: compare(*chosen, *best)?,
            given: given.map(|given| compare(*best, given)).transpose()?.flatten(),
            ridge_is_at_limit: candidates[*best].ridge >= LARGEST_RIDGE,
        })
    }

    /// Whether another model errs less on new groups than the one that was asked for, by more than a
    /// standard error of the paired difference.
    pub fn another_is_better(&self) -> bool {
        self.given.is_some_and(|given| given.all.first_is_better())
    }
}
