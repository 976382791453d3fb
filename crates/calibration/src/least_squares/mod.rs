//! Dense linear least squares, `min ‖X·C − Y‖`, by a family of methods over one stream of rows.
//!
//! Nothing here knows of readings and wrenches. Rows come in chunks `[X | Y]`, elements of `X` in
//! double-double where a plain `f64` would round them ([`RowChunk`]). A [`Reduction`] says what a pass
//! over the rows computes: a R factor, a Gram matrix, a gradient; memory does not grow with
//! the rows. [`Rows`] is whatever can be passed over, as often as the method needs:
//!
//! | method | passes | what is kept | relative error of the coefficients, about |
//! | --- | --- | --- | --- |
//! | [`Method::Gram`] | 1 | `XᵀX` | ε·κ² |
//! | [`Method::Tsqr`], [`Method::PivotedQr`], [`Method::Svd`] | 1 | R | ε·(κ + κ²·tan θ) |
//! | [`Method::RefinedTsqr`] | 2 or more | R, then `XᵀR` in double-double | ε, while ε·κ ≪ 1 |
//! | [`Method::WideGram`] | 1 | `XᵀX` in double-double | ε + ε²·κ² |
//! | [`Method::WideTsqr`] | 1 | R in double-double | ε + ε²·(κ + κ²·tan θ) |
//! | [`Method::RidgeGcv`] | 1 | R | that of the ridge |
//! | [`Method::Huber`] | about 10 | R, then clipped gradients | not a least-squares answer |
//!
//! with ε = 2⁻⁵³, κ the condition number of `X` with columns of norm one, θ the angle between `Y`
//! and its prediction (Björck, Numerical Methods for Least Squares Problems, 1996, §1.4, §2.4). A
//! method that cannot tell full rank from a loss of rank, or whose error would leave no digit,
//! answers with [`LeastSquaresError::IllConditioned`] and not with numbers.

#[cfg(test)]
#[path = "tests/dense.rs"]
mod dense;
mod gcv;
mod gram;
mod huber;
mod rank_revealing;
mod refinement;
mod rows;
mod solve;
mod wide;
mod wide_matrix;

pub(crate) use self::huber::clip_of_sizes;
pub use self::rows::{Reduction, RowChunk, Rows, Shape};
pub(crate) use self::solve::solve_r_factor;
pub use self::solve::{Method, solve};
pub use super::r_factor::{LeastSquares, LeastSquaresError, Ridge};
