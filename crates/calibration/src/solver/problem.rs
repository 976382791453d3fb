//! What is to be solved.

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
