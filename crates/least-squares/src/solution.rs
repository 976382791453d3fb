use faer::Mat;

use crate::features::Features;
use crate::methods::LeastSquares;
use crate::model::Model;
use crate::scaling::Scaling;

/// Coefficients with their covariance factors and diagnostics. Rows and columns of features are in
/// the order of [`Model::terms`]; axes are in the order of [`shell_data::wrench::Axis::ALL`].
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    pub model: Model,
    pub scaling: Scaling,
    /// `C`, features × 6, in N and N·m.
    pub coefficients: Mat<f64>,
    /// Upper triangular `F` with `F·Fᵀ = (XᵀX)⁻¹`, ridge included, features × features.
    pub factor: Mat<f64>,
    /// `(W − X·C)ᵀ(W − X·C)`, 6 × 6, in products of N and N·m.
    pub residual_products: Mat<f64>,
    pub rows: u64,
    /// 2-norm condition number of the features, with columns scaled to norm one.
    pub condition: f64,
    pub rank: usize,
    /// λ, as requested or as found by the solver.
    pub ridge: f64,
}

impl Solution {
    pub(crate) fn new(features: &Features, solved: LeastSquares, ridge: f64) -> Self {
        Self {
            model: features.model,
            scaling: features.scaling.clone(),
            coefficients: solved.coefficients,
            factor: solved.factor,
            residual_products: solved.residual_products,
            rows: solved.rows,
            condition: solved.condition,
            rank: solved.rank,
            ridge,
        }
    }
}
