//! Chooses what is fitted: the model, its held-out errors, and how rows err together; and what is then known of the
//! model before it is fitted.

use std::ops::Range;

use super::options::{CovarianceRule, FitOptions, ModelRule};
use super::refits::{
    self, FOLDS, MOST_ALONE, MOST_COMPARED, few_by_fold, rows_in_one, select_by_normal_equations,
    sum_groups, sum_groups_or_sets,
};
use crate::groups::{FoundGroups, GroupBy, HeldOut, label_groups, label_poses, stretches_of_files};
use least_squares::error::FitError;
use least_squares::exact::ExactSums;
use least_squares::factored::FactoredGroups;
use least_squares::grouped_rows::GroupedRows;
use least_squares::grouped_rows::MAX_GROUPS;
use least_squares::model::{Basis, Model};
use least_squares::random_split::RandomSplit;
use least_squares::scaling::Scaling;
use least_squares::solver::SolverKind;
use least_squares::validation::cross_validation::{CrossValidation, cross_validate};
use least_squares::validation::grouped::{Apart, SumsByGroup};
use least_squares::validation::selection::{self, Advice, Candidate, Selection};
use shell_data::block::Block;
use shell_data::dataset::{Dataset, RowSet};

/// The fewest groups that standard errors come from unless they are asked for by name.
const FEWEST_GROUPS: usize = 10;

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
    pub(super) sums: Option<SumsByGroup>,
    /// What standard errors by group are made of, where that is not the sums.
    pub(super) clusters: Option<Clusters>,
    /// What the groups are.
    pub(super) group_by: Option<GroupBy>,
    /// The rows that are used, with the labels of these groups.
    pub(super) labelled: Option<Dataset>,
    /// Whether the covariance is to come from the groups.
    pub(super) by_group: bool,
    /// Why it cannot, though there are groups.
    pub(super) not_grouped: Option<FitError>,
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

/// What is fitted, and how. Of the training rows those that are used are selected when they have been labelled: groups
/// are found in all rows.
#[derive(Clone, Copy)]
pub(super) struct FitInput<'a> {
    pub(super) train: &'a Dataset,
    pub(super) excluded: &'a RowSet,
    pub(super) test: &'a Dataset,
    pub(super) options: &'a FitOptions<'a>,
}

impl FitInput<'_> {
    /// The rows that are used.
    pub(super) fn used(&self) -> Dataset {
        self.train.select(self.options.fresh, self.excluded)
    }

    /// The same labelled by what can be held out.
    pub(super) fn labelled(&self, held_out: HeldOut) -> Option<(GroupBy, Dataset)> {
        self.select(label_groups(self.train, held_out))
    }

    fn select(&self, labelled: Option<(GroupBy, Dataset)>) -> Option<(GroupBy, Dataset)> {
        labelled.map(|(by, data)| (by, data.select(self.options.fresh, self.excluded)))
    }
}

/// Chooses the model, validates it, and finds how rows err together: as much of it as is asked for.
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
    if options.basis().is_none() {
        options.choose_family(&mut choice, &rows)?;
    }
    match options.sum(&choice, &rows) {
        Ok(Some(sums)) => choice = options.decide(choice, sums)?,
        Ok(None) if validates => {
            let model = (choice.basis, choice.ridge);
            let found = refits::cross_validate(&rows, options.held_out(), model, options)?;
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
        choice = options.cluster(choice, &rows)?;
    }
    options.cluster_files(&mut choice)?;
    Ok(choice)
}

