//! Least squares by Householder QR streamed over row blocks (TSQR), for any dense problem.
//!
//! The method keeps only the R factor of the rows `[X | Y]` so far,
//!
//! ```text
//! [X | Y] = Q · | R  Z |      R p × p, Z = QᵀY p × q, E q × q
//!               | 0  E |
//! ```
//!
//! so memory does not grow with the number of rows. Further rows are put below it and the stack is factored again;
//! two R factors merge in the same way (Demmel, Grigori, Hoemmen, Langou, SIAM J. Sci. Comput. 34, 2012). `R·C = Z`
//! solves `min ‖X·C − Y‖`, and `EᵀE` are the products of the residuals, with the relative accuracy of a QR
//! factorisation. Rank and condition number refer to `R` with columns of norm one. There is no pivoting, because a
//! loss of rank is an error here.

mod factor;
mod householder;

pub(crate) use self::factor::{condition_and_rank, equilibrated, rank_deficient};
pub use self::householder::RFactor;

use faer::Mat;

#[derive(Clone, Debug, PartialEq)]
pub struct LeastSquares {
    /// `C`, p × q.
    pub coefficients: Mat<f64>,
    /// Upper triangular `F` with `F·Fᵀ = (XᵀX + Λ)⁻¹`, p × p: `R⁻¹`.
    pub factor: Mat<f64>,
    /// `(Y − X·C)ᵀ(Y − X·C)`, q × q.
    pub residual_products: Mat<f64>,
    pub rows: u64,
    /// 2-norm condition number of `X` with its columns scaled to norm one.
    pub condition: f64,
    /// Number of singular values of that matrix above the tolerance.
    pub rank: usize,
}

/// Reason for the lack of a unique finite solution.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LeastSquaresError {
    #[error("`{rows}` rows cannot determine `{columns}` coefficients")]
    TooFewRows {
        rows: u64,
        /// Columns of `X`.
        columns: usize,
    },
    #[error("only `{rank}` of `{columns}` columns are independent")]
    RankDeficient {
        rank: usize,
        columns: usize,
        /// p × (p − rank): orthonormal directions in which equilibrated columns cancel.
        null_space: Mat<f64>,
        /// p × p: columns with the lengths and angles of the columns of `X`.
        r_factor: Box<Mat<f64>>,
    },
    #[error("the condition number is above `{limit:.1e}`, which this method cannot solve for")]
    IllConditioned {
        /// Largest condition number, with columns scaled to norm one, that the method can solve for.
        limit: f64,
    },
    #[error("no answer after `{passes}` passes over the rows")]
    NotConverged {
        /// Passes made over the rows.
        passes: usize,
    },
    /// A value is infinite or not a number, in the input or by overflow.
    #[error("a value is not finite, or too large for its square to be")]
    NotFinite,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ridge {
    /// λ ≥ 0: the fit minimises `‖X·C − Y‖² + λ·‖D·C‖²` with the norms `D` of the columns. λ therefore has no unit, and
    /// its effect does not depend on the number of rows.
    pub lambda: f64,
    /// The intercept, which is not penalised.
    pub free_column: Option<usize>,
}

impl Ridge {
    pub const NONE: Ridge = Ridge { lambda: 0.0, free_column: None };

    /// Checks that `rows` rows can determine `columns` coefficients, and that their sums are finite.
    pub(crate) fn check(
        self,
        rows: u64,
        columns: usize,
        is_finite: bool,
    ) -> Result<(), LeastSquaresError> {
        if rows < columns as u64 && self.lambda == 0.0 {
            return Err(LeastSquaresError::TooFewRows { rows, columns });
        }
        if is_finite { Ok(()) } else { Err(LeastSquaresError::NotFinite) }
    }

    /// The amounts added to the squares of columns with these norms.
    pub(crate) fn penalties(&self, norms: &[f64]) -> Vec<f64> {
        let penalty = |(j, norm): (usize, &f64)| match self.free_column == Some(j) {
            true => 0.0,
            false => self.lambda * norm * norm,
        };
        norms.iter().enumerate().map(penalty).collect()
    }
}
