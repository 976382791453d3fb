//! Choice of the model before the fit, by held-out errors.

use std::ops::Range;

use super::options::{CovarianceRule, FitOptions, ModelRule};
use super::refits::{
    self, FOLDS, HeldOutFolds, MOST_ALONE, MOST_COMPARED, few_by_fold, select_by_normal_equations,
    sum_groups, sum_groups_or_sets,
};
use super::warning::{FewGroups, Warning};
use crate::groups::{
    FoundGroups, GroupBy, HeldOut, label_groups, label_poses, time_blocks_of_files,
};
use least_squares::error::FitError;
use least_squares::grouped_rows::GroupedRows;
use least_squares::grouped_rows::MAX_GROUPS;
use least_squares::model::{Basis, Model};
use least_squares::random_split::RandomSplit;
use least_squares::solver::SolverKind;
use least_squares::sums::GroupedSums;
use least_squares::validation::cross_validation::CrossValidation;
use least_squares::validation::grouped::{Apart, SumsByGroup};
use least_squares::validation::selection::{self, Advice, Selection};
use shell_data::dataset::{Dataset, RowSet};

/// Minimum number of groups for standard errors by group, unless these are requested explicitly.
const FEWEST_GROUPS: usize = 10;

#[derive(Clone, Debug, Default)]
pub(super) struct ModelChoice {
    pub(super) basis: Basis,
    pub(super) ridge: f64,
    pub(super) selection: Option<Selection>,
    pub(super) cross_validation: Option<CrossValidation>,
    pub(super) advice: Option<Advice>,
    /// Sums of the training rows by held-out group.
    pub(super) sums: Option<GroupedSums>,
    /// Sums for the covariance by group, if `sums` do not suit the solver or the groups.
    pub(super) own_sums: Option<GroupedSums>,
    /// Ranges of groups that the covariance holds out together, if the groups are blocks of time.
    pub(super) time_blocks: Option<Vec<Range<usize>>>,
    pub(super) group_by: Option<GroupBy>,
    pub(super) labelled: Option<Dataset>,
    pub(super) by_group: bool,
    /// Reason why the covariance cannot come from the groups, although there are some.
    pub(super) not_grouped: Option<FitError>,
    /// Reason for no covariance, unless it is requested explicitly.
    pub(super) few_groups: Option<FewGroups>,
}

impl ModelChoice {
    pub(super) fn take(&mut self, selection: Selection) {
        let chosen = &selection.candidates[selection.chosen];
        (self.basis, self.ridge) = (chosen.basis, chosen.ridge);
        self.selection = Some(selection);
    }

    pub(super) fn covariance_sums(&self) -> Option<&GroupedSums> {
        self.own_sums.as_ref().or(self.sums.as_ref())
    }

    pub(super) fn found_groups(&self) -> Option<FoundGroups> {
        let is_used = self.covariance_sums().is_some() || self.cross_validation.is_some();
        self.group_by.as_ref().filter(|_| is_used)?.found()
    }

    /// Holds out each block of time alone for the covariance, if blocks have, on average, at least half as many rows
    /// as the model has features: each then adds little to the scatter of all.
    fn set_time_blocks(&mut self, sums: &GroupedSums, model: &Model) {
        let groups = sums.groups();
        let are_long = 2 * sums.rows() >= (groups * model.term_count()) as u64;
        let are_time_blocks = self.group_by.is_some_and(|by| by.is_time_blocks());
        let each_alone = || (0..groups).map(|group| group..group + 1).collect();
        self.time_blocks = (are_long && are_time_blocks).then(each_alone);
    }

    /// Returns warnings about missing standard errors by group. `not_grouped` is the reason that the fit itself found.
    ///
    /// # Errors
    /// [`FitError::NoGroupCovariance`] if `rule` requests these errors explicitly.
    pub(super) fn group_warnings(
        &self,
        rule: CovarianceRule,
        not_grouped: Option<FitError>,
    ) -> Result<impl Iterator<Item = Warning> + use<>, FitError> {
        let reason = self.not_grouped.clone().or(not_grouped);
        let not_grouped = match (reason, rule) {
            (Some(reason), CovarianceRule::Groups) => {
                return Err(FitError::NoGroupCovariance(Box::new(reason)));
            }
            (reason, _) => reason.map(Warning::NotGrouped),
        };
        Ok(not_grouped.into_iter().chain(self.few_groups.map(Warning::FewGroups)))
    }
}

/// Rows and options of a fit. Groups are found in all training rows, before the rows to use are selected.
#[derive(Clone, Copy)]
pub(super) struct FitInput<'a> {
    pub(super) train: &'a Dataset,
    pub(super) excluded: &'a RowSet,
    pub(super) test: &'a Dataset,
    pub(super) options: &'a FitOptions<'a>,
}

