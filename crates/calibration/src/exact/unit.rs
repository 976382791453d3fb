//! What readings are counted in, so that they are integers.
//!
//! A reading with a finite binary or decimal fraction is an integer over `2^twos·5^fives`, in lowest
//! terms. A channel is counted in the common unit of its readings: averages of sixteen conversions
//! in sixteenths, decimals in tenths or hundredths. The common unit of all rows does not depend on
//! their order.

use pulp::{Arch, NullaryFnOnce};
use serde::{Deserialize, Serialize};

use super::moments::Channel;

/// The part of a count that readings are integer multiples of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Unit {
    twos: u32,
    fives: u32,
}

impl Unit {
    /// A count.
    pub(super) const COUNT: Self = Self { twos: 0, fives: 0 };
    /// Halved eight times and with five decimals: finer ones leave no integers of 16 bits of
    /// readings that were worth measuring.
    const FINEST: Self = Self { twos: 8, fives: 5 };

    /// How many of them make a count.
    pub(super) fn per_count(self) -> u32 {
        5u32.pow(self.fives) << self.twos
    }

    /// How many of the finer unit `other` make one of these.
    pub(super) fn ratio(self, other: Self) -> u32 {
        other.per_count() / self.per_count()
    }

    /// The coarsest unit of which both are multiples.
    pub(super) fn and(self, other: Self) -> Self {
        Self { twos: self.twos.max(other.twos), fives: self.fives.max(other.fives) }
    }

    /// The power of two that is nearest to the number of them in a count, as an exponent.
    pub(super) fn nearest_power(self) -> i32 {
        f64::from(self.per_count()).log2().round() as i32
    }

    /// Whether it is one that is ever used.
    pub(super) fn is_sane(self) -> bool {
        self.twos <= Self::FINEST.twos && self.fives <= Self::FINEST.fives
    }

    /// A reading in these, as the nearest integer.
    #[inline(always)]
    fn count(self, reading: f64) -> f64 {
        (reading * f64::from(self.per_count())).round()
    }

    #[inline(always)]
    fn suits(self, reading: f64) -> bool {
        self.count(reading) / f64::from(self.per_count()) == reading
    }

    /// The coarsest unit that suits a column and `known`, if there is one.
    fn of(column: &[f64], known: Self) -> Option<Self> {
        let suits = |unit: &Self| column.iter().all(|&reading| unit.suits(reading));
        let fives = (known.fives..=Self::FINEST.fives)
            .map(|fives| Self { fives, ..Self::FINEST })
            .find(suits)?
            .fives;
        (known.twos..=Self::FINEST.twos).map(|twos| Self { twos, fives }).find(suits)
    }
}

/// The range of a column, in a unit that suits it and `known`; or a reading that is no integer of 16
/// bits.
pub(super) fn survey(column: &[f64], known: Unit) -> Result<Channel, f64> {
    if known == Unit::COUNT {
        let (lowest, highest, integers) = Arch::new().dispatch(SurveyIntegers(column));
        if integers && (column.is_empty() || fits(lowest) && fits(highest)) {
            return Ok(Channel { unit: known, lowest: lowest as i64, highest: highest as i64 });
        }
    }
    let unit = match column.iter().all(|&reading| known.suits(reading)) {
        true => known,
        false => Unit::of(column, known).unwrap_or(known),
    };
    let is_bad = |reading: &&f64| !unit.suits(**reading) || !fits(unit.count(**reading));
    if let Some(&bad) = column.iter().find(is_bad) {
        return Err(bad);
    }
    let counts = || column.iter().map(|&reading| unit.count(reading) as i64);
    Ok(Channel {
        unit,
        lowest: counts().min().unwrap_or(i64::MAX),
        highest: counts().max().unwrap_or(i64::MIN),
    })
}

fn fits(count: f64) -> bool {
    count.abs() < f64::from(1 << 16)
}

/// Writes surveyed readings as integers.
pub(super) fn count(column: &[f64], unit: Unit, out: &mut [f64]) {
    if unit == Unit::COUNT {
        out.copy_from_slice(column);
    } else {
        out.iter_mut().zip(column).for_each(|(out, &reading)| *out = unit.count(reading));
    }
}

/// Smallest, largest, and whether all are integers.
struct SurveyIntegers<'a>(&'a [f64]);

impl NullaryFnOnce for SurveyIntegers<'_> {
    type Output = (f64, f64, bool);

    #[inline(always)]
    fn call(self) -> (f64, f64, bool) {
        /// Adding and taking it away rounds to an integer.
        const ROUND: f64 = 1.5 * (1u64 << 52) as f64;
        let mut lowest = [f64::INFINITY; 32];
        let mut highest = [f64::NEG_INFINITY; 32];
        let mut odd = [0.0; 32];
        let (chunks, rest) = self.0.as_chunks::<32>();
        for chunk in chunks {
            for i in 0..32 {
                let x = chunk[i];
                lowest[i] = if x < lowest[i] { x } else { lowest[i] };
                highest[i] = if x > highest[i] { x } else { highest[i] };
                // Zero for integers of up to 51 bits, more for fractions, NaN if not finite.
                odd[i] += (x - ((x + ROUND) - ROUND)).abs();
            }
        }
        let integers = odd.iter().all(|&odd| odd == 0.0) && rest.iter().all(|x| x.fract() == 0.0);
        let lowest = lowest.iter().chain(rest).copied().fold(f64::INFINITY, f64::min);
        let highest = highest.iter().chain(rest).copied().fold(f64::NEG_INFINITY, f64::max);
        (lowest, highest, integers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit(column: &[f64]) -> (u32, u32) {
        let unit = survey(column, Unit::COUNT).unwrap().unit;
        (unit.twos, unit.fives)
    }

    #[test]
    fn the_unit_of_a_column_is_the_coarsest_that_suits_all_its_readings() {
        assert_eq!(unit(&[3.0, -7.0]), (0, 0));
        assert_eq!(unit(&[4095.9375, 12.5]), (4, 0));
        assert_eq!(unit(&[0.1, 0.25]), (2, 1));
        assert_eq!(unit(&[0.05]), (2, 1));
        assert_eq!(unit(&[0.00001]), (5, 5));
        for column in [&[0.1, 0.2][..], &[1.0 / 3.0], &[0.001953125], &[65536.0], &[8000.00001]] {
            let found = survey(column, Unit::COUNT);
            assert_eq!(found.is_ok(), column.len() == 2, "{column:?}");
        }
    }

    #[test]
    fn the_common_unit_does_not_depend_on_the_order() {
        let readings = [0.5, 0.1, 3.25, 0.04, 0.0625, 17.0];
        let common = |order: &[usize]| {
            order.iter().fold(Unit::COUNT, |known, &i| {
                known.and(survey(&readings[i..=i], known).unwrap().unit)
            })
        };
        let all = survey(&readings, Unit::COUNT).unwrap().unit;
        assert_eq!(common(&[0, 1, 2, 3, 4, 5]), all);
        assert_eq!(common(&[5, 4, 3, 2, 1, 0]), all);
        assert_eq!(common(&[3, 0, 4, 5, 1, 2]), all);
        assert_eq!((all.twos, all.fives, all.per_count()), (4, 2, 400));
    }

    #[test]
    fn readings_are_counted_in_their_unit() {
        let column = [4095.9375, 0.0625, -1.5];
        let Channel { unit, lowest, highest } = survey(&column, Unit::COUNT).unwrap();
        let mut counts = [0.0; 3];
        count(&column, unit, &mut counts);
        assert_eq!((counts, lowest, highest), ([65535.0, 1.0, -24.0], -24, 65535));
    }
}
