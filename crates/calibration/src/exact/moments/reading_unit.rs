//! The unit in which readings are integers.
//!
//! A reading with a finite binary or decimal fraction is an integer over `2^twos·5^fives`, in lowest
//! terms. A channel is counted in the common unit of its readings: averages of sixteen conversions
//! in sixteenths, decimals in tenths or hundredths. The common unit of all rows does not depend on
//! their order.

/// The part of a count that readings are integer multiples of: 2⁻ᵏ·5⁻ᵐ counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct ReadingUnit {
    /// k, the power of two.
    pub twos: u32,
    /// m, the power of five.
    pub fives: u32,
}

impl ReadingUnit {
    /// A count.
    pub(crate) const COUNT: Self = Self { twos: 0, fives: 0 };
    /// Halved eight times and with five decimals: finer ones leave no integers of 16 bits of
    /// readings that were worth measuring.
    const FINEST: Self = Self { twos: 8, fives: 5 };

    /// How many of them make a count.
    pub(crate) fn per_count(self) -> u32 {
        5u32.pow(self.fives) << self.twos
    }

    /// How many of the finer unit `other` make one of these.
    pub(crate) fn ratio(self, other: Self) -> u32 {
        other.per_count() / self.per_count()
    }

    /// The coarsest unit of which both are multiples.
    pub(crate) fn and(self, other: Self) -> Self {
        Self { twos: self.twos.max(other.twos), fives: self.fives.max(other.fives) }
    }

    /// The power of two that is nearest to the number of them in a count, as an exponent.
    pub(crate) fn nearest_power(self) -> i32 {
        f64::from(self.per_count()).log2().round() as i32
    }

    /// Whether it is one that is ever used.
    pub(crate) fn is_sane(self) -> bool {
        self.twos <= Self::FINEST.twos && self.fives <= Self::FINEST.fives
    }

    /// A reading in these, as the nearest integer.
    #[inline(always)]
    pub(crate) fn count(self, reading: f64) -> f64 {
        (reading * f64::from(self.per_count())).round()
    }

    #[inline(always)]
    pub(crate) fn suits(self, reading: f64) -> bool {
        self.count(reading) / f64::from(self.per_count()) == reading
    }

    /// The coarsest unit that suits a column and `known`, if there is one.
    pub(crate) fn new(column: &[f64], known: Self) -> Option<Self> {
        let suits = |unit: &Self| column.iter().all(|&reading| unit.suits(reading));
        let fives = (known.fives..=Self::FINEST.fives)
            .map(|fives| Self { fives, ..Self::FINEST })
            .find(suits)?
            .fives;
        (known.twos..=Self::FINEST.twos).map(|twos| Self { twos, fives }).find(suits)
    }
}

/// Writes scanned readings as integers.
pub(crate) fn count(column: &[f64], unit: ReadingUnit, out: &mut [f64]) {
    if unit == ReadingUnit::COUNT {
        out.copy_from_slice(column);
    } else {
        out.iter_mut().zip(column).for_each(|(out, &reading)| *out = unit.count(reading));
    }
}
