//! The solution of a polynomial: from rows, or from what was kept of them, to coefficients that are checked.

use super::LARGEST;
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
use shell_data::block::Block;
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
    let solution = sums.solve(&problem.model, problem.ridge)?.solution;
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
