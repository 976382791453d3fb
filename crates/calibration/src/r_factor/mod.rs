//! Least squares by Householder QR streamed over row blocks (TSQR), for any dense problem.
//!
//! Of the rows `[X | Y]` seen so far only the R factor of their QR factorisation is kept,
//!
//! ```text
//! [X | Y] = Q · | R  Z |      R p × p, Z = QᵀY p × q, E q × q
//!               | 0  E |
//! ```
//!
//! so memory does not grow with the number of rows. More rows are put below the R factor and the
//! stack is factored again; two R factors merge in the same way (Demmel, Grigori, Hoemmen, Langou,
//! SIAM J. Sci. Comput. 34, 2012). `R·C = Z` solves `min ‖X·C − Y‖`, and `EᵀE` is the matrix of
//! sums of squares and products of the residuals, at the relative accuracy of a QR factorisation.
//! The factorisation does not depend on the scaling of columns; rank and condition are those of the
//! column-equilibrated `R`, whose columns have norm one.
//!
//! Omitted: pivoting, as a rank loss is an error and not something to be worked around.

mod condition;
mod factor;
mod householder;
mod outcome;

pub(crate) use self::condition::extreme_singular_values;
pub use self::factor::RFactor;
pub(crate) use self::factor::{equilibrated, rank_deficient};
pub use self::householder::Workspace;
pub use self::outcome::{LeastSquares, LeastSquaresError, Ridge};
