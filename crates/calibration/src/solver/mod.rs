//! From rows to coefficients: what all solvers have in common.
//!
//! A solver reduces blocks of rows to partial fits, merges partial fits in the order of the rows
//! and solves what is left. Memory does not grow with the number of rows, and blocks may be
//! reduced on several threads.

mod centring;
mod family;
mod kind;

pub use self::centring::ReadingSums;
pub use self::family::{exact_moments, fit, fit_by};
pub use self::kind::SolverKind;
pub use crate::factor::InverseFactor;
pub use crate::passes::{Pass, Rows, Workers};
pub use crate::solution::Solution;

use crate::model::Model;
use crate::scaling::Scaling;

/// The input of a solver besides the rows.
#[derive(Clone, Debug, PartialEq)]
pub struct FitProblem {
    /// The features.
    pub model: Model,
    /// Centre and scale of the readings.
    pub scaling: Scaling,
    /// λ ≥ 0 of a ridge on columns of norm one; the intercept is not penalised. 0 for none.
    pub ridge: f64,
}