impl FitInput<'_> {
    pub(super) fn used(&self) -> Dataset {
        self.train.select(self.options.fresh, self.excluded)
    }

    pub(super) fn labelled(&self, held_out: HeldOut) -> Option<(GroupBy, Dataset)> {
        self.select(label_groups(self.train, held_out))
    }

    fn select(&self, labelled: Option<(GroupBy, Dataset)>) -> Option<(GroupBy, Dataset)> {
        labelled.map(|(by, data)| (by, data.select(self.options.fresh, self.excluded)))
    }
}

/// Chooses and validates the model, and finds the groups within which errors are alike, as far as requested.
///
/// | step | rows that sum exactly | other rows, or memory terms |
/// | --- | --- | --- |
/// | family of features | exact sums, whatever the solver | normal equations by fold: three digits are enough |
/// | held-out errors | exact sums, if the solver is exact or the family was chosen | R factors by fold; Huber's estimator fits again |
/// | covariance by group | exact sums, if the solver is exact | the rows, once the solution is known |
///
/// Solvers other than the exact one follow the last column of the table for all rows, except to choose the family.
/// If files of motion were held out, the covariance comes from blocks of time in these files.
///
/// # Errors
/// [`FitError`] if rows cannot be summed, or there are no groups to hold out.
pub(super) fn choose(input: FitInput<'_>) -> Result<ModelChoice, FitError> {
    let options = input.options;
    let validates = options.validates();
    if options.basis().is_none() && input.train.has_weights() {
        return Err(FitError::Weights("the choice of a model"));
    }
    let labelled = match validates || options.covariance == CovarianceRule::Groups {
        _ if input.train.has_weights() => None,
        true => input.labelled(options.held_out()),
        false if options.covariance != CovarianceRule::Auto => None,
        false => input.select(label_poses(input.train)),
    };
    let (group_by, labelled) = labelled.unzip();
    let mut choice = options.open(group_by);
    choice.labelled = labelled;
    if !validates && !choice.by_group {
        return Ok(choice);
    }
    let rows = choice.labelled.clone().ok_or(FitError::NoGroups)?;
    let known = match options.basis() {
        Some(_) => None,
        None => options.choose_family(&mut choice, &rows)?,
    };
    match options.sum(&choice, &rows) {
        Ok(Some(sums)) => choice = options.decide(choice, GroupedSums::Exact(Box::new(sums)))?,
        Ok(None) if validates => {
            options.workers.start("errors on held-out groups");
            let model = (choice.basis, choice.ridge);
            let found = refits::cross_validate(&rows, options.held_out(), model, known, options)?;
            choice.cross_validation = Some(found);
        }
        Ok(None) => {}
        Err(reason) if !validates && reason.is_about_groups() => {
            choice.not_grouped = Some(reason);
            return Ok(choice);
        }
        Err(reason) => return Err(reason),
    }
    let sums_serve = options.solver == SolverKind::Exact && choice.sums.is_some();
    if choice.by_group && !sums_serve {
        options.keep_for_solver(&mut choice, &rows);
    }
    options.keep_time_blocks_of_files(&mut choice);
    Ok(choice)
}

