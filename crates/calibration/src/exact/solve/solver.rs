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
//!
//! And what the sums say before anything is solved: means, ranges and variances.

use super::equations::IntegerEquations;
use super::held_out::{EquationScales, ExactFit};
use super::rank::rank_loss;
use crate::FitError;
use crate::double_double::DoubleDouble;
use crate::exact::moments::integers::round_scaled;
use crate::exact::moments::layout::pair;
use crate::exact::moments::product_sums::Moments;
use crate::model::{Model, Term};
use shell_data::wrench::Axis;

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
        let scales = EquationScales::new(self, model)?;
        let size = scales.terms.len();
        if self.rows < size as u64 && ridge == 0.0 {
            return Err(FitError::TooFewRows { rows: self.rows, coefficients: size });
        }
        let loss = rank_loss(self, &scales);
        let rank = loss.as_ref().map_or(size, |loss| loss.rank);
        if let Some(loss) = loss.filter(|_| ridge == 0.0) {
            let is_all = self.reading_ranges().constant_channels().len() == self.channels();
            return Err(match is_all {
                true => FitError::IdenticalRows { rows: self.rows },
                false => FitError::RankDeficient(loss),
            });
        }
        IntegerEquations::new(self, model, scales).solve(ridge, rank)
    }

    /// The terms of a model.
    ///
    /// # Errors
    /// [`FitError`] if the products of one of them were not summed.
    pub(crate) fn summed_terms(&self, model: &Model) -> Result<Vec<Term>, FitError> {
        let terms = model.terms();
        let is_summed =
            |term: &Term| *term == Term::INTERCEPT || self.layout.features.contains(term);
        let (basis, channels) = (self.basis, self.channels());
        if model.channels != channels {
            return Err(FitError::Channels { expected: model.channels, found: channels });
        }
        if terms.iter().all(is_summed) {
            return Ok(terms);
        }
        let summed = Model { basis, intercept: true, channels, memory: 0 };
        Err(FitError::OtherFeatures { kept: summed.name(), asked: model.name() })
    }

    /// The mean of a channel, rounded to an integer.
    pub(crate) fn rounded_mean(&self, channel: usize) -> i64 {
        let rows = i128::from(self.rows);
        (self.sum_of(channel) + rows / 2).div_euclid(rows) as i64
    }

    /// The sum of the readings of a channel.
    pub(crate) fn sum_of(&self, channel: usize) -> i128 {
        let channel = u8::try_from(channel).expect("as many channels as terms name");
        self.readings[self.layout.position(Term::product(&[channel]), Term::INTERCEPT)]
    }

    /// The exponent of the power of two that no reading is farther from `centre` than.
    pub(crate) fn reach(&self, channel: usize, centre: i64) -> i32 {
        let range = &self.channels[channel];
        let reach = (range.highest - centre).max(centre - range.lowest).max(1);
        (reach as u64).next_power_of_two().ilog2() as i32
    }

    /// The variance of an axis over all rows, in N² or (N·m)²; NaN for zero rows.
    pub fn variance(&self, axis: Axis) -> f64 {
        self.total_square(axis.index()) / self.rows as f64
    }

    /// The sum of squared differences from the mean of an axis.
    pub fn total_square(&self, axis: usize) -> f64 {
        let square = &self.squares[pair(axis, axis)];
        let sums = &self.wrench[axis];
        let sum = &sums.values[0];
        // n·Σw² − (Σw)² in units of the finer of both.
        let unit = square.exponent.min(2 * sums.exponent);
        let squares = (&square.values[0] << (square.exponent - unit)) * self.rows;
        let difference = squares - ((sum * sum) << (2 * sums.exponent - unit));
        let total = round_scaled(&difference, unit) / DoubleDouble::from(self.rows as f64);
        total.to_f64()
    }
}
