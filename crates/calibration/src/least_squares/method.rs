//! The methods by name.

/// How to solve.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Method {
    /// Householder QR over row blocks.
    Tsqr,
    /// The same, corrected by residuals in double-double.
    RefinedTsqr,
    /// QR with column pivoting. Pivots are chosen in the R factor that [`Method::Tsqr`] leaves,
    /// whose columns have the lengths and angles of those of `X`: the same factorisation.
    PivotedQr,
    /// Singular values, again of the R factor, which has those of `X`.
    Svd {
        /// Leaves out directions whose singular value, of columns of norm one, is below this share
        /// of the largest. `None` leaves out nothing.
        truncate: Option<f64>,
    },
    /// Normal equations and Cholesky in `f64`.
    Gram,
    /// Normal equations and Cholesky in double-double.
    WideGram,
    /// Householder QR over row blocks in double-double.
    WideTsqr,
    /// A ridge whose parameter generalised cross-validation chooses.
    RidgeGcv,
    /// Huber's M-estimator: rows far off count less.
    Huber,
}
