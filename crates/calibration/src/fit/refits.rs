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
use crate::factored::FactoredGroups;
use crate::grouped_rows::{GroupedRows, Run, count};
use crate::groups::HeldOut;
use crate::model::Basis;
use crate::passes::{Rows, Workers, map};
use crate::scaling::Scaling;
use crate::solver::SolverKind;
use crate::validation::ValidationError;
use crate::validation::cross_validation::{CrossValidation, assign_groups};
use crate::validation::grouped::RandomSplit;
use crate::validation::normal_equations;
use crate::validation::selection::{self, Selection};
use shell_data::block::Block;
use shell_data::dataset::{BLOCK_ROWS, Dataset};
use shell_data::wrench::PerAxis;
use std::sync::LazyLock;

/// Up to this many groups each is held out alone.
pub(super) const MOST_ALONE: usize = 40;
/// Folds that more groups are assigned to.
pub(super) const FOLDS: usize = 10;

/// Numbers in the R factors of groups that are held out alone, 200 MB, and twice as many in those of all others.
const MOST_NUMBERS: usize = 25_000_000;

/// Most rows that families of features are compared on, or so many for each feature of the largest: rows of a group
/// resemble each other, and one in several says as much.
pub(super) const MOST_COMPARED: usize = 16_384;
const ROWS_PER_FEATURE: usize = 64;

/// Folds of the random split that held-out errors are compared with, where no number is given.
pub const RANDOM_FOLDS: usize = 10;

/// Folds of it that are held out.
const HELD_OUT: usize = 2;

/// The random split into so many folds, two of which are held out.
pub fn random_split(folds: usize, seed: u64) -> RandomSplit {
    RandomSplit { folds, held_out: folds.min(HELD_OUT), seed }
}

/// Chooses the family of features, and its ridge if that is zero, by folds of groups of labelled rows.
pub(super) fn select_by_normal_equations(
    data: &Dataset,
    options: &FitOptions<'_>,
) -> Result<Selection, FitError> {
    let largest = options.model_of(data, Basis::Poly3).term_count();
    let most = MOST_COMPARED.max(ROWS_PER_FEATURE * largest);
    let folds = few_by_fold(&GroupedRows::from_labels(data).0, most)?;
    let model = options.model_of(data, Basis::Linear);
    Ok(normal_equations::select(&folds, model, options.ridges())?)
}

/// At most so many rows, as many in turn of each group, and more where groups are many; groups are assigned to folds.
pub(super) fn few_by_fold(rows: &GroupedRows, most: usize) -> Result<GroupedRows, ValidationError> {
    let every = rows.row_count().div_ceil(most).max(1);
    let folds = rows.groups().count().min(selection::FOLDS);
    Ok(rows.every_nth(every).regrouped(&fold_of_groups(rows, folds)?))
}

/// The fold of each group.
fn fold_of_groups(rows: &GroupedRows, folds: usize) -> Result<Vec<usize>, ValidationError> {
    let sizes: Vec<u64> = rows.groups().map(|runs| count(runs) as u64).collect();
    if sizes.len() < 2 {
        return Err(ValidationError::TooFewGroups { found: sizes.len() });
    }
    let mut fold_of = vec![0; sizes.len()];
    for (fold, groups) in assign_groups(&sizes, folds)?.iter().enumerate() {
        groups.iter().for_each(|&group| fold_of[group] = fold);
    }
    Ok(fold_of)
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

/// The errors of a model on groups of labelled rows, each fold held out in turn, and on rows that are assigned at
/// random, unless they remember the rows before.
pub(super) fn cross_validate(
    data: &Dataset,
    held_out: HeldOut,
    (basis, ridge): (Basis, f64),
    options: &FitOptions<'_>,
) -> Result<CrossValidation, FitError> {
    let (rows, labels) = GroupedRows::from_labels(data);
    let groups = labels.len();
    let FitOptions { solver, truncate, workers, .. } = *options;
    let model = options.model_of(data, basis);
    let problem = PolynomialProblem { model, solver, ridge, truncate };
    let are_alone = groups <= MOST_ALONE && groups * model.term_count().pow(2) <= MOST_NUMBERS;
    let (folds, random_folds) = match held_out {
        HeldOut::Folds(folds) => (folds, folds),
        _ if are_alone => (groups, RANDOM_FOLDS),
        _ => (FOLDS, RANDOM_FOLDS),
    };
    let fold_of = fold_of_groups(&rows, folds)?;
    let errors = problem.errors_without_each(&rows.regrouped(&fold_of), folds, workers)?;
    let of_groups = labels.into_iter().zip(&fold_of);
    let undetermined = of_groups.filter(|(_, fold)| errors[**fold].is_err());
    let undetermined = undetermined.map(|(label, _)| label).collect();
    let on_folds = errors.into_iter().map(|errors| (Vec::new(), errors));
    let found = CrossValidation::from_folds((groups, rows.row_count() as u64), on_folds)?;
    let found = CrossValidation { undetermined, ..found };
    if data.memory_terms() > 0 {
        return Ok(found);
    }
    let split = random_split(random_folds, options.seed);
    let parts = GroupedRows::from_split(data, &split);
    let with_rows = (0..split.held_out).filter(|&fold| !parts.group(fold).is_empty()).count();
    let at_random = problem.errors_without_each(&parts, with_rows, workers)?.into_iter();
    Ok(found.beside_random(with_rows, at_random.collect::<Result<_, _>>().ok()))
}

impl PolynomialProblem {
    /// The errors on each of the first groups of rows, of a fit to all others: from R factors of the groups, if the solver
    /// weighs rows alike, and if they have the digits for it.
    fn errors_without_each(
        &self,
        groups: &GroupedRows,
        held_out: usize,
        workers: Workers<'_>,
    ) -> Result<Vec<Result<PerAxis<HeldOutErrors>, FitError>>, FitError> {
        let Self { model, solver, ridge, truncate } = *self;
        let all: Vec<&[Run]> = groups.groups().collect();
        let sample = groups.sample();
        let scaling = Scaling::from_sample(&sample.readings, true);
        let factored = match solver {
            SolverKind::Huber => None,
            _ => {
                let labels = vec![String::new(); all.len()];
                Some(FactoredGroups::from_rows(groups, labels, (model, scaling), workers)?)
            }
        };
        let others = factored.as_ref().and_then(FactoredGroups::without_each);
        let method = r_factor_method(solver, truncate);
        let by_r_factors = |position: usize| {
            let rest = others.as_ref()?[position].solve_by(method, &model, ridge).ok()?;
            factored.as_ref()?.groups[position].1.errors(&rest)
        };
        let copy = |runs: &&[Run]| groups.copied(runs, BLOCK_ROWS).collect::<Vec<_>>();
        let copies = LazyLock::new(|| all.iter().map(copy).collect::<Vec<_>>());
        let refit = |position: usize| {
            let one = Workers { threads: 1, ..workers };
            let kept = copies.iter().enumerate().filter(|(at, _)| *at != position);
            let rows = Rows::from_blocks(kept.flat_map(|(_, blocks)| blocks), one);
            let calibration = calibrate(self, &rows, &sample)?;
            let errors = copies[position].iter().map(|block| errors_on(&calibration, block));
            Ok(HeldOutErrors::total(&errors.collect::<Vec<_>>()))
        };
        let errors = |&position: &usize| match by_r_factors(position) {
            Some(errors) => Ok(Ok(errors)),
            None => match refit(position) {
                Err(FitError::Interrupted) => Err(FitError::Interrupted),
                errors => Ok(errors),
            },
        };
        map(&(0..held_out).collect::<Vec<_>>(), workers, errors)
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
