//! Standard errors of converted samples.
//!
//! With residual covariance `S` over the axes and `F·Fᵀ = (XᵀX)⁻¹`, the covariance of the
//! coefficients of axes `a` and `b` is `S[a][b]·F·Fᵀ`. A new sample with features `x` has noise and
//! the error of the coefficients. A tare subtracts the mean of `n` frames with mean features `x₀`,
//! which adds their noise and removes the common part of both (Draper & Smith, Applied Regression
//! Analysis, 3rd ed., §1.4, §8.1):
//!
//! ```text
//! untared   se² = S[a][a]·(1 + ‖Fᵀx‖²)
//! tared     se² = S[a][a]·(1 + 1/n + ‖Fᵀ(x − x₀)‖²)
//! ```
//!
//! This holds for errors that are independent between rows. Rows of one pose share place, creep and
//! angle. With groups, each axis `a` has a separate covariance, `T·Tᵀ`, from the scatter of the
//! groups (see [`GroupScatter`](crate::sandwich::GroupScatter)), and
//! ```text
//! untared   se² = S[a][a] + ‖Tᵀx‖²
//! tared     se² = S[a][a]·(1 + ρ + (1 − ρ)/n) + ‖Tᵀ(x − x₀)‖²
//! ```
//!
//! with ρ the share of the squared errors that the rows of a group have in common: the error of the
//! tare's pose does not decrease with more frames. There are G − 1 degrees of freedom for G groups
//! (Bester, Conley & Hansen, J. Econometrics 165, 2011; Cameron & Miller, J. Human Resources 50,
//! 2015, §VI). With a ridge, `F` and `T` include it, but not the bias that it causes.

mod clipped_groups;
mod covariance;
mod group_intervals;
mod interval;
mod new_groups;
mod quantile;

pub use self::covariance::{CoefficientCovariance, Covariance};
pub(crate) use self::group_intervals::GroupScore;
pub use self::group_intervals::{GroupIntervals, LEVELS, Scores, TooFewGroups};
pub use self::interval::{ErrorShape, HIGHEST_LEVEL, NoIntervals};
pub(crate) use self::new_groups::score_of;
pub use self::quantile::{fisher_quantile, student_quantile};
pub use crate::symmetric::TriangularColumns;
