//! A fit to rows in memory: what [`fit`](super::fit) and [`model_choice`](super::model_choice) do for logs,
//! for callers that have arrays.
//!
//! Rows are taken in blocks of [`BLOCK_ROWS`], on several threads, wherever and in whatever layout the
//! caller keeps them. Coefficients, covariance and held-out errors are the bits that a log of the same rows
//! gives.

use std::ops::Range;

use super::WorkflowError;
use super::eval::{BlockErrors, Evaluation};
use super::fit::{check_sizes, root_mean_square, shape};
use super::groups::GroupBy;
use super::model_choice::{CovarianceRule, HeldOut, ModelChoice, ModelChoiceOptions, choose_from};
use super::selection::UsedRows;
use super::solving::{Problem, Solved, solve};
use super::uncertainty::{CovarianceFrom, Uncertainty};
use crate::calibration_file::{CalibrationFile, Diagnostics, Origin, SolverRecord, Source};
use calibration::exact::ExactError;
use calibration::reading_ranges::ReadingRanges;
use calibration::solver::{Blocks, Pass, PassWorker, Solution, SolverKind};
use calibration::validation::ValidationError;
use calibration::validation::excitation::WrenchSums;
use calibration::validation::grouped::{
    Apart, BlockGroups, GroupSums, GroupWorker, GroupedMoments, RandomSplit,
};
use calibration::{Basis, Calibration, FitError, Model};
use log_file::ReadOptions;
use log_file::pipeline::{self, Pieces};
use shell_data::block::Block;

/// Rows that are worked on at a time.
pub const BLOCK_ROWS: usize = 4096;

/// Rows that a sample has.
const SAMPLE_ROWS: usize = 1024;

/// Rows of readings and wrench in memory.
pub trait RowSource: Sync {
    /// Their number.
    fn rows(&self) -> usize;

    /// Number of channels.
    fn channels(&self) -> usize;

    /// Whether rows have labels of groups.
    fn has_groups(&self) -> bool;

    /// Puts some rows into a block: readings, wrench and, where there are any, labels.
    fn fill(&self, rows: Range<usize>, block: &mut Block);

    /// Whether the caller wants no more of it.
    fn is_stopped(&self) -> bool {
        false
    }
}

/// What is to be fitted, and how.
#[derive(Clone, Copy, Debug)]
pub struct RowFitOptions {
    /// The family of features; `None` for the smallest that predicts new groups as well as the best.
    pub basis: Option<Basis>,
    /// Whether to fit a constant beside them.
    pub intercept: bool,
    /// λ of a ridge on columns of norm one, 0 for none.
    pub ridge: f64,
    /// The solver. Where the exact one cannot take the rows, refined QR does.
    pub solver: SolverKind,
    /// For [`SolverKind::Svd`]: see [`FitOptions`](super::fit::FitOptions).
    pub truncate: Option<f64>,
    /// Find the errors on each group, or on so many folds of groups.
    pub cross_validation: Option<Option<usize>>,
    /// Which way rows are dealt into random folds.
    pub seed: u64,
    /// What the covariance is found from.
    pub covariance: CovarianceRule,
    /// Threads; 0 for one per core.
    pub threads: usize,
}

/// A calibration and how well it does.
#[derive(Debug)]
pub struct RowFit {
    /// The calibration.
    pub calibration: Calibration,
    /// What the solver says.
    pub solution: Solution,
    /// The solver that was used.
    pub solver: SolverKind,
    /// What the groups said before.
    pub choice: Option<ModelChoice>,
    /// λ of the ridge.
    pub ridge: f64,
    /// For [`SolverKind::Svd`].
    pub truncate: Option<f64>,
    /// Why the solver is not the exact one, where that was asked for.
    pub not_exact: Option<ExactError>,
    /// Why groups were asked for and the covariance is that of independent rows.
    pub not_grouped: Option<ValidationError>,
    /// Errors on the rows.
    pub train: Evaluation,
    /// The wrench that was measured.
    pub loads: WrenchSums,
}

