//! What held-out errors say to do: the model that predicts new groups best, the smallest that is as good
//! as far as one can tell, and what lies between them.
//!
//! Models are compared with each other on the same groups, by the [ratio](super::comparison) of their errors. How many
//! times the error of a random split a model's error on new groups is says how alike the rows of a group are, and
//! nothing of which model to take.

use super::comparison::Comparison;
use super::selection::{Candidate, LARGEST_RIDGE, Selection, Tried};
use crate::model::Basis;
use crate::quality::significant;
use shell_data::wrench::{Axes, Axis};

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
    /// Of what was tried; `given` is the position of the model that was asked for.
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

    /// Whether another model errs less on new groups than the one that was asked for, by more than a
    /// standard error of the ratio.
    pub fn another_is_better(&self) -> bool {
        self.given.is_some_and(|given| given.all.first_is_better())
    }

    /// Which model is best on new groups, and which is the cautious choice.
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

    /// The model that predicts new groups better than the one that was asked for, if there is one.
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

/// The model and its ridge.
fn name(of: &Candidate) -> String {
    match of.ridge > 0.0 {
        true => format!("{} with ridge {:e}", of.basis.name(), of.ridge),
        false => of.basis.name().to_owned(),
    }
}

/// The errors of the second of two models and of the first.
fn worth(comparison: &Comparison, axes: Axes) -> String {
    let of = |axis: Axis| {
        let [first, second] = comparison.rms.map(|rms| significant(rms[axis.index()], 3));
        format!("{} {second} → {first} {}", axis.name(), axis.unit())
    };
    axes.iter().map(of).collect::<Vec<_>>().join(", ")
}
