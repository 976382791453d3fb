use crate::error::FitError;
use std::ops::Range;

use super::group_intervals::GroupIntervals;
use super::interval::{ErrorShape, NoIntervals};
use super::new_groups::{of_scores, score_of, score_without};
use super::quantile::{normal_quantile, student_quantile};
use crate::fitted_groups::FittedGroups;
use crate::model::Model;
use crate::passes::Workers;
use crate::sandwich::GroupScatter;
use crate::solver::Solution;
use crate::symmetric::{TriangularColumns, triangular_columns};
use crate::validation::cross_validation::errors_on;
use crate::validation::grouped::SumsByGroup;
use shell_data::by_axis;
use shell_data::wrench::PerAxis;

#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Covariance {
    /// `S`, covariance of the errors of a row, in products of N and N·m.
    #[serde(with = "by_axis::matrix")]
    pub residual: PerAxis<PerAxis<f64>>,
    /// Rows minus coefficients, or groups minus one.
    pub degrees_of_freedom: u64,
    pub coefficients: CoefficientCovariance,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shape: Option<ErrorShape>,
    /// Fraction of the squared errors that the rows of a group share.
    #[serde(default, skip_serializing_if = "Option::is_none", with = "by_axis::option")]
    pub shared: Option<PerAxis<f64>>,
    /// Intervals from held-out groups, if there are few groups.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub intervals: Option<GroupIntervals>,
}

#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CoefficientCovariance {
    Rows {
        /// `F`: the covariance of the coefficients of axes a and b is `S[a][b]·F·Fᵀ`.
        factor: TriangularColumns,
    },
    Groups {
        groups: u64,
        #[serde(with = "by_axis")]
        factors: PerAxis<TriangularColumns>,
        /// Satterthwaite's degrees of freedom of the variance of each coefficient, for all axes. Absent in files of
        /// earlier versions, with a ridge, and for more than 200 features.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        degrees_of_freedom: Option<Vec<f64>>,
    },
}

impl Covariance {
    /// Covariance if the errors of rows are independent; `None` if there are no more rows than coefficients.
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

    /// Covariance of the fit of `model` to all rows of `sums`, with errors correlated within its groups. `ridge` is as
    /// in [`ExactSums::solve`](crate::exact::ExactSums::solve). `are_time_blocks` is true if groups are blocks of time
    /// that differ in nothing else.
    ///
    /// # Errors
    /// [`FitError`] if there are too few groups, or the model cannot be fitted without one of them.
    pub fn from_groups(
        sums: &SumsByGroup,
        model: &Model,
        ridge: f64,
        are_time_blocks: bool,
        workers: Workers<'_>,
    ) -> Result<Self, FitError> {
        let whole = sums.all_of_several()?;
        let fit = whole.solve(model, ridge)?;
        let (found, groups) = (fit.scatter(&sums.groups, true)?, &sums.groups);
        let intervals = if are_time_blocks {
            // The variances come from the fit to all rows, which one block of time hardly changes: 40 scatters of 39
            // blocks would take most of a poly3 fit's time.
            let (parts, variances) = (sums.partitioned(model)?, fit.variances(&found, groups));
            of_scores(groups.len(), workers, |group| {
                let errors = errors_on(&parts, &groups[group].1, ridge).ok()?;
                Some(score_of(&errors, &variances[group], &found, whole.rows()))
            })
        } else {
            let score = |group| score_without(whole, groups, (model, ridge), group);
            of_scores(groups.len(), workers, score)
        };
        Ok(Self::from_scatter(found, whole.rows(), intervals))
    }

    /// [`Covariance::from_groups`] for other rows and solvers. If groups are blocks of time, `files` lists the blocks
    /// that are held out together, such as whole files.
    ///
    /// # Errors
    /// As [`Covariance::from_groups`].
    pub fn from_fitted(
        groups: &FittedGroups<'_>,
        files: Option<&[Range<usize>]>,
        rows: u64,
        workers: Workers<'_>,
    ) -> Result<Self, FitError> {
        Self::with_intervals(groups, rows, workers, |scatter| match files {
            None => of_scores(groups.count(), workers, |group| groups.score_without(group)),
            // Rows of one file are more alike than rows of two. The fit to all rows gives the standard error of a
            // block.
            Some(files) => {
                let scores = groups.scores_of_files(files, scatter, workers)?;
                Some(GroupIntervals::from_files(&scores))
            }
        })
    }

    pub(super) fn with_intervals(
        groups: &FittedGroups<'_>,
        rows: u64,
        workers: Workers<'_>,
        intervals: impl FnOnce(&GroupScatter) -> Option<GroupIntervals>,
    ) -> Result<Self, FitError> {
        if groups.count() < 2 {
            return Err(FitError::TooFewGroups { found: groups.count() });
        }
        let found = groups.scatter(true, workers)?;
        let intervals = intervals(&found);
        Ok(Self::from_scatter(found, rows, intervals))
    }

    fn from_scatter(found: GroupScatter, rows: u64, intervals: Option<GroupIntervals>) -> Self {
        Self {
            residual: found.residual_covariance(rows),
            degrees_of_freedom: found.groups as u64 - 1,
            coefficients: CoefficientCovariance::Groups {
                groups: found.groups as u64,
                factors: found.factors.each_ref().map(|of| triangular_columns(of.as_ref())),
                degrees_of_freedom: found.degrees_of_freedom,
            },
            shape: None,
            shared: Some(found.shared),
            intervals,
        }
    }

    /// Half-width of a prediction interval of `level` in standard errors, per axis.
    ///
    /// # Errors
    /// [`NoIntervals`] if rows count as independent, or there are too few groups.
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

    /// Degrees of freedom of the variance `‖Tᵀx‖²` of a combination `x` of features, per axis: exact for a single
    /// coefficient, otherwise the harmonic mean over the coefficients, weighted by the variance of each alone.
    pub fn degrees_of_combination(&self, x: &[f64]) -> PerAxis<f64> {
        let all = self.degrees_of_freedom as f64;
        let CoefficientCovariance::Groups { factors, degrees_of_freedom: Some(each), .. } =
            &self.coefficients
        else {
            return [all; 6];
        };
        factors.each_ref().map(|factor| {
            let mut variances = vec![0.0; x.len()];
            for column in factor {
                for ((variance, t), x) in variances.iter_mut().zip(column).zip(x) {
                    *variance += (t * x) * (t * x);
                }
            }
            let parts = variances.iter().zip(each).map(|(variance, degrees)| variance / degrees);
            let (sum, parts) = (variances.iter().sum::<f64>(), parts.sum::<f64>());
            if parts > 0.0 { (sum / parts).min(all) } else { all }
        })
    }

    pub fn residual_sd(&self) -> PerAxis<f64> {
        std::array::from_fn(|axis| self.residual[axis][axis].sqrt())
    }
}
