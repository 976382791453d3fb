//! Errors on rows that were held out, by fits without them.
//!
//! Exact sums say what a fit without a group would be, of the solver that works on them and for readings that
//! can be summed so. For readings of any kind the R factors of the folds do, for solvers that weigh rows alike; for
//! others each fold is fitted anew. Each of up to forty groups is held out alone, more in ten folds.

use super::FitOptions;
use super::polynomial::{PolynomialProblem, calibrate, r_factor_method};
use crate::conversion::Calibration;
use crate::error::FitError;
use crate::exact::HeldOutErrors;
use crate::factored::{FactoredGroups, FactoredRows};
use crate::groups::HeldOut;
use crate::model::{Basis, Model};
use crate::passes::{Rows, Workers, map};
use crate::scaling::Scaling;
use crate::solver::SolverKind;
use crate::validation::ValidationError;
use crate::validation::cross_validation::{
    CrossValidation, HeldOutQuality, assign_groups, over_folds,
};
use crate::validation::grouped::{RandomSplit, assign};
use crate::validation::normal_equations::HeldOutFolds;
use crate::validation::selection::{self, Selection};
use shell_data::block::Block;
use shell_data::dataset::{Dataset, LabelRuns, sample};
use shell_data::wrench::PerAxis;
use std::collections::HashMap;
use std::sync::Arc;

/// Up to this many groups each is held out alone.
pub(super) const MOST_ALONE: usize = 40;
/// Folds that more groups are assigned to.
pub(super) const FOLDS: usize = 10;

/// Numbers in the R factors of groups that are held out alone, 200 MB, and twice as many in those of all others.
const MOST_NUMBERS: usize = 25_000_000;

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
    let folds = groups.sizes.len().min(selection::FOLDS);
    let blocks = groups.folds(data, &groups.assigned(folds)?, folds);
    let folds = HeldOutFolds::new(&blocks, options.model_of(data, Basis::Linear))?;
    Ok(folds.select(options.ridges())?)
}

/// All labelled rows as one block.
pub(super) fn rows_in_one(data: &Dataset) -> Block {
    let mut all = Block::default();
    for (_, block) in data.blocks() {
        all.append(&block.rows, 0..block.rows.rows);
        all.groups.extend_from_slice(&block.labels);
    }
    all
}

/// The groups of labelled rows.
pub(super) struct LabelGroups {
    positions: HashMap<String, usize>,
    pub(super) sizes: Vec<u64>,
}

impl LabelGroups {
    pub(super) fn new(data: &Dataset) -> Self {
        let (mut positions, mut sizes) = (HashMap::new(), Vec::new());
        for (label, rows) in data.blocks().flat_map(|(_, block)| &*block.labels) {
            let position = *positions.entry(label.clone()).or_insert(sizes.len());
            sizes.resize(sizes.len().max(position + 1), 0);
            sizes[position] += *rows as u64;
        }
        Self { positions, sizes }
    }

    /// The fold of each group.
    fn assigned(&self, folds: usize) -> Result<Vec<usize>, ValidationError> {
        let found = self.sizes.len();
        if found < 2 {
            return Err(ValidationError::TooFewGroups { found });
        }
        let mut fold_of = vec![0; found];
        for (fold, groups) in assign_groups(&self.sizes, folds)?.iter().enumerate() {
            groups.iter().for_each(|&group| fold_of[group] = fold);
        }
        Ok(fold_of)
    }

    /// The rows of so many folds of groups.
    fn folds(&self, data: &Dataset, fold_of: &[usize], folds: usize) -> Vec<Block> {
        let mut blocks = vec![Block::default(); folds];
        for (_, block) in data.blocks() {
            let mut start = 0;
            for (label, rows) in &*block.labels {
                blocks[fold_of[self.positions[label]]].append(&block.rows, start..start + rows);
                start += rows;
            }
        }
        blocks
    }

    /// Every so-manieth row of each group, and its first, labelled by the fold of the group; there are so many at
    /// most.
    pub(super) fn every_nth_by_fold(
        &self,
        data: &Dataset,
        (every, most): (usize, usize),
    ) -> Result<Dataset, ValidationError> {
        let fold_of = self.assigned(self.sizes.len().min(most))?;
        let (mut data, mut seen) = (data.clone(), vec![0; fold_of.len()]);
        for block in data.logs.iter_mut().flat_map(|log| &mut log.blocks) {
            let (mut labels, mut keep) = (LabelRuns::new(), Vec::with_capacity(block.rows.rows));
            for (label, rows) in &*block.labels {
                let group = self.positions[label];
                let first = seen[group];
                seen[group] += rows;
                keep.extend((first..seen[group]).map(|row| row % every == 0));
                labels.push((fold_of[group].to_string(), *rows));
            }
            block.labels = Arc::new(labels);
            *block = block.kept(&keep);
        }
        Ok(data)
    }
}

