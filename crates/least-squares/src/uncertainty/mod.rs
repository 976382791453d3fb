//! Standard errors of converted samples.
//!
//! With residual covariance `S` over the axes and `F·Fᵀ = (XᵀX)⁻¹`, the covariance of the
//! coefficients of axes `a` and `b` is `S[a][b]·F·Fᵀ`. A new sample with features `x` is off by its
//! own noise and by the error of the coefficients; a tare subtracts the mean of `n` frames with
//! mean features `x₀`, which adds their noise and removes what both share (Draper & Smith, Applied
//! Regression Analysis, 3rd ed., §1.4, §8.1):
//!
//! ```text
//! untared   se² = S[a][a]·(1 + ‖Fᵀx‖²)
//! tared     se² = S[a][a]·(1 + 1/n + ‖Fᵀ(x − x₀)‖²)
//! ```
//!
//! This holds for errors that are independent from row to row. Rows of one pose are not: they share
//! place, creep and angle, and a hundred of them tell little more than ten. Where rows come in
//! groups, each axis `a` has a covariance of its own, `T·Tᵀ`, from how the groups scatter (see
//! [`GroupScatter`](crate::sandwich::GroupScatter)), and
//!
//! ```text
//! untared   se² = S[a][a] + ‖Tᵀx‖²
//! tared     se² = S[a][a]·(1 + ρ + (1 − ρ)/n) + ‖Tᵀ(x − x₀)‖²
//! ```
//!
//! with ρ the share of the squared errors that the rows of a group have in common: the error of the tare's
//! pose is not noise, and does not fall with more frames. There are G − 1 degrees of freedom for G groups
//! (Bester, Conley & Hansen, J. Econometrics 165, 2011; Cameron & Miller, J. Human Resources 50, 2015, §VI).
//! With a ridge, `F` and `T` include it, which leaves out the bias that the ridge brings.

mod clipped_groups;
mod covariance;
mod group_intervals;
mod interval;
mod new_groups;

pub use self::covariance::{CoefficientCovariance, Covariance};
pub use self::group_intervals::{GroupIntervals, LEVELS, Scores, TooFewGroups};
pub use self::interval::{ErrorShape, HIGHEST_LEVEL, NoIntervals, student_quantile};
pub use crate::symmetric::TriangularColumns;
