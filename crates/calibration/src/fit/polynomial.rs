//! A polynomial in the readings: from rows, or from what was kept of them, to coefficients, errors and covariance.

use std::path::PathBuf;

use super::evaluation::{BlockEvaluator, EvalOptions, Evaluation};
use super::model_choice::{Clusters, ModelChoice};
use super::{CovarianceRule, FitOptions, LARGEST};
use crate::conversion::Calibration;
use crate::error::FitError;
use crate::exact::{ExactError, Moments};
use crate::least_squares::Method;
use crate::magnitudes::Magnitudes;
use crate::model::Model;
use crate::passes::{Rows, each};
use crate::polynomial::Polynomial;
use crate::quality::AxisQuality;
use crate::reading_ranges::ReadingRanges;
use crate::scaling::Scaling;
use crate::solver::{self, FitProblem, ReadingSums, Solution, SolverKind};
use crate::uncertainty::{Covariance, ErrorShape};
use crate::validation::ValidationError;
use crate::validation::excitation::WrenchSums;
use crate::validation::grouped::GroupedMoments;
use crate::validation::leaks::{LEAKY, RowSample, share_in_several_groups};
use crate::validation::outliers::{RowTest, TestedRow};
use crate::validation::spread::Spread;
use shell_data::block::Block;
use shell_data::dataset::{Dataset, LabelledBlock};
use shell_data::fingerprint::Fingerprint;
use shell_data::wrench::PerAxis;

/// What is to be solved, and how.
#[derive(Clone, Copy, Debug)]
pub(super) struct PolynomialProblem {
    pub(super) model: Model,
    /// Where the exact one cannot take the rows, refined QR does.
    pub(super) solver: SolverKind,
    pub(super) ridge: f64,
    pub(super) truncate: Option<f64>,
}

/// The solution, and how it was found.
#[derive(Clone)]
pub(super) struct Solved {
    pub(super) solution: Solution,
    pub(super) ranges: ReadingRanges,
    /// The solver that was used.
    pub(super) solver: SolverKind,
    /// Why it is not the exact one, where that was asked for.
    pub(super) not_exact: Option<ExactError>,
    /// The exact sums that it is the solution of, if it is.
    pub(super) sums: Option<Moments>,
}

/// Solves by the solver that is asked for. `total` are the exact sums of the rows, where they have been made
/// already; `sample` is of the rows, for solvers that need to know their sizes before the first pass.
pub(super) fn solve(
    problem: &PolynomialProblem,
    total: Option<&Moments>,
    rows: &Rows<'_>,
    sample: Option<&Block>,
) -> Result<Solved, FitError> {
    let solver = problem.solver;
    let not_exact = match solver {
        SolverKind::Exact => match solve_exactly(problem, total, rows) {
            Err(FitError::NotExact(error)) => Some(error),
            found => return found,
        },
        _ => None,
    };
    let solver = if not_exact.is_some() { SolverKind::RefinedTsqr } else { solver };
    let (solution, ranges) = solve_rounded(solver, problem, rows, sample)?;
    Ok(Solved { solution, ranges, solver, not_exact, sums: None })
}

fn solve_exactly(
    problem: &PolynomialProblem,
    total: Option<&Moments>,
    rows: &Rows<'_>,
) -> Result<Solved, FitError> {
    let sums = match total {
        Some(total) => total.clone(),
        None => solver::exact_moments(problem.model, rows)?,
    };
    let ranges = sums.reading_ranges();
    let solution = solver::solve_moments(&sums, &problem.model, problem.ridge, &ranges)?;
    let solver = SolverKind::Exact;
    Ok(Solved { solution, ranges, solver, not_exact: None, sums: Some(sums) })
}

