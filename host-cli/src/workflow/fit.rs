//! From training logs to a calibration: one pass to fit or several, one to find the errors.

use std::sync::atomic::{AtomicU64, Ordering};

use super::eval::{BlockErrors, Evaluation};
use super::log_rows::{LogRows, MEMORY, store};
use super::selection::UsedRows;
use super::solving::{Problem, Solved, solve};
pub use super::uncertainty::CovarianceFrom;
use super::uncertainty::Uncertainty;
use super::{WorkflowError, agree_on_axes, check_logs};
use crate::calibration_file::LARGEST;
use crate::figures::FitPlot;
use calibration::exact::{ExactError, Moments};
use calibration::quality::AxisQuality;
use calibration::reading_ranges::ReadingRanges;
use calibration::solver::{Solution, SolverKind};
use calibration::uncertainty::ErrorShape;
use calibration::validation::ValidationError;
use calibration::validation::excitation::WrenchSums;
use calibration::validation::outliers::{Judge, Spread};
use calibration::validation::shared_loads::{RowSample, SharedRows};
use calibration::{Basis, Calibration, FitError, Model, Polynomial};
use log_file::{Log, ReadOptions, Wanted};
use shell_data::block::Block;
use shell_data::fingerprint::Fingerprint;
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
    /// What the covariance is to be found from.
    pub covariance: CovarianceFrom<'a>,
    /// Reduce predictions and measurements to what a figure needs.
    pub plot: bool,
    /// Look whether any training row does not belong.
    pub looks: bool,
    /// The memory in bytes that rows may take, so that logs are read once: those whose rows take more
    /// are read again for every pass.
    pub memory: u64,
    /// How logs are read. Progress counts the bytes of all passes, see [`bytes_to_read`].
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
            covariance: CovarianceFrom::Nothing,
            plot: false,
            looks: false,
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
    /// Errors on each training log.
    pub train: Vec<Evaluation>,
    /// The wrench that the training logs have measured.
    pub loads: WrenchSums,
    /// Errors on each test log.
    pub test: Vec<Evaluation>,
    /// The share of test rows on plateaus of the training logs, where those are made of plateaus.
    pub on_plateaus: Option<f64>,
    /// Whether a training row does not belong, if that was asked.
    pub stands_out: bool,
    /// What the rows would take in memory, about, where they took more than they may and were read again.
    pub wanted_memory: Option<u64>,
    /// What a figure needs of training and test logs.
    pub plots: Option<(FitPlot, FitPlot)>,
}

/// The bytes that [`fit`] reads: training logs twice, test logs once.
pub fn bytes_to_read(train: &[Log], test: &[Log]) -> u64 {
    let bytes = |logs: &[Log]| logs.iter().map(Log::bytes).sum::<u64>();
    2 * bytes(train) + bytes(test)
}

/// Fits a calibration to `train` and finds its errors there and on `test`, all of which have the same axes of
/// the wrench ([`agree_on_axes`](super::agree_on_axes)).
///
/// The training logs are passed over twice, for the coefficients and for the errors, and more
/// often by solvers that iterate. Their rows are kept between the passes, those of the test logs among
/// them, unless they take more than [`FitOptions::memory`]: longer logs are read again, so that memory does
/// not grow with them.
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
    let mut rows = LogRows::new(train, test, options.used, read, store.room(), options.memory);
    let Solved { solution, ranges, solver, not_exact } = solve_rows(first, &mut rows, options)?;
    let mut calibration = Calibration::of_solution(&solution, &ranges);
    calibration.axes = first.axes();
    let Uncertainty { mut covariance, not_grouped } =
        Uncertainty::of(&solution, solver, options.ridge, options.covariance);
    let size_unit = covariance.as_ref().map(|_| root_mean_square(&solution));
    read_before.store(train_bytes, Ordering::Relaxed);
    let judge = options.looks.then(|| {
        let spread = Spread::within(&ranges);
        Some((Judge::new(&solution, &ranges, &spread)?, spread))
    });
    let judge = judge.flatten();
    let judge = judge.as_ref().map(|(judge, spread)| (judge, spread));
    let errors = errors(&calibration, &mut rows, size_unit.as_ref(), options.plot, judge)?;
    if let (Some(covariance), Some(unit)) = (&mut covariance, size_unit) {
        covariance.shape = shape(&errors.train, &unit);
    }
    calibration.covariance = covariance;
    let Errors { train, loads, test, on_plateaus, stands_out, plots } = errors;
    Ok(Fit {
        calibration,
        solution,
        solver,
        not_exact,
        not_grouped,
        train,
        loads,
        test,
        on_plateaus,
        stands_out,
        wanted_memory: rows.wanted_memory(),
        plots,
    })
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
    let mut rows = LogRows::new(train, &[], options.used, options.read, store.room(), memory);
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

