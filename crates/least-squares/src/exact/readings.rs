//! The unit in which the readings of a channel are integers, and their range. A finite binary or decimal fraction is an
//! integer over `2^twos·5^fives`: averages of sixteen conversions count in sixteenths, decimals in tenths or
//! hundredths. The common unit does not depend on the order of the rows.

use shell_data::vectorised;

/// Fraction of a count, 2⁻ᵏ·5⁻ᵐ, that divides all readings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct ReadingUnit {
    /// Exponent k of two.
    pub twos: u32,
    /// Exponent m of five.
    pub fives: u32,
}

impl ReadingUnit {
    pub(crate) const COUNT: Self = Self { twos: 0, fives: 0 };
    /// Finest unit in use: with a finer one, readings of a useful range would exceed 16 bits.
    const FINEST: Self = Self { twos: 8, fives: 5 };

    pub(crate) fn per_count(self) -> u32 {
        5u32.pow(self.fives) << self.twos
    }

    /// Number of units of `other`, which is finer, in one unit of `self`.
    pub(crate) fn ratio(self, other: Self) -> u32 {
        other.per_count() / self.per_count()
    }

    pub(crate) fn and(self, other: Self) -> Self {
        Self { twos: self.twos.max(other.twos), fives: self.fives.max(other.fives) }
    }

    /// Exponent of the power of two nearest to the number of units in a count.
    pub(crate) fn nearest_power(self) -> i32 {
        f64::from(self.per_count()).log2().round() as i32
    }

    /// Returns true if the unit is not finer than `FINEST`.
    pub(crate) fn is_sane(self) -> bool {
        self.twos <= Self::FINEST.twos && self.fives <= Self::FINEST.fives
    }

    #[inline(always)]
    pub(crate) fn count(self, reading: f64) -> f64 {
        (reading * f64::from(self.per_count())).round()
    }

    #[inline(always)]
    pub(crate) fn suits(self, reading: f64) -> bool {
        self.count(reading) / f64::from(self.per_count()) == reading
    }

    /// Coarsest unit, not coarser than `known`, in which all readings of a column are integers; `None` without one.
    pub(crate) fn new(column: &[f64], known: Self) -> Option<Self> {
        let suits = |unit: &Self| column.iter().all(|&reading| unit.suits(reading));
        let fives = (known.fives..=Self::FINEST.fives)
            .map(|fives| Self { fives, ..Self::FINEST })
            .find(suits)?
            .fives;
        (known.twos..=Self::FINEST.twos).map(|twos| Self { twos, fives }).find(suits)
    }
}