impl FitOptions<'_> {
    pub(super) fn validates(&self) -> bool {
        self.basis().is_none() || self.cross_validation.is_some()
    }

    /// Groups on which held-out errors are computed; always some if the model is chosen.
    pub(super) fn validation(&self) -> Option<HeldOut> {
        self.cross_validation.or_else(|| (self.model == ModelRule::Auto).then_some(HeldOut::Auto))
    }

    /// Groups to hold out. A fit to means always uses those of a column, unless folds are requested.
    pub(super) fn held_out(&self) -> HeldOut {
        match self.validation() {
            Some(HeldOut::Folds(folds)) => HeldOut::Folds(folds),
            _ if self.means => HeldOut::Column,
            held_out => held_out.unwrap_or(HeldOut::Auto),
        }
    }

    /// Number of folds; `None` if each of the `groups` is held out alone.
    pub(super) fn folds(&self, groups: usize) -> Option<usize> {
        match self.cross_validation {
            Some(HeldOut::Folds(folds)) => Some(folds),
            None if self.model == ModelRule::Auto && groups > MAX_GROUPS => Some(selection::FOLDS),
            _ => None,
        }
    }

    pub(super) fn open(&self, group_by: Option<GroupBy>) -> ModelChoice {
        let by_group = match self.covariance {
            CovarianceRule::Groups => true,
            CovarianceRule::Auto => {
                group_by.as_ref().is_some_and(|by| by.is_poses() || by.is_time_blocks())
            }
            CovarianceRule::Rows | CovarianceRule::Nothing => false,
        };
        ModelChoice {
            basis: self.basis().unwrap_or(Basis::Poly3),
            ridge: self.ridge,
            by_group,
            group_by,
            ..ModelChoice::default()
        }
    }

    /// Chooses the family by folds of groups, on some rows of each group. Uses exact sums if possible, whatever the
    /// fit's solver; otherwise it also returns the errors on each fold, unless rows were left out.
    fn choose_family(
        &self,
        choice: &mut ModelChoice,
        rows: &Dataset,
    ) -> Result<Option<HeldOutFolds>, FitError> {
        self.workers.start("choice of the polynomial");
        let few = few_by_fold(&GroupedRows::from_labels(rows).0, MOST_COMPARED)?.to_dataset();
        let apart = (Apart::Groups, RandomSplit::default());
        match sum_groups(&few, choice.basis, apart, self.workers) {
            Ok(sums) => {
                self.select(choice, &GroupedSums::Exact(Box::new(sums)))?;
                Ok(None)
            }
            Err(FitError::NotExact(_)) => {
                let (selection, errors) = select_by_normal_equations(rows, self)?;
                choice.take(selection);
                Ok(errors)
            }
            Err(reason) => Err(reason),
        }
    }

    /// Exact sums by group; `None` if the solver has no use for them, or if the rows cannot be summed exactly.
    fn sum(&self, choice: &ModelChoice, rows: &Dataset) -> Result<Option<SumsByGroup>, FitError> {
        if self.basis().is_some() && self.solver != SolverKind::Exact {
            return Ok(None);
        }
        self.workers.start("sums by group");
        match sum_groups_or_sets(rows, choice.basis, self) {
            Err(FitError::NotExact(_)) => Ok(None),
            sums => sums.map(Some),
        }
    }

    pub(super) fn decide(
        &self,
        mut choice: ModelChoice,
        sums: GroupedSums,
    ) -> Result<ModelChoice, FitError> {
        let model = self.model_without_memory(choice.basis, sums.channels());
        self.test_group_count(&mut choice, &model, sums.groups());
        if self.validation().is_some() {
            self.workers.start("errors on held-out groups");
            let folds = self.folds(sums.group_count());
            choice.cross_validation = Some(sums.cross_validate(&model, choice.ridge, folds)?);
            if choice.advice.is_none() {
                choice.advice = sums.advice(&model, choice.ridge)?;
            }
        }
        choice.set_time_blocks(&sums, &model);
        choice.sums = Some(sums);
        Ok(choice)
    }

    pub(super) fn model_without_memory(&self, basis: Basis, channels: usize) -> Model {
        Model { basis, intercept: self.intercept, channels, memory: 0 }
    }

    pub(super) fn model_of(&self, data: &Dataset, basis: Basis) -> Model {
        let (channels, memory) = (data.channels(), data.memory_terms());
        Model { basis, intercept: self.intercept, channels, memory }
    }

    pub(super) fn select(
        &self,
        choice: &mut ModelChoice,
        sums: &GroupedSums,
    ) -> Result<(), FitError> {
        let (selection, advice) = sums.select(self.intercept, self.ridges())?;
        choice.advice = advice;
        choice.take(selection);
        Ok(())
    }

    pub(super) fn ridges(&self) -> &[f64] {
        if self.ridge > 0.0 { std::slice::from_ref(&self.ridge) } else { &selection::RIDGES }
    }

    /// Takes standard errors and intervals from blocks of time, if files of motion were held out.
    fn keep_time_blocks_of_files(&self, choice: &mut ModelChoice) {
        let is_served = self.validates()
            && self.covariance == CovarianceRule::Auto
            && self.solver != SolverKind::Huber
            && choice.group_by == Some(GroupBy::File);
        let Some(rows) = choice.labelled.as_ref().filter(|_| is_served) else { return };
        let Some((rows, files)) = time_blocks_of_files(rows) else { return };
        let most = files.len().div_ceil(FOLDS);
        choice.time_blocks = Some(match files.len() {
            0..=MOST_ALONE => files,
            _ => files.chunks(most).map(|of| of[0].start..of[of.len() - 1].end).collect(),
        });
        choice.by_group = true;
        choice.own_sums = Some(rows_by_group(&rows));
    }

    /// Keeps rows by group for the solver's standard errors, because it cannot use the sums of the held-out groups.
    fn keep_for_solver(&self, choice: &mut ModelChoice, rows: &Dataset) {
        let (sums, model) = (rows_by_group(rows), self.model_of(rows, choice.basis));
        self.test_group_count(choice, &model, sums.groups());
        choice.set_time_blocks(&sums, &model);
        choice.own_sums = Some(sums);
    }

    /// Tests whether this number of groups can show the scatter of the coefficients of `model`.
    fn test_group_count(&self, choice: &mut ModelChoice, model: &Model, groups: usize) {
        // A few groups say little about how groups scatter.
        choice.by_group &= self.covariance != CovarianceRule::Auto || groups >= FEWEST_GROUPS;
        let is_poses = choice.group_by.as_ref().is_some_and(GroupBy::is_poses);
        if self.covariance == CovarianceRule::Auto && is_poses {
            choice.few_groups = FewGroups::new(model.term_count(), groups);
        }
    }
}

fn rows_by_group(data: &Dataset) -> GroupedSums {
    let (rows, labels) = GroupedRows::from_labels(data);
    GroupedSums::Rows(rows, labels)
}
