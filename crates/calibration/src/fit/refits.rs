//! Errors on rows that were held out, by fits without them.
//!
//! Exact sums say what a fit without a group would be, of the solver that works on them and for readings that
//! can be summed so. For any other solver, and for readings of any kind, each fold is fitted anew: each of up to
//! forty groups is held out alone, more in ten folds.

use super::FitOptions;
use super::polynomial::{PolynomialProblem, calibrate};
use crate::conversion::Calibration;
use crate::error::FitError;
use crate::groups::HeldOut;
use crate::model::{Basis, Model};
use crate::passes::Rows;
use crate::physics::TrainingRows;
use crate::validation::ValidationError;
use crate::validation::cross_validation::{CrossValidation, HeldOutQuality, assign_groups};
use crate::validation::grouped::{RandomSplit, assign};
use crate::validation::normal_equations::HeldOutFolds;
use crate::validation::selection::{self, Selection};
use shell_data::block::Block;
use shell_data::dataset::{BLOCK_ROWS, Dataset, sample};
use shell_data::statistics::RunningVariance;
use shell_data::wrench::PerAxis;
use std::collections::HashMap;

/// Up to this many groups each is held out alone.
pub(super) const MOST_ALONE: usize = 40;
/// Folds that more groups are assigned to.
pub(super) const FOLDS: usize = 10;

/// Folds of the random split that held-out errors are compared with, where no number is given.
pub const RANDOM_FOLDS: usize = 10;

/// Folds of it that are held out.
const HELD_OUT: usize = 2;

/// The random split into so many folds, two of which are held out.
pub fn random_split(folds: usize, seed: u64) -> RandomSplit {
    RandomSplit { folds, held_out: folds.min(HELD_OUT), seed }
}

/// What is fitted without each fold.
#[derive(Clone, Copy)]
pub(super) struct Refit<'a> {
    pub(super) basis: Basis,
    pub(super) ridge: f64,
    pub(super) options: &'a FitOptions<'a>,
}

/// Chooses the family of features, and its ridge if that is zero, by folds of groups of labelled rows.
pub(super) fn select_by_normal_equations(
    data: &Dataset,
    options: &FitOptions<'_>,
) -> Result<Selection, FitError> {
    let groups = LabelGroups::new(data);
    let blocks = groups.folds(data, groups.sizes.len().min(selection::FOLDS))?;
    let folds = HeldOutFolds::new(&blocks, options.model_of(data, Basis::Linear))?;
    Ok(folds.select(options.ridges())?)
}

/// The errors of a model on each group, or on folds of them, by normal equations: for models of many features.
pub(super) fn cross_validate_by_normal_equations(
    data: &Dataset,
    held_out: HeldOut,
    refit: &Refit<'_>,
) -> Result<CrossValidation, FitError> {
    let groups = LabelGroups::new(data);
    let count = groups.sizes.len();
    let folds = match held_out {
        HeldOut::Folds(folds) => folds,
        _ if count <= MOST_ALONE => count,
        _ => FOLDS,
    };
    let blocks = groups.folds(data, folds)?;
    let folds = HeldOutFolds::new(&blocks, refit.options.model_of(data, refit.basis))?;
    Ok(folds.cross_validate(refit.ridge, count)?)
}

/// The groups of labelled rows.
struct LabelGroups {
    places: HashMap<String, usize>,
    sizes: Vec<u64>,
}

impl LabelGroups {
    fn new(data: &Dataset) -> Self {
        let (mut places, mut sizes) = (HashMap::new(), Vec::new());
        for (label, rows) in data.blocks().flat_map(|(_, block)| &*block.labels) {
            let place = *places.entry(label.clone()).or_insert(sizes.len());
            sizes.resize(sizes.len().max(place + 1), 0);
            sizes[place] += *rows as u64;
        }
        Self { places, sizes }
    }

    /// The rows of so many folds of groups.
    fn folds(&self, data: &Dataset, folds: usize) -> Result<Vec<Block>, ValidationError> {
        let found = self.sizes.len();
        if found < 2 {
            return Err(ValidationError::TooFewGroups { found });
        }
        let assigned = assign_groups(&self.sizes, folds)?;
        let mut fold_of = vec![0; found];
        for (fold, groups) in assigned.iter().enumerate() {
            groups.iter().for_each(|&group| fold_of[group] = fold);
        }
        let mut blocks = vec![Block::default(); assigned.len()];
        for (_, block) in data.blocks() {
            let mut start = 0;
            for (label, rows) in &*block.labels {
                blocks[fold_of[self.places[label]]].append(&block.rows, start..start + rows);
                start += rows;
            }
        }
        Ok(blocks)
    }
}

/// The number of rows of each group.
fn sizes(rows: &TrainingRows, groups: usize) -> Vec<u64> {
    let mut sizes = vec![0; groups];
    rows.groups.iter().for_each(|&group| sizes[group as usize] += 1);
    sizes
}