fn solve_rounded(
    solver: SolverKind,
    problem: &PolynomialProblem,
    rows: &Rows<'_>,
    sample: Option<&Block>,
) -> Result<(Solution, ReadingRanges), FitError> {
    let PolynomialProblem { model, ridge, truncate, .. } = *problem;
    // A sample tells centre and scale, unless the answer depends on them.
    let is_penalised = ridge > 0.0
        || solver == SolverKind::RidgeGcv
        || (solver == SolverKind::Svd && truncate.is_some());
    let scaling = match sample.filter(|_| !is_penalised) {
        Some(sample) => Scaling::from_sample(&sample.readings, model.intercept),
        None => rows.reduce(&ReadingSums::new(model.columns()))?.scaling(model.intercept),
    };
    let problem = FitProblem { model, scaling, ridge };
    match solver {
        SolverKind::Svd => solver::fit_by(Method::Svd { truncate }, problem, rows),
        _ => solver::fit(solver, problem, rows),
    }
}

/// How R factors of rows are solved as a solver would fit the rows, to rounding; Huber's weighs rows by what they err, and
/// is not among them.
pub(super) fn r_factor_method(solver: SolverKind, truncate: Option<f64>) -> Method {
    match solver {
        SolverKind::Svd => Method::Svd { truncate },
        SolverKind::RidgeGcv => Method::RidgeGcv,
        _ => Method::Tsqr,
    }
}

/// The covariance as far as it can be had, and why not by groups where it is of independent rows.
pub(super) fn covariance(
    solution: &Solution,
    solver: SolverKind,
    choice: &ModelChoice,
    options: &FitOptions<'_>,
) -> (Option<Covariance>, Option<ValidationError>) {
    if options.covariance == CovarianceRule::Nothing || choice.few_groups.is_some() {
        return (None, None);
    }
    let by_rows = || Covariance::from_rows(solution);
    let (ridge, workers) = (choice.ridge, options.workers);
    let found = match (&choice.clusters, &choice.sums) {
        _ if !choice.by_group => return (by_rows(), None),
        (Some(Clusters::Rows(rows)), _) => {
            Covariance::from_clipped_groups(rows, solution, ridge, workers)
        }
        (Some(Clusters::RFactors { .. }), _) if solver == SolverKind::Huber => {
            Err(ValidationError::OtherSolver)
        }
        (Some(Clusters::RFactors { rows, held_out_together }), _) => {
            let method = r_factor_method(solver, options.truncate);
            let together = held_out_together.as_deref();
            Covariance::from_factored(rows, together, solution, (method, ridge), workers)
        }
        // Features of other solvers are about another centre than that of the sums.
        (None, Some(_)) if solver != SolverKind::Exact => Err(ValidationError::OtherSolver),
        (None, Some(sums)) => {
            let are_long =
                choice.has_long_stretches(sums.groups.len(), solution.rows, &solution.model);
            Covariance::from_groups(sums, &solution.model, ridge, are_long, workers)
        }
        (None, None) => return (by_rows(), None),
    };
    match found {
        Ok(covariance) => (Some(covariance), None),
        // Rows that resemble each other would promise too much.
        Err(ValidationError::OtherSolver) => (None, Some(ValidationError::OtherSolver)),
        Err(error) => (by_rows(), Some(error)),
    }
}

/// A polynomial, and how well it does.
pub(super) struct PolynomialFit {
    pub(super) calibration: Calibration,
    pub(super) solved: Solved,
    pub(super) not_grouped: Option<ValidationError>,
    pub(super) errors: RowErrors,
    /// That of the training rows, if outliers are looked for.
    pub(super) spread: Option<Spread>,
}

