//! Errors on rows that were held out, by fits without them.
//!
//! Exact sums say what a fit without a group would be, of the solver that works on them and for readings that
//! can be summed so. For any other solver, and for readings of any kind, each fold is fitted anew: all rows are
//! held in memory, and each of up to forty groups is held out alone, more in ten folds.

use std::ops::Range;

use super::WorkflowError;
use super::groups;
use super::in_memory::{self, RowFitOptions, RowSource};
use super::model_choice::{
    self, CovarianceRule, HeldOut, ModelChoice, ModelChoiceOptions, RANDOM_FOLDS, random_split,
};
use super::physics::{GroupedRows, read_rows};
use calibration::physics::TrainingRows;
use calibration::solver::SolverKind;
use calibration::validation::ValidationError;
use calibration::validation::cross_validation::{CrossValidation, HeldOutQuality, deal_groups};
use calibration::validation::grouped::{RandomSplit, deal};
use calibration::validation::selection::{self, Selection};
use calibration::validation::triangles;
use calibration::{Basis, Calibration, FitError};
use log_file::Log;
use shell_data::block::Block;
use shell_data::statistics::RunningVariance;
use shell_data::wrench::PerAxis;

/// Up to this many groups each is held out alone.
const MOST_ALONE: usize = 40;
/// Folds that more groups are dealt into.
const FOLDS: usize = 10;

/// What is fitted without each fold.
#[derive(Clone, Copy, Debug)]
struct Refit {
    basis: Basis,
    intercept: bool,
    ridge: f64,
    /// The exact one gives way to refined QR where it cannot take the rows.
    solver: SolverKind,
    truncate: Option<f64>,
}

/// As [`model_choice::choose`], with the errors of the model that was asked for also where sums cannot tell them.
/// `truncate` is that of the fit.
///
/// # Errors
/// As [`model_choice::choose`].
pub fn choose(
    train: &[Log],
    options: &ModelChoiceOptions<'_>,
    truncate: Option<f64>,
) -> Result<ModelChoice, WorkflowError> {
    let validates = options.basis.is_none() || options.cross_validation.is_some();
    // A family is chosen by exact sums wherever there are any, whatever solver then fits it.
    if !validates || options.basis.is_none() || options.solver == SolverKind::Exact {
        match model_choice::choose(train, options) {
            Err(WorkflowError::Fit(FitError::NotExact(_))) if validates => {}
            choice => return choice,
        }
    }
    let held_out = options.cross_validation.unwrap_or(HeldOut::Auto);
    let group_by = groups::held_out(train, held_out, &options.read)?;
    let group_by = group_by.ok_or(WorkflowError::NoGroups)?;
    let ModelChoiceOptions { intercept, solver, used, read, .. } = *options;
    let rows = read_rows(train, Some(&group_by), used, &read)?;
    let (basis, ridge, selection) = match options.basis {
        Some(basis) => (basis, options.ridge, None),
        None => {
            let selection = select(&rows, intercept, options.ridge)?;
            let chosen = &selection.candidates[selection.chosen];
            (chosen.basis, chosen.ridge, Some(selection))
        }
    };
    let known =
        ModelChoiceOptions { basis: Some(basis), ridge, cross_validation: None, ..*options };
    let mut choice = model_choice::choose(train, &known)?;
    if options.cross_validation.is_some() {
        let refit = Refit { basis, intercept, ridge, solver, truncate };
        let folds = match held_out {
            HeldOut::Folds(folds) => folds,
            _ => RANDOM_FOLDS,
        };
        let random = random_split(folds, options.seed);
        let found = cross_validate(&rows, held_out, &refit, &random, read.threads)?;
        choice.cross_validation = Some(found);
    }
    choice.selection = selection;
    choice.group_by = Some(group_by);
    Ok(choice)
}

/// Chooses the family of features, and its ridge if that is zero, by folds of groups.
fn select(
    GroupedRows { rows, labels, .. }: &GroupedRows,
    intercept: bool,
    ridge: f64,
) -> Result<Selection, WorkflowError> {
    let groups = labels.len();
    if groups < 2 {
        return Err(WorkflowError::Validation(ValidationError::TooFewGroups { found: groups }));
    }
    let folds = deal_groups(&sizes(rows, groups), groups.min(selection::FOLDS));
    let block = |fold: &Vec<usize>| {
        let is_in = |row: &usize| fold.contains(&(rows.groups[*row] as usize));
        let places: Vec<usize> = (0..rows.groups.len()).filter(is_in).collect();
        let mut block = Block::default();
        SomeRows { rows, places: &places }.fill(0..places.len(), &mut block);
        block
    };
    let blocks: Vec<Block> = folds.map_err(WorkflowError::Validation)?.iter().map(block).collect();
    let given = [ridge];
    let ridges = if ridge > 0.0 { &given[..] } else { &selection::RIDGES };
    triangles::select(&blocks, intercept, ridges).map_err(|error| match error {
        ValidationError::Rows(error) => WorkflowError::Fit(*error),
        error => WorkflowError::Validation(error),
    })
}

/// The number of rows of each group.
fn sizes(rows: &TrainingRows, groups: usize) -> Vec<u64> {
    let mut sizes = vec![0; groups];
    rows.groups.iter().for_each(|&group| sizes[group as usize] += 1);
    sizes
}

