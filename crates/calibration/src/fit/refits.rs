//! Solutions of a polynomial, from rows or sums, and errors on held-out rows. The fit without a group comes from
//! exact sums for the exact solver; otherwise from R factors of the folds, if the solver weights all rows equally, or
//! from a new fit. Up to forty groups are held out one by one, more in ten folds.

use super::options::FitOptions;
use crate::conversion::Calibration;
use crate::groups::HeldOut;
use least_squares::error::FitError;
use least_squares::exact::{ExactError, ExactSums};
use least_squares::factored::FactoredGroups;
use least_squares::grouped_rows::{GroupedRows, Run, count};
use least_squares::held_out_errors::HeldOutErrors;
use least_squares::methods::Method;
use least_squares::model::{Basis, LARGEST, Model};
use least_squares::passes::{Rows, Workers, each, map};
use least_squares::quality::AxisQuality;
use least_squares::random_split::RandomSplit;
use least_squares::reading_ranges::ReadingRanges;
use least_squares::scaling::Scaling;
use least_squares::solver::{self, FitProblem, ReadingSums, Solution, SolverKind};
use least_squares::validation::cross_validation::{CrossValidation, assign_groups};
use least_squares::validation::grouped::{Apart, GroupSums, GroupWorker, SumsByGroup};
use least_squares::validation::normal_equations;
use least_squares::validation::selection::{self, Selection};
use shell_data::block::Block;
use shell_data::dataset::{BLOCK_ROWS, Dataset, LabelledBlock};
use shell_data::wrench::PerAxis;
use std::sync::LazyLock;

pub(super) const MOST_ALONE: usize = 40;
pub(super) const FOLDS: usize = 10;

/// Most values in the R factors of groups that are held out alone: 200 MB, and twice that for the factors without each.
const MOST_NUMBERS: usize = 25_000_000;

/// Most rows on which families are compared, in total and per feature of the largest family; the larger number
/// counts. Rows of a group resemble each other: one in several is enough.
pub(super) const MOST_COMPARED: usize = 16_384;
const ROWS_PER_FEATURE: usize = 64;

/// Smallest squared errors, relative to the variances of the loads, that normal equations give with six digits:
/// such errors are differences of sums as large as the loads.
const LEAST_SCORE: f64 = 1e-9;

/// Number of folds of the random split that held-out errors are compared with, if no number is given.
pub const RANDOM_FOLDS: usize = 10;

const HELD_OUT: usize = 2;

/// The random split into the given number of folds. Two of them are held out.
pub fn random_split(folds: usize, seed: u64) -> RandomSplit {
    RandomSplit { folds, held_out: folds.min(HELD_OUT), seed }
}

/// Chooses the family of features by folds of groups, and the ridge if the options have none. Also returns the errors
/// on each fold, if no row was left out and the errors are far above rounding.
pub(super) fn select_by_normal_equations(
    data: &Dataset,
    options: &FitOptions<'_>,
) -> Result<(Selection, Option<HeldOutFolds>), FitError> {
    let largest = options.model_of(data, Basis::Poly3).term_count();
    let most = MOST_COMPARED.max(ROWS_PER_FEATURE * largest);
    let rows = GroupedRows::from_labels(data).0;
    let folds = few_by_fold(&rows, most)?;
    let model = options.model_of(data, Basis::Linear);
    let tried = normal_equations::select(&folds, model, options.ridges(), options.workers)?;
    let are_all = folds.row_count() == rows.row_count();
    let chosen = tried.selection.candidates[tried.selection.chosen].errors;
    let are_exact = chosen.is_some_and(|errors| errors.score > LEAST_SCORE);
    let errors = (are_all && are_exact).then(|| tried.chosen_errors().to_vec());
    Ok((tried.selection, errors))
}

/// Takes every n-th row of each group, about `most` rows, and assigns groups to folds.
pub(super) fn few_by_fold(rows: &GroupedRows, most: usize) -> Result<GroupedRows, FitError> {
    let every = rows.row_count().div_ceil(most).max(1);
    let folds = rows.groups().count().min(selection::FOLDS);
    Ok(rows.every_nth(every).regrouped(&fold_of_groups(rows, folds)?))
}

pub(super) fn fold_of_groups(rows: &GroupedRows, folds: usize) -> Result<Vec<usize>, FitError> {
    let sizes: Vec<u64> = rows.groups().map(|runs| count(runs) as u64).collect();
    if sizes.len() < 2 {
        return Err(FitError::TooFewGroups { found: sizes.len() });
    }
    let mut fold_of = vec![0; sizes.len()];
    for (fold, groups) in assign_groups(&sizes, folds)?.iter().enumerate() {
        groups.iter().for_each(|&group| fold_of[group] = fold);
    }
    Ok(fold_of)
}

pub(super) type HeldOutFolds = Vec<PerAxis<HeldOutErrors>>;

/// Finds errors on folds of groups and, unless memory terms tie rows together, on random rows. `known` has the errors
/// on [`selection::FOLDS`] folds, or on each of fewer groups, if the choice of the model has found them.
pub(super) fn cross_validate(
    data: &Dataset,
    held_out: HeldOut,
    (basis, ridge): (Basis, f64),
    known: Option<HeldOutFolds>,
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
    // The choice assigns groups to folds in the same way.
    let errors = match known.filter(|known| known.len() == folds && solver == SolverKind::Exact) {
        Some(known) => known.into_iter().map(Ok).collect(),
        None => problem.errors_without_each(&rows.regrouped(&fold_of), folds, workers)?,
    };
    let mut labels_of = vec![Vec::new(); folds];
    labels.into_iter().zip(&fold_of).for_each(|(label, fold)| labels_of[*fold].push(label));
    let on_folds = labels_of.into_iter().zip(errors);
    let found = CrossValidation::from_folds((groups, rows.row_count() as u64), on_folds)?;
    if data.memory_terms() > 0 {
        return Ok(found);
    }
    let split = random_split(random_folds, options.seed);
    let parts = GroupedRows::from_split(data, &split);
    let with_rows = (0..split.held_out).filter(|&fold| !parts.group(fold).is_empty()).count();
    let at_random = problem.errors_without_each(&parts, with_rows, workers)?.into_iter();
    Ok(found.beside_random(with_rows, at_random.collect::<Result<_, _>>().ok()))
}

