//! Chooses what is fitted: the model, its held-out errors, and how rows err together; and what is then known of the
//! model before it is fitted.

use std::ops::Range;

use super::options::{CovarianceRule, FitOptions, ModelRule};
use super::refits::{
    self, FOLDS, MOST_ALONE, MOST_COMPARED, few_by_fold, rows_in_one, select_by_normal_equations,
    sum_groups, sum_groups_or_sets,
};
use super::warning::{FewGroups, Warning};
use crate::groups::{FoundGroups, GroupBy, HeldOut, label_groups, label_poses, stretches_of_files};
use least_squares::error::FitError;
use least_squares::factored::FactoredGroups;
use least_squares::grouped_rows::GroupedRows;
use least_squares::grouped_rows::MAX_GROUPS;
use least_squares::model::{Basis, Model};
use least_squares::random_split::RandomSplit;
use least_squares::scaling::Scaling;
use least_squares::solver::SolverKind;
use least_squares::sums::GroupedSums;
use least_squares::validation::cross_validation::CrossValidation;
use least_squares::validation::grouped::{Apart, SumsByGroup};
use least_squares::validation::selection::{self, Advice, Selection};
use shell_data::dataset::{Dataset, RowSet};

/// The fewest groups that standard errors come from unless they are asked for by name.
const FEWEST_GROUPS: usize = 10;

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
    /// The sums of the training rows, by the groups that are held out, where they were made.
    pub(super) sums: Option<GroupedSums>,
    /// What the covariance by group is found from, where those sums do not suit the solver or the groups.
    pub(super) own_sums: Option<GroupedSums>,
    /// Which groups are held out together for the covariance, where they are stretches of time.
    pub(super) stretches: Option<Vec<Range<usize>>>,
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

    /// What a covariance by group is found from.
    pub(super) fn covariance_sums(&self) -> Option<&GroupedSums> {
        self.own_sums.as_ref().or(self.sums.as_ref())
    }

    /// The groups that were found, where they are not given.
    pub(super) fn found_groups(&self) -> Option<FoundGroups> {
        let are_sums = self.covariance_sums().is_some_and(|sums| !sums.are_rows());
        let is_used = are_sums || self.sums.is_some() || self.cross_validation.is_some();
        self.group_by.as_ref().filter(|_| is_used)?.found()
    }

    /// Holds out each stretch of time alone for the covariance, if the groups of `sums` are stretches, on average of half as
    /// many rows as the model has features: what each adds to the scatter of all is little then.
    fn set_stretches(&mut self, sums: &GroupedSums, model: &Model) {
        let groups = sums.groups();
        let are_long = 2 * sums.rows() >= (groups * model.term_count()) as u64;
        let are_stretches = self.group_by.is_some_and(|by| by.is_stretches());
        let each_alone = || (0..groups).map(|group| group..group + 1).collect();
        self.stretches = (are_long && are_stretches).then(each_alone);
    }

    /// Returns the warnings of standard errors by group that there are not, for the reasons known here and to the fit
    /// (`not_grouped`).
    ///
    /// # Errors
    /// [`FitError::NoGroupCovariance`] if `rule` asks for them by name.
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
/// | step | rows that sum exactly | other rows, or memory terms |
/// | --- | --- | --- |
/// | family of features | exact sums, whatever the solver | normal equations by fold: three digits are enough |
/// | held-out errors | exact sums, if they solve or the family was chosen | R factors by fold; Huber's estimator fits again |
/// | covariance by group | exact sums, if they solve | R factors by group; Huber's estimator keeps the rows |
///
/// Solvers other than the exact one take the last column with any rows, but for the family. Where files of motion were held
/// out, the covariance is that of stretches of these, by R factors.
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
        Ok(Some(sums)) => choice = options.decide(choice, GroupedSums::Exact(sums))?,
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
        options.sum_for_solver(&mut choice, &rows)?;
    }
    options.sum_stretches_of_files(&mut choice)?;
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
            Ok(sums) => self.select(choice, &GroupedSums::Exact(sums)),
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
        sums: GroupedSums,
    ) -> Result<ModelChoice, FitError> {
        let model = self.model_without_memory(choice.basis, sums.channels());
        self.test_group_count(&mut choice, &model, sums.groups());
        if self.validation().is_some() {
            let folds = self.folds(sums.group_count());
            choice.cross_validation = Some(sums.cross_validate(&model, choice.ridge, folds)?);
            if choice.advice.is_none() {
                choice.advice = sums.advice(&model, choice.ridge)?;
            }
        }
        choice.set_stretches(&sums, &model);
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
        sums: &GroupedSums,
    ) -> Result<(), FitError> {
        let (selection, advice) = sums.select(self.intercept, self.ridges())?;
        choice.advice = advice;
        choice.take(selection);
        Ok(())
    }

    /// The ridges that are tried.
    pub(super) fn ridges(&self) -> &[f64] {
        if self.ridge > 0.0 { std::slice::from_ref(&self.ridge) } else { &selection::RIDGES }
    }

    /// The R factors of labelled rows by group. Where they cannot be had, `choice` knows why: better standard errors were
    /// not asked for by name.
    fn factor_groups(
        &self,
        choice: &mut ModelChoice,
        data: &Dataset,
    ) -> Result<Option<GroupedSums>, FitError> {
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
            rows => Ok(Some(GroupedSums::Factored(rows?))),
        }
    }

    /// Where files of motion were held out, standard errors and intervals come from stretches of these.
    fn sum_stretches_of_files(&self, choice: &mut ModelChoice) -> Result<(), FitError> {
        let is_served = self.validates()
            && self.covariance == CovarianceRule::Auto
            && self.solver != SolverKind::Huber
            && choice.group_by == Some(GroupBy::File);
        let Some(rows) = choice.labelled.as_ref().filter(|_| is_served) else { return Ok(()) };
        let Some((rows, files)) = stretches_of_files(rows) else { return Ok(()) };
        let most = files.len().div_ceil(FOLDS);
        choice.stretches = Some(match files.len() {
            0..=MOST_ALONE => files,
            _ => files.chunks(most).map(|of| of[0].start..of[of.len() - 1].end).collect(),
        });
        choice.by_group = true;
        choice.own_sums = self.factor_groups(choice, &rows)?;
        Ok(())
    }

    /// Keeps what the solver's standard errors by group need of the labelled rows, where the sums of groups that are held
    /// out do not serve it.
    fn sum_for_solver(&self, choice: &mut ModelChoice, rows: &Dataset) -> Result<(), FitError> {
        let own_sums = match self.solver {
            SolverKind::Huber => Some(GroupedSums::Rows(rows_in_one(rows))),
            _ => self.factor_groups(choice, rows)?,
        };
        if let Some(sums) = &own_sums {
            let model = self.model_of(rows, choice.basis);
            self.test_group_count(choice, &model, sums.groups());
            choice.set_stretches(sums, &model);
        }
        choice.own_sums = own_sums;
        Ok(())
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