/// About as many bytes has a row of a log.
const BYTES_OF_ROW: u64 = 100;

/// How a calibration does on the logs of a fit; see [`Fit`].
struct Errors {
    train: Vec<Evaluation>,
    loads: WrenchSums,
    test: Vec<Evaluation>,
    on_plateaus: Option<f64>,
    stands_out: bool,
    plots: Option<(FitPlot, FitPlot)>,
}

/// Passes over all rows once more. Sizes of training errors are counted in `size_unit`, if there is one.
fn errors(
    calibration: &Calibration,
    rows: &mut LogRows<'_>,
    size_unit: Option<&PerAxis<f64>>,
    plot: bool,
    judge: Option<(&Judge, &Spread)>,
) -> Result<Errors, WorkflowError> {
    let logs = rows.logs().to_vec();
    let train = rows.train();
    let mut plots = plot.then(|| (FitPlot::new(), FitPlot::new()));
    let (mut loads, mut stands_out) = (WrenchSums::default(), false);
    let mut evaluations = vec![Evaluation::default(); logs.len()];
    let mut fingerprints = vec![Fingerprint::default(); logs.len()];
    // Training rows are within the range that they define: there is nothing to look for.
    let mut without_range = calibration.clone();
    without_range.valid_range = None;
    let (mut train_rows, mut shared) = (RowSample::default(), None);
    let is_tested = train < logs.len();
    let stride = |logs: &[&Log]| {
        RowSample::stride(logs.iter().map(|log| log.bytes()).sum::<u64>() / BYTES_OF_ROW)
    };
    let strides = [stride(&logs[..train]), stride(&logs[train..])];
    // A log by itself is a copy of none.
    let is_alone = logs.len() == 1;
    let map = |log: usize, block: &Block| {
        let fingerprint = if is_alone { Fingerprint::default() } else { Fingerprint::of(block) };
        let is_train = log < train;
        let errors = match is_train {
            true => BlockErrors::of(&without_range, block, size_unit, plot, judge),
            false => BlockErrors::of(calibration, block, None, plot, None),
        };
        let sample = is_tested.then(|| RowSample::of(block, strides[usize::from(!is_train)]));
        let of_train = is_train.then(|| WrenchSums::of(&block.wrench));
        Ok((errors, of_train, fingerprint, sample))
    };
    let summaries = rows.each_block(map, |log, (block, of_block, fingerprint, sample)| {
        match sample {
            Some(sample) if log < train => train_rows.add(&sample),
            // All training rows have come before.
            Some(sample) => {
                let found = || train_rows.plateaus().map(SharedRows::new);
                if let Some(shared) = shared.get_or_insert_with(found) {
                    shared.add(&sample);
                }
            }
            None => {}
        }
        fingerprints[log].merge(fingerprint);
        let plot = plots.as_mut().map(|(of_train, of_test)| match log < train {
            true => of_train,
            false => of_test,
        });
        evaluations[log].add(&block, plot);
        stands_out |= block.stands_out;
        if let Some(of_block) = of_block {
            loads.merge(&of_block);
        }
    })?;
    for (evaluation, summary) in evaluations.iter_mut().zip(summaries) {
        evaluation.note(summary);
    }
    if let Some((earlier, later)) = Fingerprint::first_copy(&fingerprints) {
        let path = |log: usize| logs[log].path().to_path_buf();
        return Err(WorkflowError::Copy { earlier: path(earlier), later: path(later) });
    }
    check_sizes(calibration, &evaluations)?;
    let test = evaluations.split_off(train);
    let on_plateaus = shared.flatten().and_then(|shared| shared.share());
    Ok(Errors { train: evaluations, loads, test, on_plateaus, stands_out, plots })
}

/// Whether coefficients and errors can be written to a calibration's document, of which products of two
/// errors are part.
pub(super) fn check_sizes(
    calibration: &Calibration,
    evaluations: &[Evaluation],
) -> Result<(), FitError> {
    let is_sane = |of: &Evaluation| {
        let is_small = |axis: &AxisQuality| axis.rms * axis.rms <= LARGEST;
        of.quality().is_none_or(|axes| axes.iter().all(is_small))
    };
    let coefficients = calibration.polynomial().map_or(&[][..], Polynomial::coefficients);
    let is_large = |coefficient: &f64| coefficient.abs() > LARGEST;
    if !evaluations.iter().all(is_sane) || coefficients.iter().flatten().any(is_large) {
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

/// How the training errors are distributed.
pub(super) fn shape(train: &[Evaluation], unit: &PerAxis<f64>) -> Option<ErrorShape> {
    let mut total = Evaluation::default();
    train.iter().for_each(|evaluation| total.merge(evaluation));
    let rms = total.quality()?.map(|axis| axis.rms);
    Some(ErrorShape::of_errors(total.sizes.as_ref()?, unit, &rms))
}
