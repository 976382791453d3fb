//! From rows, wherever they are, to coefficients.

use super::WorkflowError;
use calibration::exact::{ExactError, Moments};
use calibration::least_squares::Method;
use calibration::reading_ranges::ReadingRanges;
use calibration::scaling::Scaling;
use calibration::solver::{self, Blocks, Centring, FitProblem, Solution, SolverKind};
use calibration::{FitError, Model};
use shell_data::block::Block;

/// What is to be solved, and how.
#[derive(Clone, Copy)]
pub(super) struct Problem<'a> {
    pub(super) model: Model,
    /// Where the exact one cannot take the rows, refined QR does.
    pub(super) solver: SolverKind,
    pub(super) ridge: f64,
    pub(super) truncate: Option<f64>,
    /// The exact sums of the rows, where they have been made already.
    pub(super) total: Option<&'a Moments>,
}

/// The solution, and how it was found.
pub(super) struct Solved {
    pub(super) solution: Solution,
    pub(super) ranges: ReadingRanges,
    /// The solver that was used.
    pub(super) solver: SolverKind,
    /// Why it is not the exact one, where that was asked for.
    pub(super) not_exact: Option<ExactError>,
    /// The exact sums of the rows, where the solver has made them.
    pub(super) moments: Option<Moments>,
}

/// Solves by the solver that is asked for. `sample` is of the rows, for solvers that need to know their
/// sizes before the first pass.
pub(super) fn solve<B: Blocks<Error = WorkflowError>>(
    problem: &Problem<'_>,
    rows: &mut B,
    sample: impl Fn() -> Result<Block, WorkflowError>,
) -> Result<Solved, WorkflowError> {
    let solver = problem.solver;
    let solved = |found: Found, solver, not_exact| {
        let Found { solution, ranges, moments } = found;
        Solved { solution, ranges, solver, not_exact, moments }
    };
    match solve_by(solver, problem, rows, &sample) {
        Err(WorkflowError::Fit(FitError::NotExact(error))) if solver == SolverKind::Exact => {
            let solver = SolverKind::RefinedTsqr;
            Ok(solved(solve_by(solver, problem, rows, &sample)?, solver, Some(error)))
        }
        found => Ok(solved(found?, solver, None)),
    }
}

/// What a solver finds.
struct Found {
    solution: Solution,
    ranges: ReadingRanges,
    moments: Option<Moments>,
}

fn solve_by<B: Blocks<Error = WorkflowError>>(
    solver: SolverKind,
    problem: &Problem<'_>,
    rows: &mut B,
    sample: &impl Fn() -> Result<Block, WorkflowError>,
) -> Result<Found, WorkflowError> {
    let Problem { model, ridge, truncate, total, .. } = *problem;
    if solver == SolverKind::Exact {
        let made = match total {
            Some(_) => None,
            // It chooses its own centre and scale.
            None => {
                let scaling = Scaling::identity(model.channels);
                Some(solver::exact_moments(&FitProblem { model, scaling, ridge }, rows)?)
            }
        };
        let Some(sums) = total.or(made.as_ref()) else { return Err(WorkflowError::NoRows) };
        let ranges = sums.reading_ranges();
        let solution = solver::solve_moments(sums, &model, ridge, &ranges)?;
        return Ok(Found { solution, ranges, moments: made });
    }
    // A sample tells centre and scale, unless the answer depends on them.
    let is_penalised = ridge > 0.0
        || solver == SolverKind::RidgeGcv
        || (solver == SolverKind::Svd && truncate.is_some());
    let scaling = match solver {
        _ if is_penalised => {
            let centring = Centring { channels: model.channels, intercept: model.intercept };
            centring.scaling(&rows.pass(&centring)?)
        }
        _ => Scaling::of_sample(&sample()?.readings, model.intercept),
    };
    let problem = FitProblem { model, scaling, ridge };
    let (solution, ranges) = match solver {
        SolverKind::Svd => solver::fit_by(Method::Svd { truncate }, problem, rows)?,
        _ => solver::fit(solver, problem, rows)?,
    };
    Ok(Found { solution, ranges, moments: None })
}
