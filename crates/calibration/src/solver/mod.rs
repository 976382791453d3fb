//! From rows to coefficients: what all solvers have in common.
//!
//! A solver reduces blocks of rows to partial fits, merges partial fits in the order of the rows
//! and solves what is left. Memory does not grow with the number of rows, and blocks may be
//! reduced on several threads.

mod centring;
mod exact;
mod family;
mod kind;
mod problem;
mod solution;

pub use self::centring::{Centring, ReadingSums};
pub use self::exact::{Exact, ExactPartial, solve_moments};
pub use self::family::{exact_moments, fit, fit_by};
pub use self::kind::SolverKind;
pub use self::problem::FitProblem;
pub use self::solution::Solution;
pub use crate::factor::InverseFactor;
pub use crate::passes::{Pass, Rows, Workers};
