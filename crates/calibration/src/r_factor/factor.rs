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

    /// `R` and `Z` without the rows of `R` that are rounding errors. If fewer rows than features were added, no more
    /// remain than were added.
    pub fn significant_rows(&self) -> (Mat<f64>, Mat<f64>) {
        let (p, q) = (self.features, self.r.ncols() - self.features);
        // So many reflections, each with a rounding of the column.
        let rounding = |j: usize| self.r.col(j).norm_l2() * p as f64 * f64::EPSILON;
        let rounding: Vec<f64> = (0..p).map(rounding).collect();
        let is_significant = |&i: &usize| (i..p).any(|j| self.r[(i, j)].abs() > rounding[j]);
        let rows: Vec<usize> = (0..p).filter(is_significant).collect();
        let r = Mat::from_fn(rows.len(), p, |i, j| self.r[(rows[i], j)]);
        (r, Mat::from_fn(rows.len(), q, |i, j| self.r[(rows[i], p + j)]))
    }
}