pub(crate) fn count(column: &[f64], unit: ReadingUnit, out: &mut [f64]) {
    if unit == ReadingUnit::COUNT {
        out.copy_from_slice(column);
    } else {
        out.iter_mut().zip(column).for_each(|(out, &reading)| *out = unit.count(reading));
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct ChannelRange {
    /// All readings are integer multiples of this unit.
    pub unit: ReadingUnit,
    /// Lowest reading, in multiples of `unit`.
    pub lowest: i64,
    /// Highest reading, in multiples of `unit`; below `lowest` for zero rows.
    pub highest: i64,
}

impl ChannelRange {
    pub(crate) const EMPTY: Self =
        Self { unit: ReadingUnit::COUNT, lowest: i64::MAX, highest: i64::MIN };

    pub(crate) fn rescale(&mut self, unit: ReadingUnit) {
        if self.lowest <= self.highest {
            let factor = i64::from(self.unit.ratio(unit));
            self.lowest = self.lowest.saturating_mul(factor);
            self.highest = self.highest.saturating_mul(factor);
        }
        self.unit = unit;
    }

    pub(crate) fn merge(&mut self, other: &Self) {
        let mut other = *other;
        let unit = self.unit.and(other.unit);
        self.rescale(unit);
        other.rescale(unit);
        self.lowest = self.lowest.min(other.lowest);
        self.highest = self.highest.max(other.highest);
    }

    /// Returns true if the integers fit in 16 bits, with or without sign, or there are none.
    pub(crate) fn fits(&self) -> bool {
        self.lowest > self.highest
            || (self.lowest > -(1 << 16)
                && self.highest < 1 << 16
                && self.highest - self.lowest < 1 << 16)
    }

    pub(crate) fn middle(&self) -> i64 {
        if self.lowest > self.highest { 0 } else { (self.lowest + self.highest + 1).div_euclid(2) }
    }
}

/// Range of a column, in a unit that suits it and `known`. The error is a reading that is no 16-bit integer.
pub(crate) fn scan_column(column: &[f64], known: ReadingUnit) -> Result<ChannelRange, f64> {
    if known == ReadingUnit::COUNT {
        let (lowest, highest, integers) = scan_integers(column);
        if integers && (column.is_empty() || fits(lowest) && fits(highest)) {
            return Ok(ChannelRange {
                unit: known,
                lowest: lowest as i64,
                highest: highest as i64,
            });
        }
    }
    let unit = match column.iter().all(|&reading| known.suits(reading)) {
        true => known,
        false => ReadingUnit::new(column, known).unwrap_or(known),
    };
    let is_bad = |reading: &&f64| !unit.suits(**reading) || !fits(unit.count(**reading));
    if let Some(&bad) = column.iter().find(is_bad) {
        return Err(bad);
    }
    let counts = || column.iter().map(|&reading| unit.count(reading) as i64);
    Ok(ChannelRange {
        unit,
        lowest: counts().min().unwrap_or(i64::MAX),
        highest: counts().max().unwrap_or(i64::MIN),
    })
}

fn fits(count: f64) -> bool {
    count.abs() < f64::from(1 << 16)
}

vectorised! {
    /// Returns the smallest and the largest value, and true if all values are integers.
    fn scan_integers(column: &[f64]) -> (f64, f64, bool) {
        /// Adding and subtracting this constant rounds to an integer.
        const ROUND: f64 = 1.5 * (1u64 << 52) as f64;
        let mut lowest = [f64::INFINITY; 32];
        let mut highest = [f64::NEG_INFINITY; 32];
        let mut odd = [0.0; 32];
        let (chunks, rest) = column.as_chunks::<32>();
        for chunk in chunks {
            for i in 0..32 {
                let x = chunk[i];
                lowest[i] = if x < lowest[i] { x } else { lowest[i] };
                highest[i] = if x > highest[i] { x } else { highest[i] };
                // Zero for integers of up to 51 bits, positive for fractions, NaN if not finite.
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
        let unit = scan_column(column, ReadingUnit::COUNT).unwrap().unit;
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
            let found = scan_column(column, ReadingUnit::COUNT);
            assert_eq!(found.is_ok(), column.len() == 2, "{column:?}");
        }
    }

    #[test]
    fn the_common_unit_does_not_depend_on_the_order() {
        let readings = [0.5, 0.1, 3.25, 0.04, 0.0625, 17.0];
        let common = |order: &[usize]| {
            order.iter().fold(ReadingUnit::COUNT, |known, &i| {
                known.and(scan_column(&readings[i..=i], known).unwrap().unit)
            })
        };
        let all = scan_column(&readings, ReadingUnit::COUNT).unwrap().unit;
        assert_eq!(common(&[0, 1, 2, 3, 4, 5]), all);
        assert_eq!(common(&[5, 4, 3, 2, 1, 0]), all);
        assert_eq!(common(&[3, 0, 4, 5, 1, 2]), all);
        assert_eq!((all.twos, all.fives, all.per_count()), (4, 2, 400));
    }

    #[test]
    fn readings_are_counted_in_their_unit() {
        let column = [4095.9375, 0.0625, -1.5];
        let ChannelRange { unit, lowest, highest } =
            scan_column(&column, ReadingUnit::COUNT).unwrap();
        let mut counts = [0.0; 3];
        count(&column, unit, &mut counts);
        assert_eq!((counts, lowest, highest), ([65535.0, 1.0, -24.0], -24, 65535));
    }
}