/// The errors of a model on groups of labelled rows, each fold held out in turn, and on rows that are assigned at
/// random, unless they remember the rows before.
pub(super) fn cross_validate(
    data: &Dataset,
    held_out: HeldOut,
    refit: &Refit<'_>,
) -> Result<CrossValidation, FitError> {
    let groups = LabelGroups::new(data);
    let count = groups.sizes.len();
    let model = refit.options.model_of(data, refit.basis);
    let are_alone = count <= MOST_ALONE && count * model.term_count().pow(2) <= MOST_NUMBERS;
    let (folds, random_folds) = match held_out {
        HeldOut::Folds(folds) => (folds, folds),
        _ if are_alone => (count, RANDOM_FOLDS),
        _ => (FOLDS, RANDOM_FOLDS),
    };
    let fold_of = groups.assigned(folds)?;
    let blocks = groups.folds(data, &fold_of, folds);
    let errors = refit.errors_without_each(model, &blocks, folds)?;
    let is_undetermined = |label: &&String| errors[fold_of[groups.positions[*label]]].is_err();
    let mut undetermined: Vec<&String> = groups.positions.keys().filter(is_undetermined).collect();
    undetermined.sort_unstable_by_key(|&label| groups.positions[label]);
    let undetermined = undetermined.into_iter().cloned().collect();
    let (grouped, _) = over_folds(errors.into_iter().map(|errors| (&[][..], errors)))?;
    let random = match data.memory_terms() {
        0 => parts_at_random(&rows_in_one(data), &random_split(random_folds, refit.options.seed)),
        _ => Vec::new(),
    };
    let at_random = random.len().saturating_sub(1);
    let random = refit.errors_without_each(model, &random, at_random)?;
    let random: Result<Vec<_>, FitError> = random.into_iter().collect();
    Ok(CrossValidation {
        groups: count,
        folds,
        rows: groups.sizes.iter().sum(),
        undetermined,
        grouped,
        random_folds: at_random,
        random: random
            .ok()
            .filter(|folds| !folds.is_empty())
            .map(|folds| HeldOutErrors::total(&folds).map(HeldOutQuality::from)),
    })
}

/// The parts of the rows that are held out at random, and all others.
fn parts_at_random(all: &Block, split: &RandomSplit) -> Vec<Block> {
    let columns: Vec<&[f64]> = all.readings.iter().chain(&all.wrench).map(Vec::as_slice).collect();
    let mut parts = assign(&columns, all.rows, split);
    parts.retain(|rows| !rows.is_empty());
    let mut part_of = vec![parts.len(); all.rows];
    for (part, rows) in parts.iter().enumerate() {
        rows.iter().for_each(|&row| part_of[row] = part);
    }
    let part = |part: usize| all.kept(&part_of.iter().map(|&of| of == part).collect::<Vec<_>>());
    (0..=parts.len()).map(part).collect()
}

impl Refit<'_> {
    /// The errors on each of the first blocks, of a fit to all others: from R factors of the blocks, if the solver weighs
    /// rows alike, and if they have the digits for it.
    fn errors_without_each(
        &self,
        model: Model,
        blocks: &[Block],
        held_out: usize,
    ) -> Result<Vec<Result<PerAxis<HeldOutErrors>, FitError>>, FitError> {
        let FitOptions { solver, truncate, workers, .. } = *self.options;
        let sample = sample(blocks);
        let scaling = Scaling::from_sample(&sample.readings, true);
        let factor = |block: &Block| {
            let mut rows = FactoredRows::new(model, scaling.clone());
            let mut workspace = rows.workspace();
            rows.absorb(block, &mut workspace)?;
            Ok((String::new(), rows))
        };
        let folds = match solver {
            SolverKind::Huber => None,
            _ => Some(FactoredGroups { groups: map(blocks, 0, workers, factor)? }),
        };
        let others = folds.as_ref().and_then(FactoredGroups::without_each);
        let method = r_factor_method(solver, truncate);
        let by_r_factors = |position: usize| {
            let rest = others.as_ref()?[position].solve_by(method, &model, self.ridge).ok()?;
            folds.as_ref()?.groups[position].1.errors(&rest)
        };
        let refit = |position: usize| {
            let one = Workers { threads: 1, ..workers };
            let kept = blocks.iter().enumerate().filter(|(at, _)| *at != position);
            let rows = Rows::from_blocks(kept.map(|(_, block)| block), one);
            let problem = PolynomialProblem { model, solver, ridge: self.ridge, truncate };
            let calibration = calibrate(&problem, &rows, &sample)?;
            Ok(errors_on(&calibration, &blocks[position]))
        };
        let errors = |&position: &usize| match by_r_factors(position) {
            Some(errors) => Ok(Ok(errors)),
            None => match refit(position) {
                Err(FitError::Interrupted) => Err(FitError::Interrupted),
                errors => Ok(errors),
            },
        };
        map(&(0..held_out).collect::<Vec<_>>(), 0, workers, errors)
    }
}

/// Predicted less measured, over rows.
fn errors_on(calibration: &Calibration, block: &Block) -> PerAxis<HeldOutErrors> {
    let mut predicted = PerAxis::default();
    calibration.wrench(&block.readings, &mut predicted);
    std::array::from_fn(|axis| {
        let pairs = predicted[axis].iter().zip(&block.wrench[axis]);
        let mut errors = HeldOutErrors { rows: block.rows as u64, ..HeldOutErrors::default() };
        for error in pairs.map(|(predicted, measured)| predicted - measured) {
            errors.sum += error;
            errors.squares += error * error;
        }
        errors
    })
}
