//! From training logs to a calibration: one pass to fit or several, one to find the errors.
//!
//! The exact sums tell root mean square, bias and R² of the errors as well, so logs whose rows do not fit into
//! memory are passed over once, unless more is asked for.

use std::sync::atomic::{AtomicU64, Ordering};

use super::eval::{BlockEvaluator, Evaluation, Look};
use super::log_facts::{Gathering, LogFacts};
pub use super::log_rows::MEMORY;
use super::log_rows::{LogRows, may_exceed, store};
use super::selection::UsedRows;
use super::solving::{Problem, Solved, solve};
pub use super::uncertainty::CovarianceFrom;
use super::uncertainty::Uncertainty;
use super::{WorkflowError, agree_on_axes, check_logs};
use calibration::exact::{ExactError, Moments, PartitionedMoments};
use calibration::magnitudes::Magnitudes;
use calibration::quality::AxisQuality;
use calibration::reading_ranges::ReadingRanges;
use calibration::solver::{Solution, SolverKind};
use calibration::uncertainty::ErrorShape;
use calibration::validation::ValidationError;
use calibration::validation::excitation::WrenchSums;
use calibration::validation::outliers::{Judge, Spread};
use calibration::{Basis, Calibration, FitError, Model, Polynomial};
use calibration_file::LARGEST;
use figures::FitPlot;
use log_file::{Log, ReadOptions, Wanted};
use shell_data::block::Block;
use shell_data::wrench::PerAxis;

/// What is to be fitted, and how.
#[derive(Clone, Copy)]
pub struct FitOptions<'a> {
    /// The family of features.
    pub basis: Basis,
    /// Whether to fit a constant beside them.
    pub intercept: bool,
    /// The solver. Where the exact one cannot take the rows, refined QR does.
    pub solver: SolverKind,
    /// λ of a ridge on columns of norm one, 0 for none.
    pub ridge: f64,
    /// For [`SolverKind::Svd`]: leaves out directions whose singular value, of columns of norm one,
    /// is below this share of the largest.
    pub truncate: Option<f64>,
    /// Which rows of the training logs are used; of the test logs those that are fresh, if that is asked.
    pub used: UsedRows<'a>,
    /// The exact sums of the training rows, where they have been made already: the exact solver
    /// then does not read the rows again.
    pub total: Option<&'a Moments>,
    /// What was gathered of the training logs when those were made.
    pub facts: Option<&'a LogFacts>,
    /// What the covariance is to be found from.
    pub covariance: CovarianceFrom<'a>,
    /// Reduce predictions and measurements to what a figure needs.
    pub plot: bool,
    /// Look whether any training row does not belong.
    pub looks: bool,
    /// Find the error of every training row, its largest ones and whatever stands out, also where that means
    /// reading the training logs again.
    pub residuals: bool,
    /// The memory in bytes that rows may take. Logs whose rows take more are read again for every pass, but
    /// for the last one over the training logs, which the exact sums spare.
    pub memory: u64,
    /// How logs are read. Progress counts the bytes of all passes, see [`FitOptions::bytes_to_read`].
    pub read: ReadOptions<'a>,
}

impl Default for FitOptions<'_> {
    /// The defaults of `shellcal fit`.
    fn default() -> Self {
        Self {
            basis: Basis::Cubic,
            intercept: true,
            solver: SolverKind::Exact,
            ridge: 0.0,
            truncate: None,
            used: UsedRows::default(),
            total: None,
            facts: None,
            covariance: CovarianceFrom::Nothing,
            plot: false,
            looks: false,
            residuals: false,
            memory: MEMORY,
            read: ReadOptions::default(),
        }
    }
}

