//! What is known before the fit: the model, held-out errors, sums by group. One pass over the logs,
//! where any of it is asked for.

use anyhow::Context;
use calibration::solver::SolverKind;
use calibration::validation::ValidationError;
use calibration::validation::cross_validation::{CrossValidation, cross_validate};
use calibration::validation::grouped::{GroupedMoments, RandomSplit};
use calibration::validation::selection::{self, Selection};
use calibration::{Basis, FitError, Model};
use log_file::{Log, ReadOptions};
use shellcal::workflow::WorkflowError;
use shellcal::workflow::moments::{self, GroupBy, SumOptions};

use super::super::choices::ModelChoice;
use super::super::validation::CvArg;
use super::{CovarianceArg, FitArgs};
use crate::printer::Printer;

/// The model that is fitted, and what is known of it before.
#[derive(Debug)]
pub(super) struct Choice {
    pub(super) basis: Basis,
    pub(super) ridge: f64,
    pub(super) selection: Option<Selection>,
    pub(super) cross_validation: Option<CrossValidation>,
    /// The sums of the training rows, by group, where they were made.
    pub(super) sums: Option<GroupedMoments>,
    /// Whether the covariance is to come from the groups.
    pub(super) by_group: bool,
    /// Why it cannot, though there are groups.
    pub(super) not_grouped: Option<ValidationError>,
}

/// Folds of the random split that `--cv` compares with, where it does not say how many.
const RANDOM_FOLDS: usize = 10;

/// Folds of it that are held out.
const HELD_OUT: usize = 2;

/// The fewest groups that standard errors come from unless they are asked for by name.
const FEWEST_GROUPS: usize = 10;

impl FitArgs {
    /// Chooses the model, validates it, and sums by group: as much of it as is asked for.
    pub(super) fn choose(&self, train: &[Log], printer: &mut Printer) -> anyhow::Result<Choice> {
        let given = match self.model {
            ModelChoice::Given(basis) => Some(basis),
            ModelChoice::Auto => None,
        };
        let mut choice = Choice {
            basis: given.unwrap_or(Basis::Poly3),
            ridge: self.ridge,
            selection: None,
            cross_validation: None,
            sums: None,
            by_group: false,
            not_grouped: None,
        };
        let validates = given.is_none() || self.cv.is_some();
        let (group_by, folds) = match self.cv {
            Some(CvArg::File) => (Some(GroupBy::File), None),
            Some(CvArg::Column) => (Some(GroupBy::Column), None),
            Some(CvArg::Folds(folds)) => (moments::group_by(train), Some(folds)),
            Some(CvArg::Auto) | None => (moments::group_by(train), None),
        };
        choice.by_group = self.wants_groups(group_by);
        if !validates && !choice.by_group {
            return Ok(choice);
        }
        let group_by = group_by.context(
            "there is nothing to hold out: give several logs, or logs with a group column \
             (`--group`)",
        )?;
        let sums = match self.sum(train, choice.basis, group_by, folds, printer) {
            // Better standard errors were not asked for by name.
            Err(WorkflowError::Fit(FitError::NotExact(reason))) if !validates => {
                choice.not_grouped = Some(reason.into());
                return Ok(choice);
            }
            Err(WorkflowError::Validation(reason)) if !validates => {
                choice.not_grouped = Some(reason);
                return Ok(choice);
            }
            sums => sums?,
        };
        // A few groups say little about how groups scatter.
        choice.by_group &=
            !matches!(self.covariance, CovarianceArg::Auto) || sums.groups.len() >= FEWEST_GROUPS;
        let intercept = !self.no_intercept;
        if given.is_none() {
            let ridges = if self.ridge > 0.0 { &[self.ridge][..] } else { &selection::RIDGES };
            let selection = selection::select(&sums, intercept, ridges)?;
            let chosen = &selection.candidates[selection.chosen];
            (choice.basis, choice.ridge) = (chosen.basis, chosen.ridge);
            choice.selection = Some(selection);
        }
        if self.cv.is_some() {
            let channels = train.first().map_or(0, Log::channels);
            let model = Model { basis: choice.basis, intercept, channels };
            choice.cross_validation = Some(cross_validate(&sums, &model, choice.ridge, folds)?);
        }
        choice.sums = Some(sums);
        Ok(choice)
    }

    /// Whether the covariance is to come from groups, if those are `group_by`.
    fn wants_groups(&self, group_by: Option<GroupBy>) -> bool {
        self.wants_covariance()
            && match self.covariance {
                CovarianceArg::Groups => true,
                CovarianceArg::Auto => {
                    group_by == Some(GroupBy::Column) && self.solver.0 == SolverKind::Exact
                }
                CovarianceArg::Rows | CovarianceArg::None => false,
            }
    }

    fn sum(
        &self,
        train: &[Log],
        basis: Basis,
        group_by: GroupBy,
        folds: Option<usize>,
        printer: &Printer,
    ) -> Result<GroupedMoments, WorkflowError> {
        let bar = printer.progress("groups", train.iter().map(Log::bytes).sum());
        let progress = |bytes| bar.set_position(bytes);
        let random = self.cv.map_or_else(RandomSplit::default, |_| {
            let folds = folds.unwrap_or(RANDOM_FOLDS);
            RandomSplit { folds, held_out: folds.min(HELD_OUT), seed: self.cv_seed }
        });
        let options = SumOptions {
            basis,
            group_by,
            random,
            fresh: self.fresh,
            read: ReadOptions { progress: Some(&progress), ..self.mapping.read_options() },
        };
        let sums = moments::sum(train, &options);
        bar.finish_and_clear();
        Ok(sums?.0)
    }
}
