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

use faer::Mat;

use super::cholesky::Bordered;
use super::equations::Equations;
use super::moments::Moments;
use super::open_sums::pair;
use super::rank::{RankLoss, rank_loss};
use super::rounding::{round_scaled, shifted};
use crate::double_double::DoubleDouble;
use crate::model::{Model, Term};
use shell_data::wrench::{Axis, PerAxis};

/// Coefficients, and what the sums say about them. Features are in the order of [`Model::terms`],
/// axes in that of [`shell_data::wrench::Axis::ALL`].
#[derive(Clone, Debug)]
pub struct Fit {
    /// The features.
    pub model: Model,
    /// Rows fitted.
    pub rows: u64,
    /// What is subtracted from the readings of each channel before products are taken, in counts;
    /// zero without an intercept.
    pub centre: Vec<f64>,
    /// What they are divided by after that: a power of two.
    pub scale: Vec<f64>,
    /// One row per feature of centred and scaled readings, in N and N·m.
    pub coefficients: Vec<PerAxis<DoubleDouble>>,
    /// `(W − X·C)ᵀ(W − X·C)`, in products of N and N·m.
    pub residual_products: [PerAxis<f64>; 6],
    /// For each axis the sum of squared differences from the mean.
    pub total_squares: PerAxis<f64>,
    /// Condition number of the features, columns scaled to norm one.
    pub condition: f64,
    /// Independent features: all, unless a ridge stands in for the others.
    pub rank: usize,
    pub(super) factor: Factor,
    pub(super) counted: Counted,
}

/// Why the sums give no coefficients.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SolveError {
    /// Fewer rows than coefficients.
    #[error("`{rows}` rows are too few for the `{coefficients}` coefficients of each axis")]
    TooFewRows {
        /// Rows summed.
        rows: u64,
        /// Coefficients of each axis.
        coefficients: usize,
    },
    /// Some features are combinations of others.
    #[error("{0}")]
    RankDeficient(RankLoss),
    /// The features are independent, but so nearly not that refinement does not converge.
    #[error("the features are so nearly dependent that their coefficients cannot be computed")]
    NearlyDependent,
    /// A coefficient is too large for `f64`.
    #[error("coefficients exceed the range of numbers")]
    Overflow,
    /// A ridge parameter that is not a finite number from zero up.
    #[error("the ridge parameter is `{0}`, expected a finite number that is not negative")]
    Ridge(f64),
    /// Features that were not summed.
    #[error("the sums are for `{summed}` features, not for `{asked}`")]
    OtherFeatures {
        /// What the sums are for.
        summed: String,
        /// What was asked for.
        asked: String,
    },
}

/// The Cholesky factor of scaled features.
#[derive(Clone, Debug)]
pub(super) struct Factor {
    pub(super) cholesky: Bordered,
    /// `2^exponent` times a column of it is that of the centred and scaled feature.
    pub(super) exponents: Vec<i32>,
}

/// The features of readings that are counted in the units of the sums.
#[derive(Clone, Debug)]
pub(super) struct Counted {
    /// What is subtracted.
    pub(super) centre: Vec<i64>,
    /// The power of two that the rest is divided by.
    pub(super) reach: Vec<i32>,
    /// How much larger a feature of [`Fit`] is than one of these: one where units are powers of two.
    pub(super) stretch: Vec<DoubleDouble>,
}

