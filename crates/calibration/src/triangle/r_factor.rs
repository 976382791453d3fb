//! The triangle itself.

use faer::{Mat, MatRef};

/// What is kept of the rows seen so far.
#[derive(Clone, Debug, PartialEq)]
pub struct Triangle {
    pub(super) features: usize,
    pub(super) rows: u64,
    /// Upper triangular of order p + q.
    pub(super) r: Mat<f64>,
}

impl Triangle {
    /// No rows yet of `features` columns of `X` and `outputs` columns of `Y`.
    pub fn new(features: usize, outputs: usize) -> Self {
        let order = features + outputs;
        Self { features, rows: 0, r: Mat::zeros(order, order) }
    }

    /// Number of rows seen.
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// The upper triangular `R`, p × p.
    pub fn r(&self) -> MatRef<'_, f64> {
        self.r.as_ref().submatrix(0, 0, self.features, self.features)
    }
}
