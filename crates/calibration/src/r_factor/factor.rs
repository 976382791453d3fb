//! The R factor itself.

use faer::{Mat, MatRef};

/// What is kept of the rows seen so far.
#[derive(Clone, Debug, PartialEq)]
pub struct RFactor {
    pub(super) features: usize,
    pub(super) rows: u64,
    /// Upper triangular of order p + q.
    pub(super) r: Mat<f64>,
}

impl RFactor {
    /// No rows yet of `features` columns of `X` and `outputs` columns of `Y`.
    pub fn new(features: usize, outputs: usize) -> Self {
        let order = features + outputs;
        Self { features, rows: 0, r: Mat::zeros(order, order) }
    }

    /// Number of rows seen.
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// That of so many rows, of an upper triangular matrix of order p + q: [`RFactor::whole`].
    ///
    /// # Panics
    /// If the matrix is not square, or smaller than there are features.
    pub fn from_parts(features: usize, rows: u64, whole: Mat<f64>) -> Self {
        assert!(whole.nrows() == whole.ncols() && features <= whole.ncols());
        Self { features, rows, r: whole }
    }

    /// All of it, of order p + q: `R` and `Z`, below them zeros and `E`.
    pub fn whole(&self) -> MatRef<'_, f64> {
        self.r.as_ref()
    }

    /// The upper triangular `R`, p × p.
    pub fn r(&self) -> MatRef<'_, f64> {
        self.r.as_ref().submatrix(0, 0, self.features, self.features)
    }
}
