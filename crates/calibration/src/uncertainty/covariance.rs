//! The covariance of errors and coefficients.

use crate::error::FitError;
use std::ops::Range;

use faer::MatRef;

use super::interval::{ErrorShape, NoIntervals, normal_quantile, student_quantile};
use super::new_groups::{
    held_out_intervals, held_out_intervals_factored, held_out_intervals_of_files,
    held_out_intervals_of_stretches,
};
use crate::factored::FactoredGroups;
use crate::least_squares::Method;
use crate::model::Model;
use crate::passes::Workers;
use crate::physics::GroupIntervals;
use crate::sandwich::GroupScatter;
use crate::solver::Solution;
use crate::validation::grouped::GroupedMoments;
use shell_data::by_axis;
use shell_data::wrench::PerAxis;

/// The covariance that standard errors of predictions are computed from.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Covariance {
    /// `S`, the covariance of the errors of a row, in products of N and N·m.
    #[serde(with = "by_axis::matrix")]
    pub residual: PerAxis<PerAxis<f64>>,
    /// Rows less coefficients, or groups less one.
    pub degrees_of_freedom: u64,
    /// That of the coefficients.
    pub coefficients: CoefficientCovariance,
    /// How the training errors are distributed, where that is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shape: Option<ErrorShape>,
    /// The share of the squared errors that the rows of a group have in common, where groups are known.
    #[serde(default, skip_serializing_if = "Option::is_none", with = "by_axis::option")]
    pub shared: Option<PerAxis<f64>>,
    /// Intervals from groups that were held out, where groups are few.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub intervals: Option<GroupIntervals>,
}

/// The columns of an upper triangular matrix, of lengths 1, 2, …, one per feature.
pub type TriangularColumns = Vec<Vec<f64>>;

/// The covariance of the coefficients, in factors.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CoefficientCovariance {
    /// For errors that are independent from row to row.
    Rows {
        /// `F`, to be multiplied by `S[a][b]`.
        factor: TriangularColumns,
    },
    /// For errors that are alike within groups of rows.
    Groups {
        /// Their number.
        groups: u64,
        /// `T` of each axis.
        #[serde(with = "by_axis")]
        factors: PerAxis<TriangularColumns>,
    },
}

impl Covariance {
    /// The covariance of a solution, errors of rows being independent; `None` if there are no more
    /// rows than coefficients.
    pub fn from_rows(solution: &Solution) -> Option<Self> {
        let factor = &solution.factor;
        let degrees_of_freedom =
            solution.rows.checked_sub(factor.nrows() as u64).filter(|&n| n > 0)?;
        let products = &solution.residual_products;
        Some(Self {
            residual: std::array::from_fn(|a| {
                std::array::from_fn(|b| products[(a, b)] / degrees_of_freedom as f64)
            }),
            degrees_of_freedom,
            coefficients: CoefficientCovariance::Rows {
                factor: triangular_columns(factor.as_ref()),
            },
            shape: None,
            shared: None,
            intervals: None,
        })
    }

    /// The covariance of the fit of `model` to all rows of `sums`, errors being alike within its
    /// groups. `ridge` is as in [`Moments::solve`](crate::exact::Moments::solve). Groups may be stretches of time that
    /// nothing else tells apart.
    ///
    /// # Errors
    /// [`FitError`] if there are too few groups, or without one of them the model cannot be
    /// fitted.
    pub fn from_groups(
        sums: &GroupedMoments,
        model: &Model,
        ridge: f64,
        are_stretches: bool,
        workers: Workers<'_>,
    ) -> Result<Self, FitError> {
        let whole = sums.all_of_several()?;
        let fit = whole.solve(model, ridge)?;
        let (found, groups) = (fit.scatter(&sums.groups)?, &sums.groups);
        let intervals = match are_stretches {
            true => {
                let parts = sums.partitioned(model)?;
                held_out_intervals_of_stretches(&parts, (&fit, &found), groups, ridge, workers)
            }
            false => held_out_intervals(whole, groups, (model, ridge), workers),
        };
        Ok(Self::from_scatter(found, whole.rows(), intervals))
    }

    /// The same of a solution by `method`, from R factors of its rows: for rows that could not be summed
    /// exactly, and methods that sums do not serve. The ridge is what was asked for. Groups that are stretches of time are
    /// held out by whole `files` or each alone, as these say.
    ///
    /// # Errors
    /// As [`Covariance::from_groups`].
    pub fn from_factored(
        rows: &FactoredGroups,
        files: Option<&[Range<usize>]>,
        solution: &Solution,
        by: (Method, f64),
        workers: Workers<'_>,
    ) -> Result<Self, FitError> {
        Self::from_r_factors(rows, solution, workers, |scatter| match files {
            None => held_out_intervals_factored(rows, &solution.model, by, workers),
            Some(files) => {
                held_out_intervals_of_files(rows, files, (solution, scatter), by, workers)
            }
        })
    }

    /// As [`Covariance::from_groups`], from R factors, with the intervals that are found from the scatter.
    pub(super) fn from_r_factors(
        rows: &FactoredGroups,
        solution: &Solution,
        workers: Workers<'_>,
        intervals: impl FnOnce(&GroupScatter) -> Option<GroupIntervals>,
    ) -> Result<Self, FitError> {
        let groups = rows.groups.len();
        if groups < 2 {
            return Err(FitError::TooFewGroups { found: groups });
        }
        let found = rows.scatter(solution, None, workers.threads)?;
        let intervals = intervals(&found);
        Ok(Self::from_scatter(found, solution.rows, intervals))
    }

    fn from_scatter(found: GroupScatter, rows: u64, intervals: Option<GroupIntervals>) -> Self {
        Self {
            residual: found.residual_covariance(rows),
            degrees_of_freedom: found.groups as u64 - 1,
            coefficients: CoefficientCovariance::Groups {
                groups: found.groups as u64,
                factors: found.factors.each_ref().map(|of| triangular_columns(of.as_ref())),
            },
            shape: None,
            shared: Some(found.shared),
            intervals,
        }
    }

    /// How many standard errors either way a prediction interval of `level` reaches, per axis.
    ///
    /// # Errors
    /// [`NoIntervals`] where rows are taken as independent, or groups are too few to tell.
    ///
    /// # Panics
    /// If `level` is not above 0 and below 1.
    pub fn interval_factors(&self, level: f64) -> Result<PerAxis<f64>, NoIntervals> {
        assert!(0.0 < level && level < 1.0, "a level between 0 and 1");
        if matches!(self.coefficients, CoefficientCovariance::Rows { .. }) {
            return Err(NoIntervals::IndependentRows);
        }
        if let Some(intervals) = &self.intervals {
            return Ok(intervals.factors(level)?);
        }
        let z = normal_quantile(level);
        let t = student_quantile(level, self.degrees_of_freedom as f64);
        Ok(std::array::from_fn(|axis| match &self.shape {
            None => t,
            Some(shape) => shape.quantile(axis, level) * t / z,
        }))
    }

    /// Standard deviation of the residuals, per axis, N and N·m.
    pub fn residual_sd(&self) -> PerAxis<f64> {
        std::array::from_fn(|axis| self.residual[axis][axis].sqrt())
    }
}

/// The upper triangle of a matrix.
pub(crate) fn triangular_columns(factor: MatRef<'_, f64>) -> TriangularColumns {
    (0..factor.ncols()).map(|j| (0..=j).map(|i| factor[(i, j)]).collect()).collect()
}
