//! Polynomials in the readings, fitted to rows in memory.

use super::rows::{InMemory, RowSource, rows_sample};
use crate::workflow::WorkflowError;
use crate::workflow::eval::{BlockEvaluator, Evaluation, Look};
use crate::workflow::factored::{append, of_rows};
use crate::workflow::fit::{check_sizes, root_mean_square};
use crate::workflow::groups::GroupBy;
use crate::workflow::model_choice::{
    CovarianceRule, HeldOut, ModelChoice, ModelChoiceOptions, choose_from,
};
use crate::workflow::selection::UsedRows;
use crate::workflow::solving::{Problem, Solved, solve};
use crate::workflow::uncertainty::{CovarianceFrom, GroupsKept, Uncertainty};
use calibration::exact::ExactError;
use calibration::factored::{FactoredGroups, GroupFactors};
use calibration::reading_ranges::ReadingRanges;
use calibration::scaling::Scaling;
use calibration::solver::{Solution, SolverKind};
use calibration::uncertainty::ErrorShape;
use calibration::validation::ValidationError;
use calibration::validation::excitation::WrenchSums;
use calibration::validation::grouped::{
    Apart, BlockGroups, GroupSums, GroupWorker, GroupedMoments, RandomSplit,
};
use calibration::{Basis, Calibration, FitError, Model};
use calibration_file::{CalibrationFile, Diagnostics, Origin, SolverRecord, Source};
use log_file::ReadOptions;
use shell_data::block::Block;

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
    /// For [`SolverKind::Svd`]: see [`FitOptions`](crate::workflow::fit::FitOptions).
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
    if source.has_weights() {
        check_weighted(options)?;
    }
    let choice = choose(source, options)?;
    let basis = choice.as_ref().map_or(options.basis, |choice| Some(choice.basis));
    let basis = basis.unwrap_or(Basis::Poly3);
    let ridge = choice.as_ref().map_or(options.ridge, |choice| choice.ridge);
    let sums = choice.as_ref().and_then(|choice| choice.sums.as_ref());
    let model = Model { basis, intercept: options.intercept, channels: source.channels() };
    let problem = Problem {
        model,
        solver: match options.solver {
            // What the exact solver leaves to it.
            SolverKind::Exact if source.has_weights() => SolverKind::RefinedTsqr,
            solver => solver,
        },
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
        Uncertainty::of(&solution, (solver, options.truncate), ridge, from);
    let unit = covariance.as_ref().map(|_| root_mean_square(&solution));
    let (mut train, mut loads) = (Evaluation::default(), WrenchSums::default());
    let look = Look { size_unit: unit.as_ref(), ..Look::default() };
    let errors = |evaluator: &mut BlockEvaluator, block: &mut Block| {
        (evaluator.evaluate(&calibration, block, &look), WrenchSums::of(&block.wrench))
    };
    let evaluators = rows.each_block(BlockEvaluator::default, errors, |(errors, of_block)| {
        train.add(&errors, None);
        loads.merge(&of_block);
        Ok(())
    })?;
    let quality = train.quality();
    check_sizes(&calibration, &quality)?;
    if let (Some(covariance), Some(unit), Some(quality)) = (&mut covariance, unit, quality) {
        let rms = quality.map(|axis| axis.rms);
        let sizes = BlockEvaluator::sizes(evaluators);
        covariance.shape = sizes.map(|sizes| ErrorShape::of_errors(&sizes, &unit, &rms));
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
    if source.has_weights() {
        return Err(WorkflowError::Weights { what: "a partial fit" });
    }
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

/// Factors rows by their labels, where they cannot be summed exactly.
fn factor(
    source: &dyn RowSource,
    basis: Basis,
    threads: usize,
) -> Result<FactoredGroups, WorkflowError> {
    let scaling = Scaling::of_sample(&rows_sample(source).readings, true);
    let mut groups = GroupFactors::new(basis, scaling);
    InMemory { source, threads }.each_block(
        || (),
        |(), block| std::mem::take(block),
        |block| groups.add(&block).map_err(of_rows),
    )?;
    groups.finish().map_err(of_rows)
}

/// All rows with their labels.
fn grouped_rows(source: &dyn RowSource, threads: usize) -> Result<Block, WorkflowError> {
    let mut all = Block::default();
    InMemory { source, threads }.each_block(
        || (),
        |(), block| std::mem::take(block),
        |block| {
            append(&mut all, block);
            Ok(())
        },
    )?;
    Ok(all)
}

/// What can be had of rows that have weights, which no exact sum can take: a plain least-squares fit, and
/// standard errors by row.
fn check_weighted(options: &RowFitOptions) -> Result<(), WorkflowError> {
    let what = match options {
        RowFitOptions { basis: None, .. } => "the choice of a model",
        RowFitOptions { cross_validation: Some(_), .. } => "cross-validation",
        RowFitOptions { covariance: CovarianceRule::Groups, .. } => "a covariance by group",
        RowFitOptions { ridge, .. } if *ridge != 0.0 => "a ridge",
        RowFitOptions { truncate: Some(_), .. } => "a truncated solution",
        RowFitOptions { solver: SolverKind::RidgeGcv | SolverKind::Huber, .. } => "this solver",
        _ => return Ok(()),
    };
    Err(WorkflowError::Weights { what })
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
    let has_labels = source.has_groups() && !source.has_weights();
    let labels = has_labels.then_some(&GroupBy::Column);
    if !asked.validates() && !asked.wants_groups(labels) {
        return Ok(None);
    }
    if labels.is_none() {
        return Err(WorkflowError::NoGroupLabels);
    }
    let basis = options.basis.unwrap_or(Basis::Poly3);
    let sum = |apart| sum(source, basis, (apart, asked.random_split()), options.threads);
    let keep = |choice: ModelChoice| match GroupsKept::of(options.solver) {
        GroupsKept::Rows => Ok(asked.decide_rows(choice, grouped_rows(source, options.threads)?)),
        _ => {
            let rows = factor(source, choice.basis, options.threads);
            asked.decide_factored(choice, rows)
        }
    };
    let sums_serve = GroupsKept::of(options.solver) == GroupsKept::Sums;
    if !asked.validates() && !sums_serve {
        return keep(asked.open(Some(GroupBy::Column))).map(Some);
    }
    match asked.sum_apart(sum) {
        Err(WorkflowError::Fit(FitError::NotExact(_))) if !asked.validates() => {
            let choice = asked.open(Some(GroupBy::Column));
            asked.decide_factored(choice, factor(source, basis, options.threads)).map(Some)
        }
        // Better standard errors were not asked for by name.
        Err(WorkflowError::Validation(_))
            if !asked.validates() && options.covariance == CovarianceRule::Auto =>
        {
            Ok(None)
        }
        sums => match choose_from(sums?, GroupBy::Column, &asked)? {
            choice if choice.by_group && !sums_serve => keep(choice).map(Some),
            choice => Ok(Some(choice)),
        },
    }
}
