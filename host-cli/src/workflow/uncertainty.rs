//! The covariance of a fit, from rows or from groups of them.

use calibration::factored::FactoredGroups;
use calibration::least_squares::Method;
use calibration::solver::{Solution, SolverKind};
use calibration::uncertainty::Covariance;
use calibration::validation::ValidationError;
use calibration::validation::grouped::GroupedMoments;
use shell_data::block::Block;

/// What is known of the errors of training rows, and so what the covariance is found from.
#[derive(Clone, Copy, Debug)]
pub enum CovarianceFrom<'a> {
    /// It is not wanted, and nothing is spent on it.
    Nothing,
    /// Errors are independent from row to row.
    Rows,
    /// Errors are alike within the groups of these sums, which are those of the training rows.
    Groups(&'a GroupedMoments),
    /// The same of triangles of the rows: where they could not be summed exactly, or sums do not serve the solver.
    Factored(&'a FactoredGroups),
    /// The same of the rows themselves, for a solver that clips them.
    Rowwise(&'a Block),
}

/// What standard errors by group are made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum GroupsKept {
    /// Sums, or triangles where rows cannot be summed.
    Sums,
    Triangles,
    Rows,
}

impl GroupsKept {
    /// For a solver.
    pub(super) fn of(solver: SolverKind) -> Self {
        match solver {
            SolverKind::Exact => Self::Sums,
            SolverKind::Huber => Self::Rows,
            // Their features are about another centre than that of the sums.
            _ => Self::Triangles,
        }
    }
}

/// The covariance, as far as it can be had.
pub(super) struct Uncertainty {
    pub(super) covariance: Option<Covariance>,
    pub(super) not_grouped: Option<ValidationError>,
}

impl Uncertainty {
    pub(super) fn of(
        solution: &Solution,
        (solver, truncate): (SolverKind, Option<f64>),
        ridge: f64,
        from: CovarianceFrom<'_>,
    ) -> Self {
        let by_rows = || Covariance::of_rows(solution);
        let found = match from {
            CovarianceFrom::Nothing => Ok(None),
            CovarianceFrom::Rows => Ok(by_rows()),
            CovarianceFrom::Groups(_) if GroupsKept::of(solver) != GroupsKept::Sums => {
                Err(ValidationError::OtherSolver)
            }
            CovarianceFrom::Groups(sums) => {
                Covariance::of_groups(sums, &solution.model, ridge).map(Some)
            }
            CovarianceFrom::Factored(_) if solver == SolverKind::Huber => {
                Err(ValidationError::OtherSolver)
            }
            CovarianceFrom::Factored(rows) => {
                let method = match solver {
                    SolverKind::Svd => Method::Svd { truncate },
                    SolverKind::RidgeGcv => Method::RidgeGcv,
                    _ => Method::Tsqr,
                };
                Covariance::of_factored(rows, solution, method, ridge).map(Some)
            }
            CovarianceFrom::Rowwise(rows) => {
                Covariance::of_clipped_groups(rows, solution, ridge).map(Some)
            }
        };
        match found {
            Ok(covariance) => Self { covariance, not_grouped: None },
            // Rows that resemble each other would promise too much.
            Err(ValidationError::OtherSolver) => {
                Self { covariance: None, not_grouped: Some(ValidationError::OtherSolver) }
            }
            Err(error) => Self { covariance: by_rows(), not_grouped: Some(error) },
        }
    }
}
