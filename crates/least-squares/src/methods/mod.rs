//! Dense linear least squares, `min ‖X·C − Y‖`, by a family of methods over one stream of rows.
//!
//! Rows come in chunks `[X | Y]`, with elements of `X` in double-double where `f64` would round them ([`RowChunk`]). A
//! [`Reduction`] is the result of a pass; its memory does not grow with the rows. A [`RowSource`] allows any number of
//! passes:
//!
//! | method | passes | memory | relative error of the coefficients, about |
//! | --- | --- | --- | --- |
//! | [`SolverKind::Gram`] | 1 | `XᵀX` | ε·κ² |
//! | [`SolverKind::Tsqr`], [`SolverKind::PivotedQr`], [`SolverKind::Svd`] | 1 | R | ε·(κ + κ²·tan θ) |
//! | [`SolverKind::RefinedTsqr`] | 2 or more | R, then `XᵀR` in double-double | ε, while ε·κ ≪ 1 |
//! | [`SolverKind::WideGram`] | 1 | `XᵀX` in double-double | ε + ε²·κ² |
//! | [`SolverKind::WideTsqr`] | 1 | R in double-double | ε + ε²·(κ + κ²·tan θ) |
//! | [`SolverKind::RidgeGcv`] | 1 | R | the error of the ridge |
//! | [`SolverKind::Huber`] | about 10 | R, then clipped gradients | not a least-squares answer |
//!
//! with ε = 2⁻⁵³, κ the condition number of `X` with columns of norm one, and θ the angle between
//! `Y` and its prediction (Björck, Numerical Methods for Least Squares Problems, 1996, §1.4, §2.4).
//! A method returns [`LeastSquaresError::IllConditioned`] if it cannot distinguish full rank from
//! loss of rank, or if its error would leave no correct digit.

#[cfg(test)]
#[path = "tests/dense.rs"]
mod dense;
mod gcv;
mod gram;
mod huber;
mod rank_revealing;
mod refinement;
mod rows;
mod wide;
mod wide_matrix;

pub(crate) use self::huber::clip_of_sizes;
pub use self::rows::{Reduction, RowChunk, RowSource, Shape};
pub use super::r_factor::{LeastSquares, LeastSquaresError, Ridge};

use self::gram::Gram;
use self::wide::{WideGram, WideRFactor};
use super::r_factor::RFactor;

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum SolverKind {
    /// Exact sums of integer readings; other rows as [`SolverKind::RefinedTsqr`].
    Exact,
    /// Householder QR over row blocks.
    Tsqr,
    /// Householder QR, corrected by residuals in double-double: two passes or more.
    RefinedTsqr,
    /// QR with column pivoting of the R factor of [`SolverKind::Tsqr`], whose columns have the lengths and angles of
    /// those of `X`.
    PivotedQr,
    /// Singular values of the R factor, which are the singular values of `X`.
    Svd,
    /// Normal equations and Cholesky in `f64`.
    Gram,
    /// Normal equations and Cholesky in double-double.
    WideGram,
    /// Householder QR over row blocks in double-double.
    WideTsqr,
    /// Ridge regression, with the parameter chosen by generalised cross-validation.
    RidgeGcv,
    /// Huber's M-estimator: distant rows get less weight. About ten passes.
    Huber,
}

/// A solver and its options.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Method {
    pub solver: SolverKind,
    /// For [`SolverKind::Svd`], with columns of norm one: drops singular values below this fraction of the largest.
    pub truncate: Option<f64>,
}

impl From<SolverKind> for Method {
    fn from(solver: SolverKind) -> Self {
        Self { solver, truncate: None }
    }
}

impl SolverKind {
    pub const ALL: [SolverKind; 10] = {
        use SolverKind::*;
        [Exact, Tsqr, RefinedTsqr, PivotedQr, Svd, Gram, WideGram, WideTsqr, RidgeGcv, Huber]
    };