/// Sums by group, or by set of groups if there are too many.
pub(super) fn sum_groups_or_sets(
    rows: &Dataset,
    basis: Basis,
    options: &FitOptions<'_>,
) -> Result<SumsByGroup, FitError> {
    let random = options.validation().map_or_else(RandomSplit::default, |_| {
        random_split(options.folds(0).unwrap_or(RANDOM_FOLDS), options.seed)
    });
    match sum_groups(rows, basis, (Apart::Groups, random), options.workers) {
        Err(FitError::TooManyGroups { .. }) if options.folds(usize::MAX).is_some() => {
            sum_groups(rows, basis, (Apart::Sets, random), options.workers)
        }
        sums => sums,
    }
}

/// Sums labelled rows exactly by group or set, and rows drawn at random.
///
/// # Errors
/// [`FitError`] if the rows cannot be summed exactly, or there are too many groups.
pub fn sum_groups(
    data: &Dataset,
    basis: Basis,
    (apart, random): (Apart, RandomSplit),
    workers: Workers<'_>,
) -> Result<SumsByGroup, FitError> {
    if data.has_weights() {
        return Err(FitError::Weights("a partial fit"));
    }
    let channels = data.channels();
    if data.memory_terms() > 0 {
        return Err(FitError::NotExact(ExactError::MemoryTerms));
    }
    Model { basis, intercept: true, channels, memory: 0 }.check_size()?;
    let mut sums = GroupSums::new(basis, channels, apart, random);
    let empty = sums.worker();
    let work = |worker: &mut GroupWorker, (_, block): &(usize, &LabelledBlock)| {
        ReadingRanges::from_block(&block.rows, channels)?;
        worker.add(&block.rows, &block.labels)
    };
    let blocks: Vec<_> = data.blocks().collect();
    let init = || empty.clone();
    let own =
        each(&blocks, |(_, block)| &block.rows, workers, init, work, |groups| sums.add(groups))?;
    sums.finish(own)
}

#[derive(Clone, Copy, Debug)]
pub(super) struct PolynomialProblem {
    pub(super) model: Model,
    pub(super) solver: SolverKind,
    pub(super) ridge: f64,
    pub(super) truncate: Option<f64>,
}

#[derive(Clone)]
pub(super) struct Solved {
    pub(super) solution: Solution,
    pub(super) ranges: ReadingRanges,
    pub(super) solver: SolverKind,
    pub(super) not_exact: Option<ExactError>,
    pub(super) sums: Option<ExactSums>,
}

/// Solves by the requested solver, with the exact sums `total` if they exist. Solvers that need a scaling before the
/// first pass take it from `sample`.
pub(super) fn solve(
    problem: &PolynomialProblem,
    total: Option<&ExactSums>,
    rows: &Rows<'_>,
    sample: Option<&Block>,
) -> Result<Solved, FitError> {
    let PolynomialProblem { model, mut solver, ridge, truncate } = *problem;
    let mut not_exact = None;
    if solver == SolverKind::Exact {
        match total.map_or_else(|| solver::exact_sums(model, rows), |total| Ok(total.clone())) {
            Ok(sums) => {
                let ranges = sums.reading_ranges();
                let solution = sums.solve(&model, ridge)?.solution;
                return Ok(Solved { solution, ranges, solver, not_exact, sums: Some(sums) });
            }
            Err(FitError::NotExact(error)) => not_exact = Some(error),
            Err(error) => return Err(error),
        }
        solver = SolverKind::RefinedTsqr;
    }
    let is_penalised = ridge > 0.0
        || solver == SolverKind::RidgeGcv
        || (solver == SolverKind::Svd && truncate.is_some());
    let scaling = match sample.filter(|_| !is_penalised) {
        Some(sample) => Scaling::from_sample(&sample.readings, model.intercept),
        None => rows.reduce(&ReadingSums::new(model.columns()))?.scaling(model.intercept),
    };
    let problem = FitProblem { model, scaling, ridge };
    let (solution, ranges) = solver::fit_by(Method { solver, truncate }, problem, rows)?;
    Ok(Solved { solution, ranges, solver, not_exact, sums: None })
}

pub(super) fn check_sizes<'a>(
    calibration: &Calibration,
    errors: impl IntoIterator<Item = &'a PerAxis<AxisQuality>>,
) -> Result<(), FitError> {
    let is_small = |axis: &AxisQuality| axis.rms * axis.rms <= LARGEST;
    let coefficients = calibration.polynomial().map_or(&[][..], |of| &of.coefficients);
    let is_large = |coefficient: &f64| coefficient.abs() > LARGEST;
    if !errors.into_iter().flatten().all(is_small) || coefficients.iter().flatten().any(is_large) {
        return Err(FitError::Overflow);
    }
    Ok(())
}

impl PolynomialProblem {
    /// Errors, on each of the first `held_out` groups, of a fit without it. The fit comes from R factors if the solver
    /// weights rows equally and the factors have enough digits, else from the rows.
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
        let method = Method { solver, truncate };
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
            let Solved { solution, ranges, .. } = solve(self, None, &rows, Some(&sample))?;
            let calibration = Calibration::from_solution(&solution, &ranges);
            check_sizes(&calibration, [])?;
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
