//! Whether sums that were read from a file can be those of some rows.
//!
//! A single changed digit of a sum makes a fit wrong, or its equations none. Not every change can be
//! found so, but none that arithmetic further on takes for granted goes through.

use num_bigint::Sign;

use super::channel_range::ChannelRange;
use super::layout::pair;
use super::product_sums::Moments;

/// Room for the rounding of bounds.
const SLACK: f64 = 1.0 + 1e-6;

impl Moments {
    /// Whether these can be the sums of some of the rows of `whole`. Where they cannot, taking them away
    /// from it would leave sums of no rows.
    pub fn can_be_part_of(&self, whole: &Moments) -> bool {
        let within = |(part, whole): (&ChannelRange, &ChannelRange)| {
            let mut both = *whole;
            both.merge(part);
            both == *whole
        };
        let like = (self.basis, self.channels.len(), self.rows.min(whole.rows));
        like == (whole.basis, whole.channels.len(), self.rows)
            && self.channels.iter().zip(&whole.channels).all(within)
            // The ranges of what is left are those of the whole, also where no rows are left.
            && (self.rows == whole.rows || whole.without(self).check_possible().is_ok())
    }

    /// # Errors
    /// What no rows have for sums.
    pub(crate) fn check_possible(&self) -> Result<(), String> {
        if self.rows == 0 {
            return match self.readings.iter().all(|&sum| sum == 0) {
                true => Ok(()),
                false => Err("sums of readings over `0` rows".to_owned()),
            };
        }
        let rows = i128::from(self.rows);
        for (i, range) in self.channels.iter().enumerate() {
            let sum = self.sum_of(i);
            let (lowest, highest) = (i128::from(range.lowest), i128::from(range.highest));
            if lowest > highest || sum < lowest * rows || sum > highest * rows {
                return Err(format!("the mean of channel {} is not within its range", i + 1));
            }
        }
        let bounds = self.bounds();
        if let Some(i) =
            (0..bounds.len()).find(|&i| self.readings[i].unsigned_abs() as f64 > bounds[i])
        {
            return Err(format!("the sum of readings {i} is larger than the ranges allow"));
        }
        // About the mean, as they are solved.
        let centre: Vec<i64> = (0..self.channels.len()).map(|i| self.rounded_mean(i)).collect();
        let centred = self.readings_about(&centre);
        let is_negative = |&term: &_| centred[self.layout.position(term, term)] < 0;
        if let Some(term) = self.layout.features.iter().find(|term| is_negative(term)) {
            return Err(format!("the sum of squares of `{}` is negative", term.name()));
        }
        for axis in 0..6 {
            let is_negative = self.squares[pair(axis, axis)].values[0].sign() == Sign::Minus;
            if is_negative || self.total_square(axis) < 0.0 {
                return Err(format!("the sum of squares of axis {} is negative", axis + 1));
            }
        }
        Ok(())
    }

    /// The largest magnitude of each sum of readings, by the ranges of the channels.
    fn bounds(&self) -> Vec<f64> {
        let mut bounds = vec![self.rows as f64 * SLACK; self.readings.len()];
        for (channel, range) in self.channels.iter().enumerate() {
            let reach = range.lowest.unsigned_abs().max(range.highest.unsigned_abs()) as f64;
            for (bound, exponent) in bounds.iter_mut().zip(self.layout.exponents(channel)) {
                *bound *= reach.powi(exponent as i32);
            }
        }
        bounds
    }
}
