//! What is known before a fit: the model, its held-out errors, the sums by group. One pass over the
//! logs, where any of it is asked for.

use std::collections::HashSet;

use super::WorkflowError;
use super::factored::{Factored, factor, grouped_rows};
pub use super::groups::HeldOut;
use super::groups::{self, FoundGroups, FoundSummary, GroupBy};
use super::log_facts::{Gathering, LogFacts};
use super::log_rows::may_exceed;
use super::moments::{self, SumOptions, Sums};
use super::selection::UsedRows;
use super::uncertainty::{CovarianceFrom, GroupsKept};
use calibration::exact::Moments;
use calibration::factored::FactoredGroups;
use calibration::solver::SolverKind;
use calibration::validation::ValidationError;
use calibration::validation::advice::Advice;
use calibration::validation::cross_validation::{CrossValidation, cross_validate};
use calibration::validation::grouped::{Apart, GroupedMoments, RandomSplit};
use calibration::validation::selection::{self, Selection};
use calibration::{Basis, FitError, Model};
use log_file::{Log, ReadOptions};
use shell_data::block::Block;

/// Folds of the random split that held-out errors are compared with, where no number is given.
pub const RANDOM_FOLDS: usize = 10;

/// Folds of it that are held out.
const HELD_OUT: usize = 2;

/// The fewest groups that standard errors come from unless they are asked for by name.
const FEWEST_GROUPS: usize = 10;

/// The random split into so many folds, two of which are held out.
pub fn random_split(folds: usize, seed: u64) -> RandomSplit {
    RandomSplit { folds, held_out: folds.min(HELD_OUT), seed }
}

/// What the covariance of the coefficients is found from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CovarianceRule {
    /// By the log's group column or its plateaus where there are ten at least, by rows otherwise.
    Auto,
    /// Errors are alike within groups: those of the group column, files, or those that are found.
    Groups,
    /// Errors are independent from row to row.
    Rows,
    /// None is wanted.
    Nothing,
}

/// What is asked for.
#[derive(Clone, Copy)]
pub struct ModelChoiceOptions<'a> {
    /// The family of features; `None` for the smallest that predicts new groups as well as the best.
    pub basis: Option<Basis>,
    /// Whether there is a constant beside them.
    pub intercept: bool,
    /// λ of a ridge on columns of norm one; 0 for none, or for the best of several where the family
    /// is chosen.
    pub ridge: f64,
    /// The solver of the fit.
    pub solver: SolverKind,
    /// Find the errors on rows that were held out.
    pub cross_validation: Option<HeldOut>,
    /// Which way rows are dealt into the random folds that those are compared with.
    pub seed: u64,
    /// What the covariance is found from.
    pub covariance: CovarianceRule,
    /// Which rows of the training logs are used.
    pub used: UsedRows<'a>,
    /// The memory that rows may take in the fit, see [`FitOptions::memory`](super::fit::FitOptions::memory).
    pub memory: u64,
    /// How logs are read.
    pub read: ReadOptions<'a>,
}

/// The model that is to be fitted, and what is known of it before.
#[derive(Debug)]
pub struct ModelChoice {
    /// The family of features.
    pub basis: Basis,
    /// λ of the ridge.
    pub ridge: f64,
    /// How the family was chosen, where it was.
    pub selection: Option<Selection>,
    /// Held-out errors, where they were asked for.
    pub cross_validation: Option<CrossValidation>,
    /// What either says to do.
    pub advice: Option<Advice>,
    /// The sums of the training rows, by group, where they were made.
    pub sums: Option<GroupedMoments>,
    /// The training rows by group, where standard errors are to come from groups and there are no sums that
    /// serve the solver.
    pub factored: Option<FactoredGroups>,
    /// These rows as they are, where the solver clips them.
    pub rows: Option<Block>,
    /// What was gathered of the rows when those were made.
    pub facts: Option<LogFacts>,
    /// What the groups of those are.
    pub group_by: Option<GroupBy>,
    /// Whether the covariance is to come from the groups.
    pub by_group: bool,
    /// Why it cannot, though there are groups.
    pub not_grouped: Option<ValidationError>,
    /// Why there should be no covariance at all, unless it is asked for by name.
    pub few_groups: Option<FewGroups>,
}

