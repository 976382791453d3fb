//! From exact sums to coefficients.
//!
//! 1. Rank, in integers (see [`rank`](super::rank)).
//! 2. With an intercept, the origin of each channel is moved to its mean, rounded to an integer: an
//!    exact change of basis that takes most of the collinearity out of the powers.
//! 3. Columns and axes are scaled by powers of two to norms near one, the sums rounded to
//!    double-double, and the normal equations solved by Cholesky. Relative error: about
//!    κ(X)²·2⁻¹⁰⁴, with κ after shift and scaling.
//! 4. Where that may not do, iterative refinement with residuals in exact integers, as in Higham,
//!    *Accuracy and Stability of Numerical Algorithms*, chapter 12: it converges as long as
//!    κ(X) < 10¹⁵.

use super::equations::IntegerEquations;
use super::fit::ExactFit;
use super::rank::rank_loss;
use crate::FitError;
use crate::exact::moments::product_sums::Moments;
use crate::model::Model;

impl Moments {
    /// The coefficients of `model` that fit the rows best: those that minimise the sum of squares
    /// of residuals and, for each feature but the intercept, of `√ridge` times its coefficient
    /// times the norm of its column.
    ///
    /// Without ridge, each coefficient is within a unit in the last place of the exact solution
    /// unless it is some 10¹⁰ times smaller than its standard fellow features suggest.
    ///
    /// # Errors
    /// [`FitError`] if the rows do not determine the coefficients.
    pub fn solve(&self, model: &Model, ridge: f64) -> Result<ExactFit, FitError> {
        if !(ridge >= 0.0 && ridge.is_finite()) {
            return Err(FitError::Ridge(ridge));
        }
        let terms = self.summed_terms(model)?;
        if self.rows < terms.len() as u64 && ridge == 0.0 || self.rows == 0 {
            return Err(FitError::TooFewRows { rows: self.rows, coefficients: terms.len() });
        }
        let positions = self.positions(&terms);
        let loss = rank_loss(self, &terms, &positions);
        let rank = loss.as_ref().map_or(terms.len(), |loss| loss.rank);
        if let Some(loss) = loss.filter(|_| ridge == 0.0) {
            let is_all = self.reading_ranges().constant_channels().len() == self.channels();
            return Err(match is_all {
                true => FitError::IdenticalRows { rows: self.rows },
                false => FitError::RankDeficient(loss),
            });
        }
        IntegerEquations::new(self, model, terms, positions).solve(ridge, rank)
    }
}