impl Moments {
    /// The coefficients of `model` that fit the rows best: those that minimise the sum of squares
    /// of residuals and, for each feature but the intercept, of `√ridge` times its coefficient
    /// times the norm of its column.
    ///
    /// Without ridge, each coefficient is within a unit in the last place of the exact solution
    /// unless it is some 10¹⁰ times smaller than its standard fellow features suggest.
    ///
    /// # Errors
    /// [`SolveError`] if the rows do not determine the coefficients.
    pub fn solve(&self, model: &Model, ridge: f64) -> Result<Fit, SolveError> {
        let terms = model.terms();
        if !(ridge >= 0.0 && ridge.is_finite()) {
            return Err(SolveError::Ridge(ridge));
        }
        if model.channels != self.channels.len() || !contains(self, &terms) {
            let summed =
                Model { basis: self.basis, intercept: true, channels: self.channels.len() };
            return Err(SolveError::OtherFeatures { summed: summed.name(), asked: model.name() });
        }
        if self.rows < terms.len() as u64 && ridge == 0.0 || self.rows == 0 {
            return Err(SolveError::TooFewRows { rows: self.rows, coefficients: terms.len() });
        }
        let positions = self.positions(&terms);
        let loss = rank_loss(self, &terms, &positions);
        let rank = loss.as_ref().map_or(terms.len(), |loss| loss.rank);
        if let Some(loss) = loss.filter(|_| ridge == 0.0) {
            return Err(SolveError::RankDeficient(loss));
        }
        let centre: Vec<i64> = (0..model.channels)
            .map(|i| if model.intercept { self.rounded_mean(i) } else { 0 })
            .collect();
        Equations::new(self, model, terms, positions, &centre).solve(ridge, rank)
    }

    /// Where the products of each two terms stand among the sums, row by row.
    pub(super) fn positions(&self, terms: &[Term]) -> Vec<usize> {
        let size = terms.len();
        let mut positions = vec![0; size * size];
        for a in 0..size {
            for b in a..size {
                let position = self.layout.position(terms[a], terms[b]);
                positions[a * size + b] = position;
                positions[b * size + a] = position;
            }
        }
        positions
    }

    /// Exponents of the powers of two just above the norms of `size` columns, whose products stand
    /// among `readings` at those positions, and of the six axes; 0 where there are only zeros.
    pub(super) fn norms(
        &self,
        readings: &[i128],
        positions: &[usize],
        size: usize,
    ) -> (Vec<i32>, [i32; 6]) {
        let half = |exponent: i32| exponent.div_euclid(2) + 1;
        let columns = (0..size).map(|j| match readings[positions[j * size + j]] {
            0 => 0,
            square => half(square.ilog2() as i32),
        });
        let axes = std::array::from_fn(|axis| {
            let square = &self.squares[pair(axis, axis)];
            match square.values[0].bits() {
                0 => 0,
                bits => half(square.exponent + bits as i32 - 1),
            }
        });
        (columns.collect(), axes)
    }

    pub(super) fn rounded_mean(&self, channel: usize) -> i64 {
        let sum = self.readings[1 + self.layout.single(channel)];
        let rows = i128::from(self.rows);
        (sum + rows / 2).div_euclid(rows) as i64
    }

    /// The exponent of the power of two that no reading is farther from `centre` than.
    pub(super) fn reach(&self, channel: usize, centre: i64) -> i32 {
        let range = &self.channels[channel];
        let reach = (range.highest - centre).max(centre - range.lowest).max(1);
        (reach as u64).next_power_of_two().ilog2() as i32
    }
}

pub(super) fn contains(moments: &Moments, terms: &[Term]) -> bool {
    terms.iter().all(|term| *term == Term::INTERCEPT || moments.layout.features.contains(term))
}

impl Moments {
    /// The variance of an axis over all rows, in N² or (N·m)²; NaN of no rows.
    pub fn variance(&self, axis: Axis) -> f64 {
        self.total_square(axis.index()) / self.rows as f64
    }

    /// The sum of squared differences from the mean of an axis.
    pub(super) fn total_square(&self, axis: usize) -> f64 {
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

impl Fit {
    /// The fraction of the variance of each axis that the fit explains; `None` for an axis that
    /// does not vary.
    pub fn r_squared(&self) -> PerAxis<Option<f64>> {
        std::array::from_fn(|axis| {
            let total = self.total_squares[axis];
            (total > 0.0).then(|| 1.0 - self.residual_products[axis][axis] / total)
        })
    }

    /// Upper triangular `R` with `RᵀR = XᵀX`, ridge included: columns are features of centred and
    /// scaled readings. In `f64`, which is enough for standard errors.
    pub fn triangle(&self) -> Mat<f64> {
        let Factor { cholesky, exponents } = &self.factor;
        Mat::from_fn(cholesky.size, cholesky.size, |i, j| match i <= j {
            true => (shifted(cholesky.get(i, j), -exponents[j]) * self.counted.stretch[j]).to_f64(),
            false => 0.0,
        })
    }
}