    /// Name in files and on the command line.
    pub const fn name(self) -> &'static str {
        NAMES[self as usize].0
    }

    pub const fn description(self) -> &'static str {
        NAMES[self as usize].1
    }

    /// Solver to use instead of one that only serves as a reference in tests: equal digits at lower cost.
    pub const fn instead(self) -> Option<Self> {
        match self {
            Self::RefinedTsqr | Self::Gram | Self::WideGram | Self::WideTsqr => Some(Self::Exact),
            Self::PivotedQr => Some(Self::Svd),
            Self::Exact | Self::Tsqr | Self::Svd | Self::RidgeGcv | Self::Huber => None,
        }
    }

    /// The solvers that users can choose.
    pub fn offered() -> impl Iterator<Item = Self> {
        Self::ALL.into_iter().filter(|solver| solver.instead().is_none())
    }
}

const NAMES: [(&str, &str); 10] = [
    ("exact", "Exact sums of integer readings; QR, corrected by residuals, of others"),
    ("tsqr", "Householder QR over row blocks"),
    ("refined-tsqr", "QR, corrected by residuals in double-double"),
    ("pivoted-qr", "QR with column pivoting"),
    ("svd", "Singular values"),
    ("gram", "Normal equations in double precision: fast and coarse"),
    ("wide-gram", "Normal equations in double-double"),
    ("wide-tsqr", "Householder QR in double-double: slow and sure"),
    ("ridge-gcv", "Ridge, its parameter chosen by generalised cross-validation"),
    ("huber", "Huber's M-estimator: rows far off count less"),
];

/// Solves `min ‖X·C − Y‖² + λ·‖D·C‖²`, and also returns λ.
///
/// With [`SolverKind::RidgeGcv`], `ridge` only determines the column that is not penalised.
///
/// # Errors
/// [`LeastSquaresError`] if the rows, or this method with them, do not determine the coefficients; errors of `rows`.
pub fn solve<R: RowSource>(
    rows: &mut R,
    method: Method,
    ridge: Ridge,
) -> Result<(LeastSquares, f64), R::Error> {
    let shape = rows.shape();
    let no_rows = || RFactor::new(shape.features, shape.outputs);
    let solved = match method.solver {
        SolverKind::Tsqr | SolverKind::Svd | SolverKind::RidgeGcv => {
            return Ok(solve_r_factor(&rows.pass(&no_rows())?, method, ridge)?);
        }
        SolverKind::PivotedQr => rank_revealing::pivoted(&rows.pass(&no_rows())?, ridge)?,
        SolverKind::Gram => rows.pass(&Gram::new(shape))?.solve(ridge)?,
        SolverKind::WideGram => rows.pass(&WideGram::new(shape))?.solve(ridge)?,
        SolverKind::WideTsqr => rows.pass(&WideRFactor::new(shape))?.solve(ridge)?,
        SolverKind::Exact | SolverKind::RefinedTsqr => refinement::solve(rows, ridge)?,
        SolverKind::Huber => huber::solve(rows, ridge)?,
    };
    Ok((solved, ridge.lambda))
}

/// Solves from a known R factor: by singular values, by a ridge with GCV, or else by QR. For rows of equal weight, the
/// results of other least-squares methods would differ only by rounding.
pub(crate) fn solve_r_factor(
    r_factor: &RFactor,
    method: Method,
    ridge: Ridge,
) -> Result<(LeastSquares, f64), LeastSquaresError> {
    let Ridge { free_column, .. } = ridge;
    Ok(match method.solver {
        SolverKind::Svd => (rank_revealing::svd(r_factor, ridge, method.truncate)?, ridge.lambda),
        SolverKind::RidgeGcv => {
            let lambda = gcv::lambda(r_factor, free_column)?;
            (r_factor.solve(Ridge { lambda, free_column })?, lambda)
        }
        _ => (r_factor.solve(ridge)?, ridge.lambda),
    })
}
