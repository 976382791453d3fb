//! File format of exact sums. They are checked for consistency on reading, because a changed digit could make a fit
//! wrong or its equations unsolvable. The check rejects everything that violates an assumption of later arithmetic.

use num_bigint::{BigInt, Sign};
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::integers::ScaledIntegers;
use super::layout::pair;
use super::product_sums::ExactSums;
use super::readings::ChannelRange;
use crate::error::MAX_ROWS;
use crate::model::{Basis, Model};
use shell_data::by_axis;
use shell_data::wrench::{Axes, Axis};

/// [`ExactSums`] in file form, with decimal strings for integers too large for JSON readers.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct StoredSums {
    pub basis: Basis,
    pub rows: u64,
    pub channels: Vec<ChannelRange>,
    /// Sums of products of readings, one per distinct product.
    pub readings: Vec<String>,
    /// Sums of products of readings and one axis of the wrench, for each axis present.
    pub wrench: Vec<StoredIntegers>,
    /// Sums of products of two axes, for each pair of axes present.
    pub squares: Vec<StoredIntegers>,
}

#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct StoredIntegers {
    pub exponent: i32,
    /// Integers in decimal.
    pub values: Vec<String>,
}

/// Maximum number of digits. Sums of products of two loads, doubles between 10⁻³⁰⁸ and 10¹⁵, need some 700.
const MAX_DIGITS: usize = 2_000;

/// Checks the length of an integer, because parsing takes time quadratic in it.
fn of_digits(text: &str) -> Result<&str, String> {
    match text.len() {
        0..=MAX_DIGITS => Ok(text),
        found => Err(format!("an integer has `{found}` digits, at most `{MAX_DIGITS}` are read")),
    }
}

/// Positions of the pairs of some axes among all pairs.
fn pairs(axes: Axes) -> Vec<usize> {
    let of = |first: Axis| {
        let others = axes.iter().filter(move |second| second.index() >= first.index());
        others.map(move |second| pair(first.index(), second.index()))
    };
    axes.iter().flat_map(of).collect()
}

/// Converts the sums of the axes of the [document](by_axis) only.
impl From<ExactSums> for StoredSums {
    fn from(moments: ExactSums) -> Self {
        let axes = by_axis::axes();
        let stored = |scaled: &ScaledIntegers| StoredIntegers {
            exponent: scaled.exponent,
            values: scaled.values.iter().map(BigInt::to_string).collect(),
        };
        Self {
            basis: moments.basis,
            rows: moments.rows,
            channels: moments.channels,
            readings: moments.readings.iter().map(i128::to_string).collect(),
            wrench: axes.iter().map(|axis| stored(&moments.wrench[axis.index()])).collect(),
            squares: pairs(axes)
                .into_iter()
                .map(|position| stored(&moments.squares[position]))
                .collect(),
        }
    }
}

/// Reads the sums of the axes of the [document](by_axis); the sums of other axes are zero.
impl TryFrom<StoredSums> for ExactSums {
    type Error = String;

    /// # Errors
    /// A description of the inconsistency, if no rows have such sums.
    fn try_from(stored: StoredSums) -> Result<Self, String> {
        if stored.channels.is_empty() || stored.channels.len() > 255 {
            return Err(format!("`{}` channels, expected 1 to 255", stored.channels.len()));
        }
        let model = Model {
            basis: stored.basis,
            intercept: true,
            channels: stored.channels.len(),
            memory: 0,
        };
        model.check_size().map_err(|error| error.to_string())?;
        let mut moments = ExactSums::new(stored.basis, stored.channels.len());
        let sane = |c: &ChannelRange| c.fits() && c.unit.is_sane();
        if !stored.channels.iter().all(sane) || stored.rows > MAX_ROWS {
            return Err("ranges or rows beyond what can be summed exactly".to_owned());
        }
        let expect = |what: &str, found: usize, expected: usize| {
            (found == expected)
                .then_some(())
                .ok_or_else(|| format!("`{found}` {what}, expected `{expected}`"))
        };
        expect("sums of readings", stored.readings.len(), moments.readings.len())?;
        let axes = by_axis::axes();
        let squares = pairs(axes);
        expect("axes", stored.wrench.len(), axes.count())?;
        expect("products of axes", stored.squares.len(), squares.len())?;
        for (sum, text) in moments.readings.iter_mut().zip(&stored.readings) {
            let text = of_digits(text)?;
            *sum = text.parse().map_err(|_| format!("`{text}` is not an integer of 128 bits"))?;
        }
        if moments.readings[0] != i128::from(stored.rows) {
            return Err("the number of rows is not the sum of ones".to_owned());
        }
        let parse = |sums: &mut ScaledIntegers, stored: &StoredIntegers| {
            expect("sums of an axis", stored.values.len(), sums.values.len())?;
            for (value, text) in sums.values.iter_mut().zip(&stored.values) {
                let text = of_digits(text)?;
                *value = text.parse().map_err(|_| format!("`{text}` is not an integer"))?;
            }
            if !(-4000..=4000).contains(&stored.exponent) {
                return Err(format!("exponent `{}` is out of range", stored.exponent));
            }
            *sums = ScaledIntegers::new(stored.exponent, std::mem::take(&mut sums.values));
            Ok(())
        };
        for (axis, of) in axes.iter().zip(&stored.wrench) {
            parse(&mut moments.wrench[axis.index()], of)?;
        }
        for (position, of) in squares.into_iter().zip(&stored.squares) {
            parse(&mut moments.squares[position], of)?;
        }
        moments.rows = stored.rows;
        moments.channels = stored.channels;
        moments.check_possible().map_err(|error| format!("`moments`: {error}"))?;
        Ok(moments)
    }
}

impl Serialize for ExactSums {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        StoredSums::from(self.clone()).serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for ExactSums {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        StoredSums::deserialize(deserializer)?.try_into().map_err(D::Error::custom)
    }
}

impl ExactSums {
    /// Returns true if `whole` minus these sums leaves sums that rows can have.
    pub fn can_be_part_of(&self, whole: &ExactSums) -> bool {
        let within = |(part, whole): (&ChannelRange, &ChannelRange)| {
            let mut both = *whole;
            both.merge(part);
            both == *whole
        };
        let like = (self.basis, self.channels.len(), self.rows.min(whole.rows));
        like == (whole.basis, whole.channels.len(), self.rows)
            && self.channels.iter().zip(&whole.channels).all(within)
            // The remaining ranges stay those of the whole, even with zero rows left.
            && (self.rows == whole.rows || whole.without(self).check_possible().is_ok())
    }

    /// # Errors
    /// A description of an impossible property: one that no sums over rows have.
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

/// Allowance for the rounding of bounds.
const SLACK: f64 = 1.0 + 1e-6;
