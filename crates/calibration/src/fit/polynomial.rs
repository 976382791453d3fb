//! A polynomial in the readings: from rows, or from what was kept of them, to coefficients that are checked, errors and
//! covariance.

use std::mem::take;

use super::choice::FitInput;
use super::evaluation::{Evaluation, RowErrors};
use super::model_choice::{Clusters, ModelChoice};
use super::outlier_search::{KnownFit, name_outliers};
use super::outliers::Outliers;
use super::warning::Warning;
use super::{CovarianceRule, Fit, FitMethod, FitOptions, LARGEST};
use crate::conversion::Calibration;
use crate::error::FitError;
use crate::exact::{ExactError, Moments};
use crate::least_squares::Method;
use crate::model::Model;
use crate::passes::Rows;
use crate::polynomial::Polynomial;
use crate::quality::AxisQuality;
use crate::reading_ranges::ReadingRanges;
use crate::scaling::Scaling;
use crate::solver::{self, FitProblem, ReadingSums, Solution, SolverKind};
use crate::uncertainty::{Covariance, ErrorShape};
use crate::validation::ValidationError;
use crate::validation::grouped::GroupedMoments;
use crate::validation::outliers::{RowTest, Spread, TestedRow};
use shell_data::block::Block;
use shell_data::dataset::Dataset;
use shell_data::fingerprint::Fingerprint;
use shell_data::wrench::PerAxis;

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

/// Below this condition number refined QR has all digits of the coefficients (docs/accuracy.md), and the covariance from
/// its R factor, which is not refined, six at the least.
const AS_GOOD_AS_EXACT: f64 = 1e10;

/// Fits the model that was chosen, and finds its errors on the training rows and on those of tests.
pub(super) fn fit(input: FitInput<'_>, mut choice: ModelChoice) -> Result<Fit, FitError> {
    let FitInput { test, options, .. } = input;
    let train = choice.labelled.take().unwrap_or_else(|| input.used());
    let solved = solve_choice(&train, &choice, options)?;
    let Solved { solution, ranges, solver, not_exact, .. } = &solved;
    let mut calibration = Calibration::from_solution(solution, ranges);
    calibration.axes = train.logs[0].axes;
    let (mut covariance, not_grouped) = covariance(solution, *solver, &choice, options);
    let unit = covariance.as_ref().map(|_| root_mean_square(solution));
    // Outliers are told by a fit to rows that count alike.
    let looks = options.looks_for_outliers() && !train.has_weights();
    let spread = looks.then(|| Spread::new(&train, options.workers)).transpose()?;
    let row_test = spread.as_ref().and_then(|spread| RowTest::new(solution, spread));
    let look = (unit.as_ref(), row_test.as_ref());
    let [mut errors, of_tests] =
        RowErrors::of_fit(&calibration, [&train, test], look, options.workers)?;
    check_copies([&train, test], [&errors, &of_tests])?;
    let quality = Evaluation::total(&errors.logs).quality().ok_or(FitError::NoRows)?;
    let tested = Evaluation::total(&of_tests.logs).quality();
    check_sizes(&calibration, [Some(&quality), tested.as_ref()].into_iter().flatten())?;
    if let (Some(covariance), Some(unit)) = (&mut covariance, unit) {
        let rms = quality.map(|axis| axis.rms);
        let sizes = errors.sizes.as_ref();
        covariance.shape = sizes.map(|sizes| ErrorShape::from_errors(sizes, &unit, &rms));
    }
    calibration.covariance = covariance;

    let mut warnings = Vec::new();
    if train.has_weights() && options.solver == SolverKind::Exact {
        warnings.push(Warning::Weighted);
    }
    let loses_digits = solution.condition.is_nan() || solution.condition > AS_GOOD_AS_EXACT;
    warnings.extend(not_exact.clone().filter(|_| loses_digits).map(Warning::NotExact));
    warnings.extend(options.warn_of_groups(&choice, not_grouped)?);
    let has_outliers = errors.tested.iter().flatten().any(TestedRow::starts_search);
    let outliers = spread.filter(|_| has_outliers).map(|spread| -> Result<Outliers, FitError> {
        let judged_by = FitOptions { model: choice.basis.into(), ridge: choice.ridge, ..*options };
        let is_same_fit = input.uses_all() && options.solver == SolverKind::Exact;
        let known = KnownFit { fit: &solved, spread, tested: take(&mut errors.tested) };
        name_outliers(input.train, is_same_fit.then_some(known), &judged_by)
    });
    let how = FitMethod::polynomial(solved.solution, solved.solver, options.truncate);
    let fitted = Fit { outliers, warnings, ..Fit::new(calibration, choice, how, quality) };
    Ok(fitted.with_errors(train, test, [errors, of_tests], options))
}

fn solve_choice(
    train: &Dataset,
    choice: &ModelChoice,
    options: &FitOptions<'_>,
) -> Result<Solved, FitError> {
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
    solve(&problem, total, &Rows::new(train, options.workers), sample)
}

/// Refuses a log that has the rows of one before it.
fn check_copies(data: [&Dataset; 2], errors: [&RowErrors; 2]) -> Result<(), FitError> {
    let fingerprints = errors.map(|of| &of.fingerprints[..]).concat();
    let Some(positions) = Fingerprint::first_copy(&fingerprints) else { return Ok(()) };
    let logs = data.into_iter().flat_map(|data| &data.logs);
    let [earlier, later] = <[usize; 2]>::from(positions)
        .map(|at| logs.clone().nth(at).map(|log| log.name.clone()).unwrap_or_default());
    Err(FitError::Copy { earlier, later })
}

/// The root mean square of the errors of each axis; one where there are none.
fn root_mean_square(solution: &Solution) -> PerAxis<f64> {
    std::array::from_fn(|axis| {
        let square = solution.residual_products[(axis, axis)] / solution.rows as f64;
        if square > 0.0 { square.sqrt() } else { 1.0 }
    })
}

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
    let PolynomialProblem { model, mut solver, ridge, truncate } = *problem;
    let mut not_exact = None;
    if solver == SolverKind::Exact {
        match solve_exactly(problem, total, rows) {
            Err(FitError::NotExact(error)) => not_exact = Some(error),
            found => return found,
        }
        solver = SolverKind::RefinedTsqr;
    }
    // A sample tells centre and scale, unless the answer depends on them.
    let is_penalised = ridge > 0.0
        || solver == SolverKind::RidgeGcv
        || (solver == SolverKind::Svd && truncate.is_some());
    let scaling = match sample.filter(|_| !is_penalised) {
        Some(sample) => Scaling::from_sample(&sample.readings, model.intercept),
        None => rows.reduce(&ReadingSums::new(model.columns()))?.scaling(model.intercept),
    };
    let problem = FitProblem { model, scaling, ridge };
    let (solution, ranges) = match solver {
        SolverKind::Svd => solver::fit_by(Method::Svd { truncate }, problem, rows)?,
        _ => solver::fit(solver, problem, rows)?,
    };
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

/// How R factors of rows are solved as a solver would fit the rows, to rounding; Huber's weighs rows by what they err, and
/// is not among them.
pub(super) fn r_factor_method(solver: SolverKind, truncate: Option<f64>) -> Method {
    match solver {
        SolverKind::Svd => Method::Svd { truncate },
        SolverKind::RidgeGcv => Method::RidgeGcv,
        _ => Method::Tsqr,
    }
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