/// A calibration and how well it does.
#[derive(Debug)]
pub struct Fit {
    /// The calibration.
    pub calibration: Calibration,
    /// What the solver says.
    pub solution: Solution,
    /// The solver that was used.
    pub solver: SolverKind,
    /// Why it is not the exact one, where that was asked for.
    pub not_exact: Option<ExactError>,
    /// Why groups were asked for and the covariance is that of independent rows.
    pub not_grouped: Option<ValidationError>,
    /// What each training log was, and the errors on it where rows were passed over again.
    pub train: Vec<Evaluation>,
    /// Errors on all training rows; without the largest where the rows were passed over once.
    pub train_quality: PerAxis<AxisQuality>,
    /// The wrench that the training logs have measured.
    pub loads: WrenchSums,
    /// Errors on each test log.
    pub test: Vec<Evaluation>,
    /// The share of test rows on plateaus of the training logs, where those are made of plateaus.
    pub on_plateaus: Option<f64>,
    /// Whether a training row does not belong, if that was asked.
    pub stands_out: bool,
    /// What became of training logs whose rows take more memory than they may.
    pub beyond_memory: Option<BeyondMemory>,
    /// What a figure needs of training and test logs.
    pub plots: Option<(FitPlot, FitPlot)>,
}

/// Training logs whose rows take more memory than they may.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BeyondMemory {
    /// What the rows would take, about.
    pub wanted: u64,
    /// Whether they were read again for the error of every row.
    pub read_again: bool,
}

impl FitOptions<'_> {
    /// Whether the rows of training logs are wanted after the coefficients are known, wherever they are.
    fn wants_rows(&self) -> bool {
        self.residuals || self.plot || self.solver != SolverKind::Exact
    }

    /// The bytes that [`fit`] reads, at most: training logs once or twice, test logs once.
    pub fn bytes_to_read(&self, train: &[Log], test: &[Log]) -> u64 {
        let bytes = |logs: &[Log]| logs.iter().map(Log::bytes).sum::<u64>();
        let passes = if self.wants_rows() || self.total.is_some() { 2 } else { 1 };
        passes * bytes(train) + bytes(test)
    }
}

