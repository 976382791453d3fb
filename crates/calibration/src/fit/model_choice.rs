//! The model that was chosen, and what is known of it before it is fitted.

use std::ops::Range;

use crate::factored::FactoredGroups;
use crate::groups::{FoundGroups, GroupBy};
use crate::model::{Basis, Model};
use crate::validation::ValidationError;
use crate::validation::advice::Advice;
use crate::validation::cross_validation::CrossValidation;
use crate::validation::grouped::GroupedMoments;
use crate::validation::selection::Selection;
use shell_data::block::Block;
use shell_data::dataset::Dataset;

/// What standard errors by group are made of where exact sums do not serve the solver.
#[derive(Clone, Debug)]
pub(super) enum Clusters {
    /// R factors of the rows, and where groups are stretches of time those that are held out together.
    RFactors { rows: FactoredGroups, held_out_together: Option<Vec<Range<usize>>> },
    /// The rows with their labels, for a solver that clips them.
    Rows(Block),
}

/// The model that is to be fitted, and what is known of it before.
#[derive(Clone, Debug, Default)]
pub(super) struct ModelChoice {
    /// The family of features.
    pub(super) basis: Basis,
    /// λ of the ridge.
    pub(super) ridge: f64,
    /// How the family was chosen, where it was.
    pub(super) selection: Option<Selection>,
    /// Held-out errors, where they were asked for.
    pub(super) cross_validation: Option<CrossValidation>,
    /// What either says to do.
    pub(super) advice: Option<Advice>,
    /// The sums of the training rows, by group, where they were made.
    pub(super) sums: Option<GroupedMoments>,
    /// What standard errors by group are made of, where that is not the sums.
    pub(super) clusters: Option<Clusters>,
    /// What the groups are.
    pub(super) group_by: Option<GroupBy>,
    /// The rows that are used, with the labels of these groups.
    pub(super) labelled: Option<Dataset>,
    /// Whether the covariance is to come from the groups.
    pub(super) by_group: bool,
    /// Why it cannot, though there are groups.
    pub(super) not_grouped: Option<ValidationError>,
    /// Why there should be no covariance at all, unless it is asked for by name.
    pub(super) few_groups: Option<FewGroups>,
}

impl ModelChoice {
    /// Takes the model that was selected.
    pub(super) fn take(&mut self, selection: Selection) {
        let chosen = &selection.candidates[selection.chosen];
        (self.basis, self.ridge) = (chosen.basis, chosen.ridge);
        self.selection = Some(selection);
    }

    /// The groups that were found, where they are not given.
    pub(super) fn found_groups(&self) -> Option<FoundGroups> {
        let is_used = self.sums.is_some()
            || matches!(self.clusters, Some(Clusters::RFactors { .. }))
            || self.cross_validation.is_some();
        self.group_by.as_ref().filter(|_| is_used)?.found()
    }

    /// Whether groups are stretches of time, on average of half as many rows as the model has features: what each adds to
    /// the scatter of all is little then.
    pub(super) fn has_long_stretches(&self, groups: usize, rows: u64, model: &Model) -> bool {
        let are_long = 2 * rows >= (groups * model.term_count()) as u64;
        are_long && self.group_by.is_some_and(|by| by.is_stretches())
    }
}

/// More than half as many features as groups: whatever the rank, what the groups leave to tell errors
/// from is too little.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FewGroups {
    /// Features of the model.
    pub features: usize,
    /// Groups of rows.
    pub groups: usize,
}

impl FewGroups {
    /// Of a model with so many features; `None` where the groups are enough.
    pub fn new(features: usize, groups: usize) -> Option<Self> {
        (2 * features > groups).then_some(Self { features, groups })
    }
}
