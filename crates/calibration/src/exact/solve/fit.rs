//! The result of a fit to exact sums.

use faer::Mat;

use super::cholesky::{AxisRow, Bordered, axis_row};
use super::partition::EquationScales;
use super::rank::ExactRankLoss;
use crate::double_double::DoubleDouble;
use crate::exact::moments::rounding::shifted;
use crate::model::Model;
use shell_data::wrench::PerAxis;

/// Coefficients, and what the sums say about them. Features are in the order of [`Model::terms`],
/// axes in that of [`shell_data::wrench::Axis::ALL`].
#[derive(Clone, Debug)]
pub struct ExactFit {
    /// The features.
    pub model: Model,
    /// Rows fitted.
    pub rows: u64,
    /// What is subtracted from the readings of each channel before products are taken, in counts;
    /// zero without an intercept.
    pub centre: Vec<f64>,
    /// What they are divided by after that: a power of two.
    pub scale: Vec<f64>,
    /// One row per feature of centred and scaled readings, in N and N·m.
    pub coefficients: Vec<PerAxis<DoubleDouble>>,
    /// `(W − X·C)ᵀ(W − X·C)`, in products of N and N·m.
    pub residual_products: [PerAxis<f64>; 6],
    /// For each axis the sum of squared differences from the mean.
    pub total_squares: PerAxis<f64>,
    /// Condition number of the features, columns scaled to norm one.
    pub condition: f64,
    /// Independent features: all, unless a ridge stands in for the others.
    pub rank: usize,
    /// The Cholesky factor of scaled features.
    pub(crate) cholesky: Bordered,
    /// `2^exponent` times a column of it is that of the centred and scaled feature.
    pub(crate) exponents: Vec<i32>,
    /// Those of the features of readings that are counted in the units of the sums, in N and N·m.
    pub(crate) scales: EquationScales,
    /// How much larger a feature is than one that is counted so: one where units are powers of two.
    pub(crate) stretch: Vec<DoubleDouble>,
}

/// Why the sums give no coefficients.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SolveError {
    /// Fewer rows than coefficients.
    #[error("`{rows}` rows are too few for the `{coefficients}` coefficients of each axis")]
    TooFewRows {
        /// Rows summed.
        rows: u64,
        /// Coefficients of each axis.
        coefficients: usize,
    },
    /// Some features are combinations of others.
    #[error("{0}")]
    RankDeficient(ExactRankLoss),
    /// The features are independent, but so nearly not that refinement does not converge.
    #[error("the features are so nearly dependent that their coefficients cannot be computed")]
    NearlyDependent,
    /// A coefficient is too large for `f64`.
    #[error("coefficients exceed the range of numbers")]
    Overflow,
    /// A ridge parameter that is not a finite number from zero up.
    #[error("the ridge parameter is `{0}`, expected a finite number that is not negative")]
    Ridge(f64),
    /// Features that were not summed.
    #[error("the sums are for `{summed}` features, not for `{asked}`")]
    OtherFeatures {
        /// What the sums are for.
        summed: String,
        /// What was asked for.
        asked: String,
    },
}

impl ExactFit {
    /// Upper triangular `R` with `RᵀR = XᵀX`, ridge included: columns are features of centred and
    /// scaled readings. In `f64`, which is enough for standard errors.
    pub fn r_factor(&self) -> Mat<f64> {
        let Self { cholesky, exponents, .. } = self;
        Mat::from_fn(cholesky.size, cholesky.size, |i, j| match i <= j {
            true => (shifted(cholesky.get(i, j), -exponents[j]) * self.stretch[j]).to_f64(),
            false => 0.0,
        })
    }

    /// The coefficients for features as they are counted, axes as lanes.
    pub(crate) fn counted_coefficients(&self) -> Vec<AxisRow> {
        let row = |(row, &stretch): (&PerAxis<DoubleDouble>, &DoubleDouble)| -> AxisRow {
            axis_row(|axis| row[axis] * stretch)
        };
        self.coefficients.iter().zip(&self.stretch).map(row).collect()
    }
}