impl RowFit {
    /// The calibration file: made by `made_by` on `date`, from `sources`.
    ///
    /// # Errors
    /// [`WorkflowError::NoRows`] if there were none.
    pub fn file(
        self,
        (made_by, date): (String, String),
        sensor_serial: Option<String>,
        sources: Vec<Source>,
    ) -> Result<CalibrationFile, WorkflowError> {
        let (condition, train) = (self.solution.condition, self.train.quality());
        let (cross_validation, selection) =
            self.choice.map_or((None, None), |choice| (choice.cross_validation, choice.selection));
        Ok(CalibrationFile {
            calibration: self.calibration,
            origin: Origin {
                made_by,
                date,
                sensor_serial,
                solver: Some(SolverRecord {
                    name: self.solver,
                    ridge: self.solution.ridge,
                    truncate: self.truncate,
                }),
                diagnostics: Some(Diagnostics {
                    rows: self.solution.rows,
                    skipped_rows: 0,
                    repeated_rows: 0,
                    rank: self.solution.rank,
                    condition: condition.is_finite().then_some(condition),
                    train: train.ok_or(WorkflowError::NoRows)?,
                    test: None,
                    cross_validation,
                    selection,
                    excitation: self.loads.excitation(),
                }),
                sources,
                columns: None,
            },
        })
    }
}

/// Fits a calibration to rows and finds its errors on them.
///
/// # Errors
/// [`WorkflowError`] if the rows do not determine the coefficients, something is asked of groups where
/// there are none, or the caller stopped it.
pub fn fit(source: &dyn RowSource, options: &RowFitOptions) -> Result<RowFit, WorkflowError> {
    let choice = choose(source, options)?;
    let basis = choice.as_ref().map_or(options.basis, |choice| Some(choice.basis));
    let basis = basis.unwrap_or(Basis::Poly3);
    let ridge = choice.as_ref().map_or(options.ridge, |choice| choice.ridge);
    let sums = choice.as_ref().and_then(|choice| choice.sums.as_ref());
    let model = Model { basis, intercept: options.intercept, channels: source.channels() };
    let problem = Problem {
        model,
        solver: options.solver,
        ridge,
        truncate: options.truncate,
        total: sums.and_then(GroupedMoments::total),
    };
    let mut rows = InMemory { source, threads: options.threads };
    let sample = || Ok(rows_sample(source));
    let Solved { solution, ranges, solver, not_exact, .. } = solve(&problem, &mut rows, sample)?;
    let mut calibration = Calibration::of_solution(&solution, &ranges);
    let from = match &choice {
        Some(choice) => choice.covariance_from(options.covariance),
        None if options.covariance == CovarianceRule::Nothing => CovarianceFrom::Nothing,
        None => CovarianceFrom::Rows,
    };
    let Uncertainty { mut covariance, not_grouped } =
        Uncertainty::of(&solution, solver, ridge, from);
    let unit = covariance.as_ref().map(|_| root_mean_square(&solution));
    let (mut train, mut loads) = (Evaluation::default(), WrenchSums::default());
    let errors = |(): &mut (), block: &mut Block| {
        let errors = BlockErrors::of(&calibration, block, unit.as_ref(), false, None);
        (errors, WrenchSums::of(&block.wrench))
    };
    rows.each_block(
        || (),
        errors,
        |(errors, of_block)| {
            train.add(&errors, None);
            loads.merge(&of_block);
            Ok(())
        },
    )?;
    check_sizes(&calibration, &train.quality())?;
    if let (Some(covariance), Some(unit)) = (&mut covariance, unit) {
        covariance.shape = shape(std::slice::from_ref(&train), &unit);
    }
    calibration.covariance = covariance;
    Ok(RowFit {
        calibration,
        solution,
        solver,
        choice,
        ridge,
        truncate: options.truncate,
        not_exact,
        not_grouped,
        train,
        loads,
    })
}

/// Sums rows by their labels as `apart` says, or all under one.
///
/// # Errors
/// [`WorkflowError`] if they cannot be summed exactly, or the caller stopped it.
pub fn sum(
    source: &dyn RowSource,
    basis: Basis,
    (apart, random): (Apart, RandomSplit),
    threads: usize,
) -> Result<GroupedMoments, WorkflowError> {
    let channels = source.channels();
    Model { basis, intercept: true, channels }.check_size().map_err(FitError::from)?;
    let mut sums = GroupSums::new(basis, channels, apart, random);
    let empty = sums.worker();
    let has_groups = source.has_groups();
    let work =
        |worker: &mut GroupWorker, block: &mut Block| -> Result<BlockGroups, WorkflowError> {
            // Names what is not finite, as every fit does.
            ReadingRanges::of_block(block, channels)?;
            if !has_groups {
                block.groups = vec![(String::new(), block.rows)];
            }
            Ok(worker.add(block)?)
        };
    let workers = InMemory { source, threads }.each_block(
        || empty.clone(),
        work,
        |groups| Ok(sums.add(groups?)?),
    )?;
    Ok(sums.finish(workers)?)
}