/// Fits the model that was chosen, and finds its errors on the training rows and on those of tests.
pub(super) fn fit(
    train: &Dataset,
    test: &Dataset,
    choice: &ModelChoice,
    options: &FitOptions<'_>,
) -> Result<PolynomialFit, FitError> {
    let problem = PolynomialProblem {
        model: options.model_of(train, choice.basis),
        solver: match options.solver {
            // What the exact solver leaves to others; memory terms are rounded themselves.
            SolverKind::Exact if train.has_weights() => SolverKind::RefinedTsqr,
            SolverKind::Exact if train.memory_terms() > 0 => SolverKind::Tsqr,
            solver => solver,
        },
        ridge: choice.ridge,
        truncate: options.truncate,
    };
    let total = choice.sums.as_ref().and_then(GroupedMoments::total);
    let sample = train.logs.first().map(|log| &log.sample);
    let solved = solve(&problem, total, &Rows::new(train, options.workers), sample)?;
    let Solved { solution, ranges, solver, .. } = &solved;
    let mut calibration = Calibration::from_solution(solution, ranges);
    calibration.axes = train.logs[0].axes;
    let (mut covariance, not_grouped) = covariance(solution, *solver, choice, options);
    let unit = covariance.as_ref().map(|_| root_mean_square(solution));
    // Outliers are told by a fit to rows that count alike.
    let looks = options.looks_for_outliers() && !train.has_weights();
    let spread = looks.then(|| Spread::new(train, options.workers)).transpose()?;
    let row_test = spread.as_ref().and_then(|spread| RowTest::new(solution, spread));
    let look = EvalOptions { size_unit: unit.as_ref(), row_test: row_test.as_ref() };
    let errors = RowErrors::new(&calibration, train, test, &look, options)?;
    if let Some([earlier, later]) = errors.copy {
        return Err(FitError::Copy { earlier, later });
    }
    let quality = Evaluation::total(&errors.train).quality().ok_or(FitError::NoRows)?;
    let tested = Evaluation::total(&errors.test).quality();
    check_sizes(&calibration, [Some(&quality), tested.as_ref()].into_iter().flatten())?;
    if let (Some(covariance), Some(unit)) = (&mut covariance, unit) {
        let rms = quality.map(|axis| axis.rms);
        let sizes = errors.sizes.as_ref();
        covariance.shape = sizes.map(|sizes| ErrorShape::from_errors(sizes, &unit, &rms));
    }
    calibration.covariance = covariance;
    Ok(PolynomialFit { calibration, solved, not_grouped, errors, spread })
}

/// How a calibration does on the rows of a fit, and what else is said of these.
pub(super) struct RowErrors {
    pub(super) train: Vec<Evaluation>,
    pub(super) test: Vec<Evaluation>,
    /// The first log that has the rows of one before it, after that one.
    copy: Option<[PathBuf; 2]>,
    /// How large the errors of the training rows are, if that was asked for.
    sizes: Option<PerAxis<Magnitudes>>,
    /// The training rows that were tested as outliers, by block, if that was asked for.
    pub(super) tested: Vec<Vec<TestedRow>>,
    /// The wrench that the training rows have measured.
    pub(super) loads: WrenchSums,
    pub(super) leaks: Leaks,
}

/// Rows on both sides of a split, as far as rows are made of poses.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Leaks {
    /// The share of test rows at poses of the training rows.
    pub test: Option<f64>,
    /// The share of training rows whose pose other groups have rows of, too.
    pub groups: Option<f64>,
}

impl Leaks {
    /// Whether errors on test rows say nothing of new poses.
    pub fn in_test(&self) -> Option<f64> {
        self.test.filter(|&share| share >= LEAKY)
    }

    /// Whether errors on held-out groups say nothing of new poses.
    pub fn in_groups(&self) -> Option<f64> {
        self.groups.filter(|&share| share >= LEAKY)
    }
}

/// What one block adds.
struct BlockFacts {
    log: usize,
    errors: Evaluation,
    /// `None` for test rows.
    trained: Option<(Vec<TestedRow>, WrenchSums)>,
    fingerprint: Fingerprint,
    sample: RowSample,
}

