//! The covariance of a fit, from rows or from groups of them.

use calibration::factored::FactoredGroups;
use calibration::solver::{Solution, SolverKind};
use calibration::uncertainty::Covariance;
use calibration::validation::ValidationError;
use calibration::validation::grouped::GroupedMoments;

/// What is known of the errors of training rows, and so what the covariance is found from.
#[derive(Clone, Copy, Debug)]
pub enum CovarianceFrom<'a> {
    /// It is not wanted, and nothing is spent on it.
    Nothing,
    /// Errors are independent from row to row.
    Rows,
    /// Errors are alike within the groups of these sums, which are those of the training rows.
    Groups(&'a GroupedMoments),
    /// The same of rows that could not be summed exactly.
    Factored(&'a FactoredGroups),
}

/// The covariance, as far as it can be had.
pub(super) struct Uncertainty {
    pub(super) covariance: Option<Covariance>,
    pub(super) not_grouped: Option<ValidationError>,
}

impl Uncertainty {
    pub(super) fn of(
        solution: &Solution,
        solver: SolverKind,
        ridge: f64,
        from: CovarianceFrom<'_>,
    ) -> Self {
        let by_rows = || Covariance::of_rows(solution);
        let found = match from {
            CovarianceFrom::Nothing => Ok(None),
            CovarianceFrom::Rows => Ok(by_rows()),
            CovarianceFrom::Groups(_) if solver != SolverKind::Exact => {
                Err(ValidationError::OtherSolver)
            }
            CovarianceFrom::Groups(sums) => {
                Covariance::of_groups(sums, &solution.model, ridge).map(Some)
            }
            CovarianceFrom::Factored(_) if !is_least_squares(solver) => {
                Err(ValidationError::OtherSolver)
            }
            CovarianceFrom::Factored(rows) => Covariance::of_factored(rows, solution).map(Some),
        };
        match found {
            Ok(covariance) => Self { covariance, not_grouped: None },
            Err(error) => Self { covariance: by_rows(), not_grouped: Some(error) },
        }
    }
}

/// Whether a solver weighs all rows alike and leaves no direction out.
fn is_least_squares(solver: SolverKind) -> bool {
    !matches!(solver, SolverKind::Huber | SolverKind::Svd | SolverKind::RidgeGcv)
}
