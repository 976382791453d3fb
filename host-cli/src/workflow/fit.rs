//! From training logs to a calibration: one pass to fit, one to find the errors.

use std::sync::atomic::{AtomicU64, Ordering};

use super::eval::{EvalOptions, Evaluation, eval};
use super::{WorkflowError, check_channels};
use crate::block::Block;
use crate::calibration::extent::Extent;
use crate::calibration::scaling::Scaling;
use crate::calibration::solver::{Problem, Solution, Solver, SolverKind, Tsqr};
use crate::calibration::{Basis, Calibration, FitError, Model};
use crate::log_file::{Log, ReadOptions, Wanted};
use crate::plot::FitPlot;

/// What is to be fitted, and how.
#[derive(Clone, Copy)]
pub struct FitOptions<'a> {
    /// The family of features.
    pub basis: Basis,
    /// Whether to fit a constant beside them.
    pub intercept: bool,
    /// The solver.
    pub solver: SolverKind,
    /// λ of a ridge on columns of norm one, 0 for none.
    pub ridge: f64,
    /// Use only rows whose readings differ from those of the row before.
    pub fresh: bool,
    /// Reduce predictions and measurements to what a figure needs.
    pub plot: bool,
    /// How logs are read. Progress counts the bytes of all passes, see [`bytes_to_read`].
    pub read: ReadOptions<'a>,
}

/// A calibration and how well it does.
#[derive(Debug)]
pub struct Fit {
    /// The calibration.
    pub calibration: Calibration,
    /// What the solver says.
    pub solution: Solution,
    /// Errors on each training log.
    pub train: Vec<Evaluation>,
    /// Errors on each test log.
    pub test: Vec<Evaluation>,
    /// What a figure needs of training and test logs.
    pub plots: Option<(FitPlot, FitPlot)>,
}

/// The bytes that [`fit`] reads: training logs twice, test logs once.
pub fn bytes_to_read(train: &[Log], test: &[Log]) -> u64 {
    let bytes = |logs: &[Log]| logs.iter().map(Log::bytes).sum::<u64>();
    2 * bytes(train) + bytes(test)
}

/// Fits a calibration to `train` and finds its errors there and on `test`.
///
/// The readings of the first training log, sampled, give centre and scale. Nothing is held in
/// memory: the training logs are read a second time for the errors.
///
/// # Errors
/// [`WorkflowError`] if a log cannot be read, the logs differ in their number of channels, or the
/// rows do not determine the coefficients.
pub fn fit(train: &[Log], test: &[Log], options: &FitOptions<'_>) -> Result<Fit, WorkflowError> {
    let first = train.first().ok_or(WorkflowError::NoLogs)?;
    let wanted = Wanted { readings: true, wrench: true, ..Wanted::default() };
    for log in train.iter().chain(test) {
        log.require(&wanted)?;
        check_channels(log, first.channels())?;
    }
    let model =
        Model { basis: options.basis, intercept: options.intercept, channels: first.channels() };
    let sample = first.sample(&Wanted { readings: true, ..Wanted::default() })?;
    let scaling = Scaling::of_sample(&sample.readings, model.intercept);
    let problem = Problem { model, scaling, ridge: options.ridge };

    let read_before = AtomicU64::new(0);
    let report = |bytes: u64| {
        if let Some(progress) = options.read.progress {
            progress(read_before.load(Ordering::Relaxed) + bytes);
        }
    };
    let read = ReadOptions { progress: Some(&report), ..options.read };
    let finished = |log: &Log| {
        read_before.fetch_add(log.bytes(), Ordering::Relaxed);
    };

    let plain = ReadOptions { checksum: false, ..read };
    let (solution, extent) = match options.solver {
        SolverKind::Tsqr => solve(&Tsqr::new(problem)?, train, options.fresh, &plain, &finished)?,
    };
    let calibration = Calibration::of_solution(&solution, &extent);

    let mut plots = options.plot.then(|| (FitPlot::new(), FitPlot::new()));
    let eval_options = EvalOptions { fresh: options.fresh, read };
    let mut evaluate = |logs: &[Log], is_test: bool| -> Result<Vec<Evaluation>, WorkflowError> {
        let errors = |log: &Log| {
            let plot = plots.as_mut().map(|(train, test)| if is_test { test } else { train });
            let evaluation = eval(&calibration, log, &eval_options, plot)?;
            finished(log);
            Ok(evaluation)
        };
        logs.iter().map(errors).collect()
    };
    let (train, test) = (evaluate(train, false)?, evaluate(test, true)?);
    Ok(Fit { calibration, solution, train, test, plots })
}

/// One pass over the logs with any solver.
fn solve<S: Solver>(
    solver: &S,
    logs: &[Log],
    fresh: bool,
    read: &ReadOptions<'_>,
    finished: &dyn Fn(&Log),
) -> Result<(Solution, Extent), WorkflowError> {
    let wanted = Wanted { readings: true, wrench: true, ..Wanted::default() };
    let channels = logs.first().map_or(0, Log::channels);
    let mut all = solver.empty();
    let mut extent = Extent::new(channels);
    let map = |mut block: Block| -> Result<(S::Partial, Extent), FitError> {
        if fresh {
            let fresh = block.fresh_rows();
            block.retain_rows(&fresh);
        }
        let extent = Extent::of_block(&block, channels)?;
        Ok((solver.reduce(&block)?, extent))
    };
    for log in logs {
        log.read(&wanted, read, map, |block| -> Result<(), WorkflowError> {
            let (partial, seen) = block?;
            solver.merge(&mut all, partial);
            extent.merge(&seen);
            Ok(())
        })?;
        finished(log);
    }
    Ok((solver.solve(&all, &extent)?, extent))
}