/// The errors of `refit` on groups of labelled rows, each fold held out in turn, and on rows that are assigned at
/// random.
pub(super) fn cross_validate_by_refits(
    data: &Dataset,
    held_out: HeldOut,
    refit: &Refit<'_>,
) -> Result<CrossValidation, FitError> {
    let (rows, labels) = TrainingRows::from_dataset(data);
    let sizes = sizes(&rows, labels.len());
    if labels.len() < 2 {
        return Err(ValidationError::TooFewGroups { found: labels.len() }.into());
    }
    let folds = match held_out {
        HeldOut::Folds(folds) => assign_groups(&sizes, folds)?,
        _ if labels.len() <= MOST_ALONE => (0..labels.len()).map(|group| vec![group]).collect(),
        _ => assign_groups(&sizes, FOLDS)?,
    };
    let (mut grouped, mut undetermined) = (ErrorVariances::default(), Vec::new());
    let mut reason = None;
    for fold in &folds {
        let is_held_out = |row: usize| fold.contains(&(rows.groups[row] as usize));
        match refit.without(&rows, is_held_out) {
            Ok(errors) => grouped.merge(&errors),
            Err(FitError::Interrupted) => return Err(FitError::Interrupted),
            Err(error) => {
                undetermined.extend(fold.iter().map(|&group| labels[group].clone()));
                reason = Some(error);
            }
        }
    }
    if let Some(reason) = reason.filter(|_| undetermined.len() == labels.len()) {
        return Err(reason);
    }
    let random = match held_out {
        HeldOut::Folds(folds) => random_split(folds, refit.options.seed),
        _ => random_split(RANDOM_FOLDS, refit.options.seed),
    };
    let columns: Vec<&[f64]> =
        rows.readings.iter().chain(&rows.wrench).map(Vec::as_slice).collect();
    let assigned = assign(&columns, rows.groups.len(), &random);
    let of_assigned = |held_out: &Vec<usize>| {
        let mut is_held_out = vec![false; rows.groups.len()];
        held_out.iter().for_each(|&row| is_held_out[row] = true);
        refit.without(&rows, |row| is_held_out[row])
    };
    let at_random: Result<Vec<ErrorVariances>, _> =
        assigned.iter().filter(|rows| !rows.is_empty()).map(of_assigned).collect();
    if at_random == Err(FitError::Interrupted) {
        return Err(FitError::Interrupted);
    }
    let mut all = ErrorVariances::default();
    at_random.iter().flatten().for_each(|errors| all.merge(errors));
    Ok(CrossValidation {
        groups: labels.len(),
        folds: folds.len(),
        rows: rows.groups.len() as u64,
        undetermined,
        grouped: grouped.quality(),
        random_folds: assigned.len(),
        random: at_random.ok().filter(|folds| !folds.is_empty()).map(|_| all.quality()),
    })
}

impl Refit<'_> {
    /// The errors on the rows that are held out, of a fit without them.
    fn without(
        &self,
        rows: &TrainingRows,
        is_held_out: impl Fn(usize) -> bool,
    ) -> Result<ErrorVariances, FitError> {
        let all = 0..rows.groups.len();
        let (held_out, kept): (Vec<usize>, Vec<usize>) = all.partition(|&row| is_held_out(row));
        let FitOptions { intercept, solver, truncate, workers, .. } = *self.options;
        let channels = rows.readings.len();
        let problem = PolynomialProblem {
            model: Model { basis: self.basis, intercept, channels, memory: 0 },
            solver,
            ridge: self.ridge,
            truncate,
        };
        let kept: Vec<Block> = kept.chunks(BLOCK_ROWS).map(|places| rows.block(places)).collect();
        let sample = sample(&kept);
        let calibration = calibrate(&problem, &Rows::from_blocks(&kept, workers), &sample)?;
        Ok(ErrorVariances::new(&calibration, &rows.block(&held_out)))
    }
}

/// Predicted less measured, over rows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct ErrorVariances(PerAxis<RunningVariance>);

impl ErrorVariances {
    fn new(calibration: &Calibration, block: &Block) -> Self {
        let mut predicted = PerAxis::default();
        calibration.wrench(&block.readings, &mut predicted);
        Self(std::array::from_fn(|axis| {
            let pairs = predicted[axis].iter().zip(&block.wrench[axis]);
            let errors: Vec<f64> =
                pairs.map(|(predicted, measured)| predicted - measured).collect();
            RunningVariance::new(&errors)
        }))
    }

    fn merge(&mut self, other: &Self) {
        self.0.iter_mut().zip(&other.0).for_each(|(all, part)| all.merge(part));
    }

    fn quality(&self) -> PerAxis<HeldOutQuality> {
        self.0.map(|errors| HeldOutQuality { rms: errors.rms(), bias: errors.mean })
    }
}