/// The errors of `refit` on groups of rows, each fold held out in turn, and on rows that are dealt by `random`.
fn cross_validate(
    GroupedRows { rows, labels, .. }: &GroupedRows,
    held_out: HeldOut,
    refit: &Refit,
    random: &RandomSplit,
    threads: usize,
) -> Result<CrossValidation, WorkflowError> {
    let sizes = sizes(rows, labels.len());
    if labels.len() < 2 {
        return Err(WorkflowError::Validation(ValidationError::TooFewGroups {
            found: labels.len(),
        }));
    }
    let folds = match held_out {
        HeldOut::Folds(folds) => deal_groups(&sizes, folds).map_err(WorkflowError::Validation)?,
        _ if labels.len() <= MOST_ALONE => (0..labels.len()).map(|group| vec![group]).collect(),
        _ => deal_groups(&sizes, FOLDS).map_err(WorkflowError::Validation)?,
    };
    let validation = Validation { rows, refit, threads };
    let (mut grouped, mut undetermined) = (Errors::default(), Vec::new());
    let mut reason = None;
    for fold in &folds {
        let is_held_out = |row: usize| fold.contains(&(rows.groups[row] as usize));
        match validation.without(is_held_out) {
            Ok(errors) => grouped.merge(&errors),
            Err(WorkflowError::Fit(error)) => {
                undetermined.extend(fold.iter().map(|&group| labels[group].clone()));
                reason = Some(WorkflowError::Fit(error));
            }
            Err(other) => return Err(other),
        }
    }
    if let Some(reason) = reason.filter(|_| undetermined.len() == labels.len()) {
        return Err(reason);
    }
    let columns: Vec<&[f64]> =
        rows.readings.iter().chain(&rows.wrench).map(Vec::as_slice).collect();
    let dealt = deal(&columns, rows.groups.len(), random);
    let of_dealt = |held_out: &Vec<usize>| {
        let mut is_held_out = vec![false; rows.groups.len()];
        held_out.iter().for_each(|&row| is_held_out[row] = true);
        validation.without(|row| is_held_out[row])
    };
    let at_random: Result<Vec<Errors>, _> =
        dealt.iter().filter(|rows| !rows.is_empty()).map(of_dealt).collect();
    let mut all = Errors::default();
    at_random.iter().flatten().for_each(|errors| all.merge(errors));
    Ok(CrossValidation {
        groups: labels.len(),
        folds: folds.len(),
        rows: rows.groups.len() as u64,
        undetermined,
        grouped: grouped.quality(),
        random_folds: dealt.len(),
        random: at_random.ok().filter(|folds| !folds.is_empty()).map(|_| all.quality()),
    })
}

/// Rows and what is fitted to most of them.
struct Validation<'a> {
    rows: &'a TrainingRows,
    refit: &'a Refit,
    threads: usize,
}

impl Validation<'_> {
    /// The errors on the rows that are held out.
    fn without(&self, is_held_out: impl Fn(usize) -> bool) -> Result<Errors, WorkflowError> {
        let all = 0..self.rows.groups.len();
        let (held_out, kept): (Vec<usize>, Vec<usize>) = all.partition(|&row| is_held_out(row));
        let Refit { basis, intercept, ridge, solver, truncate } = *self.refit;
        let options = RowFitOptions {
            basis: Some(basis),
            intercept,
            ridge,
            solver,
            truncate,
            cross_validation: None,
            seed: 0,
            covariance: CovarianceRule::Nothing,
            threads: self.threads,
        };
        let kept = SomeRows { rows: self.rows, places: &kept };
        let calibration = in_memory::fit(&kept, &options)?.calibration;
        Ok(Errors::of(&calibration, &SomeRows { rows: self.rows, places: &held_out }))
    }
}

/// Some of the rows in memory.
struct SomeRows<'a> {
    rows: &'a TrainingRows,
    places: &'a [usize],
}

impl RowSource for SomeRows<'_> {
    fn rows(&self) -> usize {
        self.places.len()
    }

    fn channels(&self) -> usize {
        self.rows.readings.len()
    }

    fn has_groups(&self) -> bool {
        false
    }

    fn fill(&self, rows: Range<usize>, block: &mut Block) {
        let places = &self.places[rows];
        let fill = |to: &mut Vec<Vec<f64>>, from: &[Vec<f64>]| {
            to.resize_with(from.len(), Vec::new);
            for (to, from) in to.iter_mut().zip(from) {
                to.clear();
                to.extend(places.iter().map(|&place| from[place]));
            }
        };
        fill(&mut block.readings, &self.rows.readings);
        fill(&mut block.wrench, &self.rows.wrench);
        block.rows = places.len();
    }
}

/// Predicted less measured, over rows.
#[derive(Clone, Copy, Default)]
struct Errors(PerAxis<RunningVariance>);

impl Errors {
    fn of(calibration: &Calibration, source: &SomeRows<'_>) -> Self {
        let mut block = Block::default();
        source.fill(0..source.rows(), &mut block);
        let mut predicted = PerAxis::default();
        calibration.wrench(&block.readings, &mut predicted);
        Self(std::array::from_fn(|axis| {
            let pairs = predicted[axis].iter().zip(&block.wrench[axis]);
            let errors: Vec<f64> =
                pairs.map(|(predicted, measured)| predicted - measured).collect();
            RunningVariance::of(&errors)
        }))
    }

    fn merge(&mut self, other: &Self) {
        self.0.iter_mut().zip(&other.0).for_each(|(all, part)| all.merge(part));
    }

    fn quality(&self) -> PerAxis<HeldOutQuality> {
        self.0.map(|errors| HeldOutQuality { rms: errors.rms(), bias: errors.mean })
    }
}
