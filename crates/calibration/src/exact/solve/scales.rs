//! What the sums say before anything is solved: means, ranges and variances.

use crate::FitError;
use crate::double_double::DoubleDouble;
use crate::exact::moments::layout::pair;
use crate::exact::moments::product_sums::Moments;
use crate::exact::moments::rounding::round_scaled;
use crate::model::{Model, Term};
use shell_data::wrench::Axis;

impl Moments {
    /// Where the products of each two terms stand among the sums, row by row.
    pub(crate) fn positions(&self, terms: &[Term]) -> Vec<usize> {
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

    /// Where the origin of each channel is moved to before a model is solved for: its mean, rounded, if there is an
    /// intercept.
    pub(crate) fn centre(&self, model: &Model) -> Vec<i64> {
        (0..model.channels)
            .map(|i| if model.intercept { self.rounded_mean(i) } else { 0 })
            .collect()
    }

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
