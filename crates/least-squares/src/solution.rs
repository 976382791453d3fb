//! The result of a fit.

use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::{Mat, Par};

use crate::features::Features;
use crate::methods::LeastSquares;
use crate::model::Model;
use crate::scaling::Scaling;
use crate::symmetric::{SymmetricMatrix, UpperTriangle, add_multiple, product};
use shell_data::block::Block;
use shell_data::wrench::PerAxis;

/// Coefficients with their covariance factors and diagnostics. Rows and columns of features are in
/// the order of [`Model::terms`]; axes are in the order of [`shell_data::wrench::Axis::ALL`].
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// The features.
    pub model: Model,
    /// Centre and scale of the readings.
    pub scaling: Scaling,
    /// `C`, features × 6, in N and N·m.
    pub coefficients: Mat<f64>,
    /// Upper triangular `F` with `F·Fᵀ = (XᵀX)⁻¹`, ridge included, features × features.
    pub factor: Mat<f64>,
    /// `(W − X·C)ᵀ(W − X·C)`, 6 × 6, in products of N and N·m.
    pub residual_products: Mat<f64>,
    /// Number of rows fitted.
    pub rows: u64,
    /// Condition number of the features, with columns scaled to norm one.
    pub condition: f64,
    /// Number of independent features.
    pub rank: usize,
    /// λ of the ridge, as requested or as found by the solver.
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

    /// The solution without some of its rows, from its factor alone (downdating by Woodbury's
    /// identity). With the features `X` of these rows, their errors `E` and
    /// `Uᵀ·U = I − (X·F)ᵀ·(X·F)`, the new factor is `F·U⁻¹`. Condition number and rank stay
    /// unchanged. `None` if these rows alone determine some of the coefficients, so that too few
    /// digits would remain.
    pub fn without(&self, rows: &Block) -> Option<Self> {
        /// Remaining share of a direction, squared: eight digits of sixteen.
        const LEAST_LEFT: f64 = 1e-8;
        let features = Features::new(self.model, self.scaling.clone());
        let count = features.len();
        let mut columns = vec![0.0; rows.rows * count];
        features.fill(&rows.readings, 0..rows.rows, &mut columns, rows.rows);
        let row =
            |of: usize| -> Vec<f64> { columns[of..].iter().step_by(rows.rows).copied().collect() };
        let known = UpperTriangle::new(&self.factor);
        let seen: Vec<Vec<f64>> =
            (0..rows.rows).map(|of| known.transposed_times(&row(of))).collect();
        let mut left = SymmetricMatrix::identity(count);
        left.subtract_squares(&seen);
        let root = left.cholesky()?;
        if (0..count).any(|i| root.row(i)[0].powi(2) < LEAST_LEFT) {
            return None;
        }
        let coefficients = |axis: usize| self.coefficients.col(axis).iter().copied().collect();
        let errors: PerAxis<Vec<f64>> = std::array::from_fn(|axis| {
            let coefficients: Vec<f64> = coefficients(axis);
            let measured = &rows.wrench[axis];
            (0..rows.rows).map(|of| product(&row(of), &coefficients) - measured[of]).collect()
        });
        let pulls = errors.each_ref().map(|errors| {
            let mut pull = vec![0.0; count];
            seen.iter().zip(errors).for_each(|(seen, &error)| add_multiple(&mut pull, error, seen));
            root.forward(pull)
        });
        let mut factor = self.factor.clone();
        let (lower, columns) = (root.matrix(), factor.as_mut().transpose_mut());
        solve_lower_triangular_in_place(lower.transpose(), columns, Par::Seq);
        let pulled = Mat::from_fn(count, 6, |i, axis| pulls[axis][i]);
        let products = Mat::from_fn(6, 6, |a, b| {
            product(&errors[a], &errors[b]) + product(&pulls[a], &pulls[b])
        });
        Some(Self {
            coefficients: &self.coefficients + &factor * pulled,
            factor,
            residual_products: &self.residual_products - products,
            rows: self.rows - rows.rows as u64,
            scaling: self.scaling.clone(),
            ..*self
        })
    }
}
