//! What solvers find.

use faer::Mat;

use crate::factor::InverseFactor;
use crate::features::Features;
use crate::least_squares::LeastSquares;
use crate::model::Model;
use crate::scaling::Scaling;

/// Coefficients and all that is known about them. Rows and columns of features are in the order of
/// [`Model::terms`], those of axes in the order of [`shell_data::wrench::Axis::ALL`].
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// The features.
    pub model: Model,
    /// Centre and scale of the readings that the coefficients are for.
    pub scaling: Scaling,
    /// `C`, features × 6, in N and N·m.
    pub coefficients: Mat<f64>,
    /// Upper triangular `F` with `F·Fᵀ = (XᵀX)⁻¹`, ridge included, features × features.
    pub factor: InverseFactor,
    /// `(W − X·C)ᵀ(W − X·C)`, 6 × 6, in products of N and N·m.
    pub residual_products: Mat<f64>,
    /// Rows fitted.
    pub rows: u64,
    /// Condition number of the features, columns scaled to norm one.
    pub condition: f64,
    /// Independent features.
    pub rank: usize,
    /// λ of the ridge: that which was asked for, or which the solver found.
    pub ridge: f64,
}

impl Solution {
    pub(crate) fn new(features: &Features, solved: LeastSquares, ridge: f64) -> Self {
        Self {
            model: features.model(),
            scaling: features.scaling().clone(),
            coefficients: solved.coefficients,
            factor: InverseFactor::Known(solved.factor),
            residual_products: solved.residual_products,
            rows: solved.rows,
            condition: solved.condition,
            rank: solved.rank,
            ridge,
        }
    }
}