impl RowErrors {
    /// Passes over training and test rows.
    pub(super) fn new(
        calibration: &Calibration,
        train: &Dataset,
        test: &Dataset,
        look: &EvalOptions<'_>,
        options: &FitOptions<'_>,
    ) -> Result<Self, FitError> {
        let logs = train.logs.len();
        let blocks: Vec<(usize, &LabelledBlock)> =
            train.blocks().chain(test.blocks().map(|(log, block)| (logs + log, block))).collect();
        let all_logs = || train.logs.iter().chain(&test.logs);
        let mut evaluations: Vec<_> = all_logs().map(Evaluation::before).collect();
        let mut fingerprints = vec![Fingerprint::default(); evaluations.len()];
        let strides = [train, test].map(|data| RowSample::stride(data.rows()));
        // Training rows are within the range that they define: there is nothing to look for.
        let mut without_range = calibration.clone();
        without_range.valid_range = None;
        let work = |evaluator: &mut BlockEvaluator, (log, block): &(usize, &LabelledBlock)| {
            let (is_train, rows) = (*log < logs, &block.rows);
            let (errors, tested) = match is_train {
                true => evaluator.evaluate(&without_range, rows, look),
                false => evaluator.evaluate(calibration, rows, &EvalOptions::default()),
            };
            let stride = strides[usize::from(!is_train)];
            // A log by itself is a copy of none, and without tests there is nothing on its plateaus.
            let (may_be_copy, has_tests) = (all_logs().count() > 1, !test.logs.is_empty());
            Ok(BlockFacts {
                log: *log,
                errors,
                trained: is_train.then(|| (tested, WrenchSums::new(&rows.wrench))),
                fingerprint: if may_be_copy {
                    Fingerprint::new(rows)
                } else {
                    Fingerprint::default()
                },
                sample: if has_tests { RowSample::new(rows, stride) } else { RowSample::default() },
            })
        };
        let (mut loads, mut tested) = (WrenchSums::default(), Vec::new());
        let mut samples = [RowSample::default(), RowSample::default()];
        let fold = |block: BlockFacts| {
            evaluations[block.log].merge(&block.errors);
            fingerprints[block.log].merge(block.fingerprint);
            samples[usize::from(block.log >= logs)].add(block.sample);
            if let Some((of_block, loads_of_block)) = block.trained {
                tested.push(of_block);
                loads.merge(&loads_of_block);
            }
            Ok(())
        };
        let workers = options.workers;
        let evaluators =
            each(&blocks, |(_, block)| &block.rows, workers, BlockEvaluator::default, work, fold)?;
        let copy = Fingerprint::first_copy(&fingerprints).map(|positions| {
            let name = |at: usize| all_logs().nth(at).map(|log| log.name.clone());
            <[usize; 2]>::from(positions).map(|at| name(at).unwrap_or_default())
        });
        let test = evaluations.split_off(logs);
        let [train_rows, test_rows] = samples;
        Ok(Self {
            train: evaluations,
            test,
            copy,
            sizes: BlockEvaluator::sizes(evaluators),
            tested,
            loads,
            leaks: Leaks {
                test: train_rows.poses().and_then(|poses| poses.share_of(&test_rows)),
                groups: options.validation().and_then(|_| share_in_several_groups(train)),
            },
        })
    }
}

/// Whether coefficients and errors can be written to a calibration's document, of which products of two
/// errors are part.
fn check_sizes<'a>(
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
fn root_mean_square(solution: &Solution) -> PerAxis<f64> {
    std::array::from_fn(|axis| {
        let square = solution.residual_products[(axis, axis)] / solution.rows as f64;
        if square > 0.0 { square.sqrt() } else { 1.0 }
    })
}

/// The calibration that a problem's solution is, checked as that of a fit.
pub(super) fn calibrate(
    problem: &PolynomialProblem,
    rows: &Rows<'_>,
    sample: &Block,
) -> Result<Calibration, FitError> {
    let Solved { solution, ranges, .. } = solve(problem, None, rows, Some(sample))?;
    let calibration = Calibration::from_solution(&solution, &ranges);
    check_sizes(&calibration, [])?;
    Ok(calibration)
}