impl ModelChoice {
    /// What the covariance is found from, by `rule`.
    pub fn covariance_from(&self, rule: CovarianceRule) -> CovarianceFrom<'_> {
        match &self.sums {
            // In this order: sums that a model was chosen by do not serve every solver.
            _ if rule == CovarianceRule::Nothing || self.few_groups.is_some() => {
                CovarianceFrom::Nothing
            }
            sums if self.by_group => match (&self.rows, &self.factored, sums) {
                (Some(rows), ..) => CovarianceFrom::Rowwise(rows),
                (None, Some(rows), _) => CovarianceFrom::Factored(rows),
                (None, None, Some(sums)) => CovarianceFrom::Groups(sums),
                (None, None, None) => CovarianceFrom::Rows,
            },
            _ => CovarianceFrom::Rows,
        }
    }

    /// The groups that were found, where they are not given.
    pub fn found_groups(&self) -> Option<FoundSummary> {
        let is_used =
            self.sums.is_some() || self.factored.is_some() || self.cross_validation.is_some();
        self.group_by.as_ref().filter(|_| is_used)?.found().map(FoundGroups::summary)
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
    pub fn of(features: usize, groups: usize) -> Option<Self> {
        (2 * features > groups).then_some(Self { features, groups })
    }
}

/// Chooses the model, validates it, and sums by group: as much of it as is asked for.
///
/// # Errors
/// [`WorkflowError`] if logs cannot be read or summed exactly, or there are no groups to hold out.
pub fn choose(
    train: &[Log],
    options: &ModelChoiceOptions<'_>,
) -> Result<ModelChoice, WorkflowError> {
    let validates = options.validates();
    let asks_for_groups = validates || options.covariance == CovarianceRule::Groups;
    let group_by = match options.cross_validation {
        _ if !asks_for_groups && !options.takes_groups() => None,
        Some(held_out) => groups::held_out(train, held_out, &options.read)?,
        None if asks_for_groups => groups::held_out(train, HeldOut::Auto, &options.read)?,
        None => groups::of_errors(train, &options.read)?,
    };
    let mut choice = options.open(group_by.clone());
    if !validates && !choice.by_group {
        return Ok(choice);
    }
    let group_by = group_by.ok_or(WorkflowError::NoGroups)?;
    let read = ReadOptions { checksum: false, ..options.read };
    if !validates && options.kept() != GroupsKept::Sums {
        return options.keep(choice, train, &group_by, &read);
    }
    let sums = options.sum(train, choice.basis, group_by.clone());
    let sums = match sums {
        Err(WorkflowError::Fit(FitError::NotExact(_))) if !validates => {
            let found = factor(train, choice.basis, &group_by, options.used, &read);
            return options.decide_factored(choice, found.map(|Factored { groups, .. }| groups));
        }
        Err(WorkflowError::Validation(reason)) if !validates => {
            choice.not_grouped = Some(reason);
            return Ok(choice);
        }
        sums => sums?,
    };
    let Sums { grouped, facts, .. } = sums;
    let choice = ModelChoice { facts, ..options.decide(choice, grouped)? };
    match choice.by_group && options.kept() != GroupsKept::Sums {
        true => options.keep(choice, train, &group_by, &read),
        false => Ok(choice),
    }
}

/// The same, from sums that have been made already: for `options.basis` or, where the family is to be
/// chosen, for any. Errors are found on each group, or on `folds` folds of them.
///
/// # Errors
/// As for [`choose`].
pub fn choose_from(
    sums: GroupedMoments,
    group_by: GroupBy,
    options: &ModelChoiceOptions<'_>,
) -> Result<ModelChoice, WorkflowError> {
    options.decide(options.open(Some(group_by)), sums)
}