impl FitOptions<'_> {
    /// Whether it takes groups to answer what is asked.
    pub(super) fn validates(&self) -> bool {
        self.basis().is_none() || self.cross_validation.is_some()
    }

    /// What errors are found on, if they are: a model that is chosen is judged, too.
    pub(super) fn validation(&self) -> Option<HeldOut> {
        self.cross_validation.or_else(|| (self.model == ModelRule::Auto).then_some(HeldOut::Auto))
    }

    /// What is held out: of means, that is always a column.
    pub(super) fn held_out(&self) -> HeldOut {
        match self.validation() {
            Some(HeldOut::Folds(folds)) => HeldOut::Folds(folds),
            _ if self.means => HeldOut::Column,
            held_out => held_out.unwrap_or(HeldOut::Auto),
        }
    }

    /// How many folds errors are found on, where it is not each of so many groups.
    pub(super) fn folds(&self, groups: usize) -> Option<usize> {
        match self.cross_validation {
            Some(HeldOut::Folds(folds)) => Some(folds),
            None if self.model == ModelRule::Auto && groups > MAX_GROUPS => Some(selection::FOLDS),
            _ => None,
        }
    }

    /// What is asked for, before anything is known.
    pub(super) fn open(&self, group_by: Option<GroupBy>) -> ModelChoice {
        let by_group = match self.covariance {
            CovarianceRule::Groups => true,
            CovarianceRule::Auto => {
                group_by.as_ref().is_some_and(|by| by.is_poses() || by.is_stretches())
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

    /// Chooses the family of features by folds of groups, on some of the rows of each: by exact sums wherever there are
    /// any, whatever solver then fits it.
    fn choose_family(&self, choice: &mut ModelChoice, rows: &Dataset) -> Result<(), FitError> {
        let few = few_by_fold(&GroupedRows::from_labels(rows).0, MOST_COMPARED)?.to_dataset();
        let apart = (Apart::Groups, RandomSplit::default());
        match sum_groups(&few, choice.basis, apart, self.workers) {
            Ok(sums) => self.select(choice, &sums),
            Err(FitError::NotExact(_)) => {
                choice.take(select_by_normal_equations(rows, self)?);
                Ok(())
            }
            Err(reason) => Err(reason),
        }
    }

    /// The exact sums of the rows by group, if they tell anything of what is asked and the rows can be summed so.
    fn sum(&self, choice: &ModelChoice, rows: &Dataset) -> Result<Option<SumsByGroup>, FitError> {
        if self.basis().is_some() && self.solver != SolverKind::Exact {
            return Ok(None);
        }
        match sum_groups_or_sets(rows, choice.basis, self) {
            Err(FitError::NotExact(_)) => Ok(None),
            sums => sums.map(Some),
        }
    }

    /// Adds to a choice the errors and the advice that sums by group give.
    pub(super) fn decide(
        &self,
        mut choice: ModelChoice,
        sums: SumsByGroup,
    ) -> Result<ModelChoice, FitError> {
        let channels = sums.total().map_or(0, ExactSums::channels);
        let model = self.model_without_memory(choice.basis, channels);
        self.test_group_count(&mut choice, &model, sums.groups.len());
        if self.validation().is_some() {
            let found = cross_validate(&sums, &model, choice.ridge, self.folds(sums.group_count))?;
            choice.cross_validation = Some(found);
            if choice.advice.is_none() {
                choice.advice = advice(&sums, &model, choice.ridge)?;
            }
        }
        choice.sums = Some(sums);
        Ok(choice)
    }

    pub(super) fn model_without_memory(&self, basis: Basis, channels: usize) -> Model {
        Model { basis, intercept: self.intercept, channels, memory: 0 }
    }

    /// A model of the rows of a data set.
    pub(super) fn model_of(&self, data: &Dataset, basis: Basis) -> Model {
        let (channels, memory) = (data.channels(), data.memory_terms());
        Model { basis, intercept: self.intercept, channels, memory }
    }

    /// Chooses the family of features, and the ridge, by groups that are held out.
    pub(super) fn select(
        &self,
        choice: &mut ModelChoice,
        sums: &SumsByGroup,
    ) -> Result<(), FitError> {
        let tried = selection::select(sums, self.intercept, self.ridges())?;
        choice.advice = Some(Advice::new(&tried, None));
        choice.take(tried.selection);
        Ok(())
    }

    /// The ridges that are tried.
    pub(super) fn ridges(&self) -> &[f64] {
        if self.ridge > 0.0 { std::slice::from_ref(&self.ridge) } else { &selection::RIDGES }
    }

    /// Adds to a choice the R factors that standard errors come from.
    pub(super) fn decide_by_r_factors(
        &self,
        mut choice: ModelChoice,
        rows: FactoredGroups,
        model: &Model,
    ) -> ModelChoice {
        self.test_group_count(&mut choice, model, rows.groups.len());
        let each_alone = || (0..rows.groups.len()).map(|group| group..group + 1).collect();
        let all_rows = rows.groups.iter().map(|(_, rows)| rows.rows()).sum();
        let are_long = choice.has_long_stretches(rows.groups.len(), all_rows, model);
        let held_out_together = are_long.then(each_alone);
        choice.clusters = Some(Clusters::RFactors { rows, held_out_together });
        choice
    }

    /// The R factors of labelled rows by group. Where they cannot be had, `choice` knows why: better standard errors were
    /// not asked for by name.
    fn factor_groups(
        &self,
        choice: &mut ModelChoice,
        data: &Dataset,
    ) -> Result<Option<FactoredGroups>, FitError> {
        let model = Model { intercept: true, ..self.model_of(data, choice.basis) };
        model.check_size()?;
        let sample = data.logs.first().map_or(&[][..], |log| &log.sample.readings);
        let by = (model, Scaling::from_sample(sample, true));
        let (rows, labels) = GroupedRows::from_labels(data);
        match FactoredGroups::from_rows(&rows, labels, by, self.workers) {
            Err(reason) if reason.is_about_groups() => {
                (choice.by_group, choice.not_grouped) = (false, Some(reason));
                Ok(None)
            }
            rows => rows.map(Some),
        }
    }

    /// Where files of motion were held out, standard errors and intervals come from stretches of these.
    fn cluster_files(&self, choice: &mut ModelChoice) -> Result<(), FitError> {
        let is_served = self.validates()
            && self.covariance == CovarianceRule::Auto
            && self.solver != SolverKind::Huber
            && choice.group_by == Some(GroupBy::File);
        let Some(rows) = choice.labelled.as_ref().filter(|_| is_served) else { return Ok(()) };
        let Some((rows, files)) = stretches_of_files(rows) else { return Ok(()) };
        let most = files.len().div_ceil(FOLDS);
        let held_out_together = Some(match files.len() {
            0..=MOST_ALONE => files,
            _ => files.chunks(most).map(|of| of[0].start..of[of.len() - 1].end).collect(),
        });
        choice.by_group = true;
        let rows = self.factor_groups(choice, &rows)?;
        choice.clusters = rows.map(|rows| Clusters::RFactors { rows, held_out_together });
        Ok(())
    }

    /// Keeps the labelled rows as the solver's standard errors by group need them.
    fn cluster(&self, mut choice: ModelChoice, rows: &Dataset) -> Result<ModelChoice, FitError> {
        if self.solver != SolverKind::Huber {
            let model = self.model_of(rows, choice.basis);
            return Ok(match self.factor_groups(&mut choice, rows)? {
                Some(rows) => self.decide_by_r_factors(choice, rows, &model),
                None => choice,
            });
        }
        let model = self.model_without_memory(choice.basis, rows.channels());
        self.test_group_count(&mut choice, &model, GroupedRows::from_labels(rows).1.len());
        choice.clusters = Some(Clusters::Rows(rows_in_one(rows)));
        Ok(choice)
    }

    /// Whether so many groups can tell how the coefficients of `model` scatter.
    fn test_group_count(&self, choice: &mut ModelChoice, model: &Model, groups: usize) {
        // A few groups say little about how groups scatter.
        choice.by_group &= self.covariance != CovarianceRule::Auto || groups >= FEWEST_GROUPS;
        let is_poses = choice.group_by.as_ref().is_some_and(GroupBy::is_poses);
        if self.covariance == CovarianceRule::Auto && is_poses {
            choice.few_groups = FewGroups::new(model.term_count(), groups);
        }
    }
}

/// What to say of the model that was asked for beside the smaller ones that the same sums serve; `None`
/// if there is none, or it cannot be fitted without one of the folds.
fn advice(sums: &SumsByGroup, model: &Model, ridge: f64) -> Result<Option<Advice>, FitError> {
    let tried = selection::select(sums, model.intercept, &[ridge])?;
    let candidates = &tried.selection.candidates;
    let is_given =
        |candidate: &Candidate| candidate.basis == model.basis && candidate.errors.is_some();
    let given = candidates.iter().position(is_given).filter(|_| candidates.len() > 1);
    Ok(given.map(|given| Advice::new(&tried, Some(given))))
}