/// Fits a calibration to `train` and finds its errors there and on `test`, all of which have the same axes of
/// the wrench ([`agree_on_axes`]).
///
/// The training logs are passed over twice, for the coefficients and for the errors, and more
/// often by solvers that iterate. Their rows are kept between the passes, those of the test logs among
/// them, unless they take more than [`FitOptions::memory`], so that memory does not grow with them. Longer logs
/// are passed over once by the exact solver, whose sums tell all but the largest errors, and read again by
/// others or where [`FitOptions::residuals`] or a figure is asked for.
///
/// # Errors
/// [`WorkflowError`] if a log cannot be read, the logs differ in their number of channels, or the
/// rows do not determine the coefficients.
pub fn fit(train: &[Log], test: &[Log], options: &FitOptions<'_>) -> Result<Fit, WorkflowError> {
    let first = check(train, test)?;
    let train_bytes: u64 = train.iter().map(Log::bytes).sum();
    let read_before = AtomicU64::new(0);
    let report = |bytes: u64| {
        if let Some(progress) = options.read.progress {
            progress(read_before.load(Ordering::Relaxed) + bytes);
        }
    };
    let read = ReadOptions { progress: Some(&report), ..options.read };
    let mut store = store(train, test, options.memory);
    let wants_shape = !matches!(options.covariance, CovarianceFrom::Nothing);
    let spreads = wants_shape && !options.wants_rows() && may_exceed(train, options.memory);
    let gathering = Gathering::new(train, test, spreads);
    let gathered = (gathering, options.facts.cloned().unwrap_or_default());
    let mut rows =
        LogRows::new([train, test], gathered, options.used, read, store.room(), options.memory);
    let Solved { solution, ranges, solver, not_exact, moments } =
        solve_rows(first, &mut rows, options)?;
    let mut calibration = Calibration::of_solution(&solution, &ranges);
    calibration.axes = first.axes();
    let Uncertainty { mut covariance, not_grouped } =
        Uncertainty::of(&solution, (solver, options.truncate), options.ridge, options.covariance);
    let size_unit = covariance.as_ref().map(|_| root_mean_square(&solution));
    let wanted = rows.beyond_memory();
    let has_shape = size_unit.is_none() || rows.facts().spread().is_some();
    let is_enough = solver == SolverKind::Exact && !options.wants_rows() && has_shape;
    let sums = moments.as_ref().or(options.total).filter(|_| wanted.is_some() && is_enough);
    let judge = (options.looks && sums.is_none()).then(|| {
        let spread = Spread::within(&ranges);
        Some((Judge::new(&solution, &ranges, &spread)?, spread))
    });
    let judge = judge.flatten();
    let judge = judge.as_ref().map(|(judge, spread)| (judge, spread));
    if sums.is_none() && !rows.keeps_training() {
        read_before.store(train_bytes, Ordering::Relaxed);
    }
    let look = Look { size_unit: size_unit.as_ref(), plot: options.plot, judge };
    let first = if sums.is_some() { rows.train() } else { 0 };
    let Errors { train, test, sizes, stands_out, plots } =
        errors(&calibration, &mut rows, first, &look)?;
    let train_quality = match sums {
        Some(sums) => in_sample(sums, &solution)?,
        None => total(&train).quality().ok_or(WorkflowError::NoRows)?,
    };
    let tested = total(&test).quality();
    check_sizes(&calibration, [Some(&train_quality), tested.as_ref()].into_iter().flatten())?;
    if let (Some(covariance), Some(unit)) = (&mut covariance, size_unit) {
        let sizes = match rows.facts().spread().filter(|_| sums.is_some()) {
            Some(spread) => {
                let mut evaluator = BlockEvaluator::default();
                let look = Look { size_unit: Some(&unit), ..Look::default() };
                evaluator.evaluate(&calibration, spread.block(), &look);
                BlockEvaluator::sizes([evaluator])
            }
            None => sizes,
        };
        let rms = train_quality.map(|axis| axis.rms);
        covariance.shape = sizes.map(|sizes| ErrorShape::of_errors(&sizes, &unit, &rms));
    }
    calibration.covariance = covariance;
    let facts = rows.facts();
    Ok(Fit {
        calibration,
        solver,
        not_exact,
        not_grouped,
        train,
        train_quality,
        loads: *facts.loads(),
        test,
        on_plateaus: facts.share_on_plateaus(),
        stands_out,
        beyond_memory: wanted.map(|wanted| BeyondMemory { wanted, read_again: sums.is_none() }),
        plots,
        solution,
    })
}

/// The errors of a solution on the rows of `sums`, which it is of.
fn in_sample(sums: &Moments, solution: &Solution) -> Result<PerAxis<AxisQuality>, FitError> {
    PartitionedMoments::new(sums, &solution.model)
        .and_then(|parts| parts.in_sample(solution.ridge))
        .map_err(|_| FitError::NearlyDependent)
}

/// Solves for the rows of logs, of which `first` is the first.
fn solve_rows(
    first: &Log,
    rows: &mut LogRows<'_>,
    options: &FitOptions<'_>,
) -> Result<Solved, WorkflowError> {
    let problem = Problem {
        model: Model {
            basis: options.basis,
            intercept: options.intercept,
            channels: first.channels(),
        },
        solver: options.solver,
        ridge: options.ridge,
        truncate: options.truncate,
        total: options.total,
    };
    let sample = || Ok(first.sample(&Wanted { readings: true, ..Wanted::default() })?);
    solve(&problem, rows, sample)
}

/// The coefficients alone, without a look at the errors.
pub(super) fn solution(
    train: &[Log],
    options: &FitOptions<'_>,
) -> Result<(Solution, ReadingRanges), WorkflowError> {
    let first = check(train, &[])?;
    // The exact solver passes over the rows once.
    let memory = if options.solver == SolverKind::Exact { 0 } else { options.memory };
    let mut store = store(train, &[], memory);
    let gathered = (Gathering::NOTHING, LogFacts::default());
    let mut rows =
        LogRows::new([train, &[]], gathered, options.used, options.read, store.room(), memory);
    let Solved { solution, ranges, .. } = solve_rows(first, &mut rows, options)?;
    Ok((solution, ranges))
}