/// What to say of the model that was asked for beside the smaller ones that the same sums serve; `None`
/// if there is none, or it cannot be fitted without one of the folds.
fn advice(
    sums: &GroupedMoments,
    model: &Model,
    ridge: f64,
) -> Result<Option<Advice>, ValidationError> {
    let selection = selection::select(sums, model.intercept, &[ridge])?;
    let given = (selection.candidates.iter())
        .position(|candidate| candidate.basis == model.basis && candidate.errors.is_some());
    match given {
        Some(given) if selection.candidates.len() > 1 => {
            Advice::of(sums, model.intercept, &selection, Some(given)).map(Some)
        }
        _ => Ok(None),
    }
}

impl ModelChoiceOptions<'_> {
    /// Whether it takes groups to answer what is asked.
    pub(super) fn validates(&self) -> bool {
        self.basis.is_none() || self.cross_validation.is_some()
    }

    /// How many folds errors are found on, where it is not each group.
    fn folds(&self) -> Option<usize> {
        match self.cross_validation {
            Some(HeldOut::Folds(folds)) => Some(folds),
            _ => None,
        }
    }

    /// What is asked for, before anything is known.
    pub(super) fn open(&self, group_by: Option<GroupBy>) -> ModelChoice {
        ModelChoice {
            basis: self.basis.unwrap_or(Basis::Poly3),
            ridge: self.ridge,
            selection: None,
            cross_validation: None,
            advice: None,
            sums: None,
            factored: None,
            rows: None,
            facts: None,
            by_group: self.wants_groups(group_by.as_ref()),
            group_by,
            not_grouped: None,
            few_groups: None,
        }
    }

    /// The same where there are no groups.
    pub(super) fn without_groups(&self) -> Result<ModelChoice, WorkflowError> {
        match self.validates() || self.covariance == CovarianceRule::Groups {
            true => Err(WorkflowError::NoGroupSums),
            false => Ok(self.open(None)),
        }
    }

    /// What the sums say.
    fn decide(
        &self,
        mut choice: ModelChoice,
        sums: GroupedMoments,
    ) -> Result<ModelChoice, WorkflowError> {
        if self.basis.is_none() {
            let given = [self.ridge];
            let ridges = if self.ridge > 0.0 { &given[..] } else { &selection::RIDGES };
            let selection = selection::select(&sums, self.intercept, ridges)?;
            let chosen = &selection.candidates[selection.chosen];
            (choice.basis, choice.ridge) = (chosen.basis, chosen.ridge);
            choice.advice = Some(Advice::of(&sums, self.intercept, &selection, None)?);
            choice.selection = Some(selection);
        }
        let channels = sums.total().map_or(0, Moments::channels);
        let model = Model { basis: choice.basis, intercept: self.intercept, channels };
        self.judge_groups(&mut choice, &model, sums.groups.len());
        if self.cross_validation.is_some() {
            let found = cross_validate(&sums, &model, choice.ridge, self.folds())?;
            choice.cross_validation = Some(found);
            if choice.advice.is_none() {
                choice.advice = advice(&sums, &model, choice.ridge)?;
            }
        }
        choice.sums = Some(sums);
        Ok(choice)
    }

    /// The same for rows that cannot be summed exactly, of which nothing but standard errors is asked.
    pub(super) fn decide_factored(
        &self,
        mut choice: ModelChoice,
        rows: Result<FactoredGroups, WorkflowError>,
    ) -> Result<ModelChoice, WorkflowError> {
        let rows = match rows {
            // Better standard errors were not asked for by name.
            Err(WorkflowError::Validation(reason)) => {
                choice.not_grouped = Some(reason);
                return Ok(choice);
            }
            rows => rows?,
        };
        let channels = rows.groups.first().map_or(0, |(_, rows)| rows.channels());
        let model = Model { basis: choice.basis, intercept: self.intercept, channels };
        self.judge_groups(&mut choice, &model, rows.groups.len());
        choice.factored = Some(rows);
        Ok(choice)
    }

    /// What the solver's standard errors by group are made of.
    fn kept(&self) -> GroupsKept {
        GroupsKept::of(self.solver)
    }

    /// Keeps the rows by group as the solver needs them.
    fn keep(
        &self,
        choice: ModelChoice,
        train: &[Log],
        group_by: &GroupBy,
        read: &ReadOptions<'_>,
    ) -> Result<ModelChoice, WorkflowError> {
        match self.kept() {
            GroupsKept::Rows => {
                let rows = grouped_rows(train, group_by, self.used, read)?;
                Ok(self.decide_rows(choice, rows))
            }
            _ => {
                let found = factor(train, choice.basis, group_by, self.used, read);
                self.decide_factored(choice, found.map(|Factored { groups, .. }| groups))
            }
        }
    }

    /// As [`ModelChoiceOptions::decide`], for rows as they are.
    pub(super) fn decide_rows(&self, mut choice: ModelChoice, rows: Block) -> ModelChoice {
        let labels: HashSet<&str> = rows.groups.iter().map(|(label, _)| label.as_str()).collect();
        let channels = rows.readings.len();
        let model = Model { basis: choice.basis, intercept: self.intercept, channels };
        self.judge_groups(&mut choice, &model, labels.len());
        choice.rows = Some(rows);
        choice
    }

    /// Whether so many groups can tell how the coefficients of `model` scatter.
    fn judge_groups(&self, choice: &mut ModelChoice, model: &Model, groups: usize) {
        // A few groups say little about how groups scatter.
        choice.by_group &= self.covariance != CovarianceRule::Auto || groups >= FEWEST_GROUPS;
        let is_of_poses = choice.group_by.as_ref().is_some_and(GroupBy::is_of_poses);
        if self.covariance == CovarianceRule::Auto && is_of_poses {
            choice.few_groups = FewGroups::of(model.term_count(), groups);
        }
    }

    /// Whether the covariance is to come from groups, if those are `group_by`.
    pub(super) fn wants_groups(&self, group_by: Option<&GroupBy>) -> bool {
        match self.covariance {
            CovarianceRule::Groups => true,
            _ => self.takes_groups() && group_by.is_some_and(GroupBy::is_of_poses),
        }
    }

    /// Whether it may come from groups that nobody has asked for.
    fn takes_groups(&self) -> bool {
        self.covariance == CovarianceRule::Auto
    }

    fn sum(&self, train: &[Log], basis: Basis, group_by: GroupBy) -> Result<Sums, WorkflowError> {
        let spreads = self.covariance != CovarianceRule::Nothing && may_exceed(train, self.memory);
        let gathering = Some(Gathering::of_training(train, spreads));
        self.sum_apart(|apart| {
            let (group_by, random) = (group_by.clone(), self.random_split());
            let (used, read) = (self.used, self.read);
            moments::sum(
                train,
                &SumOptions { basis, group_by, apart, random, used, gathering, read },
            )
        })
    }

    /// Sums by group; by sets of groups where there are too many and folds of them are asked for.
    pub(super) fn sum_apart<T>(
        &self,
        sum: impl Fn(Apart) -> Result<T, WorkflowError>,
    ) -> Result<T, WorkflowError> {
        match sum(Apart::Groups) {
            Err(WorkflowError::Validation(ValidationError::TooManyGroups { .. }))
                if self.folds().is_some() =>
            {
                sum(Apart::Sets)
            }
            sums => sums,
        }
    }

    /// The random split that held-out errors are compared with, where they are asked for.
    pub(super) fn random_split(&self) -> RandomSplit {
        self.cross_validation.map_or_else(RandomSplit::default, |_| {
            random_split(self.folds().unwrap_or(RANDOM_FOLDS), self.seed)
        })
    }
}