fn choose(
    source: &dyn RowSource,
    options: &RowFitOptions,
) -> Result<Option<ModelChoice>, WorkflowError> {
    let asked = ModelChoiceOptions {
        basis: options.basis,
        intercept: options.intercept,
        ridge: options.ridge,
        solver: options.solver,
        cross_validation: options.cross_validation.map(HeldOut::from),
        seed: options.seed,
        covariance: options.covariance,
        used: UsedRows::default(),
        memory: 0,
        read: ReadOptions::default(),
    };
    let labels = source.has_groups().then_some(&GroupBy::Column);
    if !asked.validates() && !asked.wants_groups(labels) {
        return Ok(None);
    }
    if labels.is_none() {
        return Err(WorkflowError::NoGroupLabels);
    }
    let basis = options.basis.unwrap_or(Basis::Poly3);
    let sum = |apart| sum(source, basis, (apart, asked.random_split()), options.threads);
    match asked.sum_apart(sum) {
        // Better standard errors were not asked for by name.
        Err(WorkflowError::Fit(FitError::NotExact(_)) | WorkflowError::Validation(_))
            if !asked.validates() && options.covariance == CovarianceRule::Auto =>
        {
            Ok(None)
        }
        sums => choose_from(sums?, GroupBy::Column, &asked).map(Some),
    }
}

/// The rows of a source, as solvers pass over them.
struct InMemory<'a> {
    source: &'a dyn RowSource,
    threads: usize,
}

/// Where the next block begins.
struct BlockRanges<'a> {
    next: usize,
    source: &'a dyn RowSource,
}

/// The caller wants no more.
struct Stopped;

impl Pieces for BlockRanges<'_> {
    type Piece = Block;
    type Error = Stopped;

    fn ended(&self) -> bool {
        self.next >= self.source.rows()
    }

    fn next(&mut self, block: &mut Block) -> Result<bool, Stopped> {
        if self.source.is_stopped() {
            return Err(Stopped);
        }
        // The piece is filled by the thread that gets it: this says which rows.
        block.rows = self.next;
        let is_there = !self.ended();
        self.next += BLOCK_ROWS;
        Ok(is_there)
    }
}

impl InMemory<'_> {
    /// Passes every block to `work`, on any thread, and what comes of it to `fold`, in order. Returns the
    /// states of the threads.
    fn each_block<S: Send, T: Send>(
        &self,
        init: impl Fn() -> S + Sync,
        work: impl Fn(&mut S, &mut Block) -> T + Sync,
        fold: impl FnMut(T) -> Result<(), WorkflowError>,
    ) -> Result<Vec<S>, WorkflowError> {
        let source = self.source;
        let threads = ReadOptions { threads: self.threads, ..ReadOptions::default() };
        let work = |state: &mut S, block: &mut Block| {
            let rows = block.rows..source.rows().min(block.rows + BLOCK_ROWS);
            source.fill(rows, block);
            work(state, block)
        };
        let mut ranges = BlockRanges { next: 0, source };
        let stopped = |Stopped| WorkflowError::Interrupted;
        pipeline::run(&mut ranges, threads.thread_count(), init, work, stopped, fold)
    }
}

impl Blocks for InMemory<'_> {
    type Error = WorkflowError;

    fn sample(&self) -> Option<Block> {
        (self.source.rows() > 0).then(|| rows_sample(self.source))
    }

    fn pass<P: Pass>(&mut self, pass: &P) -> Result<P::Partial, WorkflowError> {
        let mut all = pass.empty();
        let reduce = |worker: &mut PassWorker<'_, P>, block: &mut Block| worker.reduce(block);
        let workers = self.each_block(
            || PassWorker::new(pass),
            reduce,
            |partial| {
                if let Some(partial) = partial? {
                    pass.merge(&mut all, partial);
                }
                Ok(())
            },
        )?;
        PassWorker::merge(workers, &mut all);
        Ok(all)
    }
}

/// Rows from all over the source.
fn rows_sample(source: &dyn RowSource) -> Block {
    let rows = source.rows();
    if rows <= SAMPLE_ROWS {
        let mut block = Block::default();
        source.fill(0..rows, &mut block);
        return block;
    }
    let (mut sample, mut part) = (Block::default(), Block::default());
    const PARTS: usize = 16;
    for i in 0..PARTS {
        let start = (rows - SAMPLE_ROWS / PARTS) * i / (PARTS - 1);
        source.fill(start..start + SAMPLE_ROWS / PARTS, &mut part);
        sample.rows += part.rows;
        for (all, part) in
            [(&mut sample.readings, &mut part.readings), (&mut sample.wrench, &mut part.wrench)]
        {
            all.resize_with(part.len(), Vec::new);
            all.iter_mut().zip(part).for_each(|(all, part)| all.append(part));
        }
    }
    sample
}