/// The first of the training logs, if all logs have what a fit needs.
fn check<'a>(train: &'a [Log], test: &[Log]) -> Result<&'a Log, WorkflowError> {
    let first =
        check_logs(train, test, &Wanted { readings: true, wrench: true, ..Wanted::default() })?;
    let axes = agree_on_axes(train, &mut [])?;
    test.iter().try_for_each(|log| log.require_axes(axes))?;
    Ok(first)
}

/// How a calibration does on the logs of a fit; see [`Fit`].
struct Errors {
    train: Vec<Evaluation>,
    test: Vec<Evaluation>,
    /// How large the errors of the training rows are, if that was asked for.
    sizes: Option<PerAxis<Magnitudes>>,
    stands_out: bool,
    plots: Option<(FitPlot, FitPlot)>,
}

/// Passes over the rows of the logs from number `first` on once more. Evaluations of the logs before have the
/// number of rows and the summary, but no errors.
fn errors(
    calibration: &Calibration,
    rows: &mut LogRows<'_>,
    first: usize,
    look: &Look<'_>,
) -> Result<Errors, WorkflowError> {
    let (train, logs) = (rows.train(), rows.logs().to_vec());
    let mut plots = look.plot.then(|| (FitPlot::new(), FitPlot::new()));
    let mut stands_out = false;
    let mut evaluations = vec![Evaluation::default(); logs.len()];
    // Training rows are within the range that they define: there is nothing to look for.
    let mut without_range = calibration.clone();
    without_range.valid_range = None;
    let test_look = Look { plot: look.plot, ..Look::default() };
    let map = |evaluator: &mut BlockEvaluator, log: usize, block: &Block| {
        Ok(match log < train {
            true => evaluator.evaluate(&without_range, block, look),
            false => evaluator.evaluate(calibration, block, &test_look),
        })
    };
    let passed = first..logs.len();
    let evaluators = rows.pass_over(passed, BlockEvaluator::default, map, |log, block| {
        let plot = plots.as_mut().map(|(of_train, of_test)| match log < train {
            true => of_train,
            false => of_test,
        });
        evaluations[log].add(&block, plot);
        stands_out |= block.stands_out;
    })?;
    let facts = rows.facts();
    facts.check_copies(&logs)?;
    let known = evaluations.iter_mut().zip(facts.summaries()).zip(facts.rows());
    for ((evaluation, summary), &rows) in known {
        evaluation.rows = rows;
        evaluation.note(summary);
    }
    let test = evaluations.split_off(train);
    let sizes = BlockEvaluator::sizes(evaluators);
    Ok(Errors { train: evaluations, test, sizes, stands_out, plots })
}

/// Of all logs.
fn total(evaluations: &[Evaluation]) -> Evaluation {
    let mut total = Evaluation::default();
    evaluations.iter().for_each(|evaluation| total.merge(evaluation));
    total
}

/// Whether coefficients and errors can be written to a calibration's document, of which products of two
/// errors are part.
pub(super) fn check_sizes<'a>(
    calibration: &Calibration,
    errors: impl IntoIterator<Item = &'a PerAxis<AxisQuality>>,
) -> Result<(), FitError> {
    let is_small = |axis: &AxisQuality| axis.rms * axis.rms <= LARGEST;
    let coefficients = calibration.polynomial().map_or(&[][..], Polynomial::coefficients);
    let is_large = |coefficient: &f64| coefficient.abs() > LARGEST;
    if !errors.into_iter().flatten().all(is_small) || coefficients.iter().flatten().any(is_large) {
        return Err(FitError::Overflow);
    }
    Ok(())
}

/// The root mean square of the errors of each axis; one where there are none.
pub(super) fn root_mean_square(solution: &Solution) -> PerAxis<f64> {
    std::array::from_fn(|axis| {
        let square = solution.residual_products[(axis, axis)] / solution.rows as f64;
        if square > 0.0 { square.sqrt() } else { 1.0 }
    })
}
