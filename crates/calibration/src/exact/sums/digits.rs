//! How the wrench is written in small integers, so that sums of products with it are exact.
//!
//! Any numbers can be cut into [limbs](super::limbs), some five for a double. Multiples of a step
//! need two digits only: with `c` the double nearest to the step and `2^unit` the last place of
//! `c`, the double nearest to `n` steps is
//!
//! ```text
//! x = n·c + d·2^unit,    |d| ≤ 2·|n|
//! ```
//!
//! for `x` and `c` are each within 2⁻⁵³, relatively, of what they stand for, so that `x − n·c` is at
//! most `|n|·c·2⁻⁵²`; and `2^unit`, of which `x` and `c` are multiples, is at least `c·2⁻⁵³`.

use num_bigint::BigInt;

use super::kernel::ROWS;
use super::limbs::{BinaryPlaces, Limbs};
use crate::decimal_step::DecimalStep;
use crate::exact::moments::rounding::power_of_two;
use crate::exact::moments::scaled_integers::join;

/// What is known of the numbers of an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Numbers {
    places: BinaryPlaces,
    /// What they are multiples of, if anything.
    step: Option<DecimalStep>,
    /// The largest magnitude.
    largest: f64,
}

impl Numbers {
    /// No numbers, or zeros only.
    pub(crate) const NONE: Self =
        Self { places: BinaryPlaces::NONE, step: Some(DecimalStep::NONE), largest: 0.0 };

    pub(crate) fn new(values: &[f64]) -> Self {
        let largest = values.iter().fold(0.0, |largest: f64, x| largest.max(x.abs()));
        Self { places: BinaryPlaces::new(values), step: DecimalStep::new(values), largest }
    }

    /// What is known of both.
    pub(crate) fn and(self, other: Self) -> Self {
        let steps = self.step.zip(other.step);
        Self {
            places: self.places.and(other.places),
            step: steps.and_then(|(a, b)| a.and(b)),
            largest: self.largest.max(other.largest),
        }
    }

    /// The two digits of multiples of a step, of at most `width` bits with their sign; `None` if
    /// the numbers are no such multiples or too large.
    pub(crate) fn grid(self, width: u32) -> Option<DigitGrid> {
        let grid = DigitGrid::new(self.step?.size()?, width)?;
        grid.holds(self.largest).then_some(grid)
    }

    /// Limbs of the given width; `None` if the numbers have too many places.
    pub(crate) fn limbs(self, width: u32) -> Option<Limbs> {
        self.places.limbs(width)
    }
}

/// A way to write the numbers of an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Digits {
    Limbs(Limbs),
    DigitGrid(DigitGrid),
}

/// Digits of multiples of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct DigitGrid {
    /// The double nearest to the step.
    step: f64,
    /// Exponent of its last place.
    unit: i32,
    /// The largest magnitude of a digit.
    largest: f64,
}

impl Digits {
    /// How many there are.
    pub(crate) fn count(&self) -> usize {
        match self {
            Self::Limbs(limbs) => limbs.count,
            Self::DigitGrid(_) => 2,
        }
    }

    /// Exponent of what [`Digits::join`] counts in.
    pub(crate) fn unit(&self) -> i32 {
        match self {
            Self::Limbs(limbs) => limbs.unit,
            Self::DigitGrid(grid) => grid.unit,
        }
    }

    /// Cuts a column into as many columns as there are digits, lowest first. Says whether they add
    /// up to the numbers.
    #[inline(always)]
    pub(crate) fn cut(&self, column: &[f64], out: &mut [f64]) -> bool {
        match self {
            Self::Limbs(limbs) => limbs.cut(column, out),
            Self::DigitGrid(grid) => grid.cut(column, out),
        }
    }

    /// The sum over numbers from the sums over their digits, lowest first.
    pub(crate) fn join(&self, sums: impl DoubleEndedIterator<Item = i128> + Clone) -> BigInt {
        match self {
            Self::Limbs(limbs) => join(sums, limbs.width),
            Self::DigitGrid(grid) => {
                let narrow = sums.clone().zip(grid.weights()).try_fold(0_i128, |all, (sum, w)| {
                    all.checked_add(sum.checked_mul(i128::from(w))?)
                });
                narrow.map_or_else(|| self.join_joined(sums.map(BigInt::from)), BigInt::from)
            }
        }
    }

    /// The same where the sums over digits have been joined before.
    pub(crate) fn join_joined(&self, sums: impl Iterator<Item = BigInt>) -> BigInt {
        match self {
            Self::Limbs(limbs) => {
                let up = (0_u32..).step_by(limbs.width as usize);
                sums.zip(up).map(|(sum, up)| sum << up).sum()
            }
            Self::DigitGrid(grid) => {
                sums.zip(grid.weights()).map(|(sum, weight)| sum * weight).sum()
            }
        }
    }
}

impl DigitGrid {
    fn new(step: f64, width: u32) -> Option<Self> {
        let unit = i32::try_from(step.to_bits() >> 52).ok()? - 1075;
        // Decimal steps are nowhere near the ends of the range of exponents.
        (-900..900).contains(&unit).then_some(Self {
            step,
            unit,
            largest: power_of_two(width as i32 - 1),
        })
    }

    /// Whether all multiples of the step up to `number` have such digits.
    fn holds(&self, number: f64) -> bool {
        // One more than the bounds of n and d allow for rounding here.
        let n = number / self.step + 1.0;
        let d = n * (self.step * power_of_two(-self.unit)) * power_of_two(-52) + 1.0;
        n.max(d) <= self.largest
    }

    /// What a one of each digit stands for, in units.
    fn weights(&self) -> [u64; 2] {
        [1, (self.step * power_of_two(-self.unit)) as u64]
    }

    #[inline(always)]
    fn cut(&self, column: &[f64], out: &mut [f64]) -> bool {
        /// Adding and taking it away rounds to an integer.
        const ROUND: f64 = 1.5 * (1_u64 << 52) as f64;
        let Self { step, unit, largest } = *self;
        let (per_step, per_unit) = (step.recip(), power_of_two(-unit));
        let (low, high) = out.split_at_mut(ROWS);
        let mut exact = true;
        for ((&x, low), high) in column.iter().zip(low).zip(high) {
            let n = (x * per_step + ROUND) - ROUND;
            // Exact where |n| ≥ 1, for then x has no bits below 2^(unit − 1), and the rest is within
            // 2⁵³ of these if d is as small as is asked for; and where n = 0.
            let d = (-n).mul_add(step, x) * per_unit;
            exact &= (n.abs() <= largest) & (d.abs() <= largest) & (d == (d + ROUND) - ROUND);
            (*low, *high) = (d, n);
        }
        exact
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn grid(values: &[f64], width: u32) -> Option<Digits> {
        Numbers::new(values).grid(width).map(Digits::DigitGrid)
    }

    #[test]
    fn numbers_off_the_grid_and_large_ones_are_noticed() {
        let digits = grid(&[0.00625, 1.1], 16).unwrap();
        let mut out = vec![0.0; 2 * ROWS];
        let mut cut = |x: f64| digits.cut(&[x; ROWS], &mut out);
        // The fourth is not the double nearest to 48 steps, but the one next to it.
        assert!(cut(-1.1) && cut(0.0) && cut(5000.0 * 0.00625) && cut(0.1 + 0.2));
        for x in [1e-9, 0.003, 300.0, 1e300, f64::NAN, f64::INFINITY, 5e-324] {
            assert!(!cut(x), "{x}");
        }
        assert_eq!(grid(&[0.00625, 1000.0], 16), None);
        assert_eq!(grid(&[1.0 / 3.0], 16), None);
        assert_eq!(grid(&[0.0], 16), None);
        assert_eq!(grid(&[1e12, 1e-9], 16), None);
    }

    proptest! {
        #[test]
        fn what_a_grid_is_chosen_for_has_digits_on_it(
            parts in prop::collection::vec((-30_000_000..30_000_000_i64, 0..=9), 1..6),
            width in 8_u32..24,
        ) {
            // Decimals of any size, in parts.
            let parse = |&(m, decimals): &(i64, i32)| format!("{m}e-{decimals}").parse().unwrap();
            let values: Vec<f64> = parts.iter().map(parse).collect();
            let known = values.iter().fold(Numbers::NONE, |known, &x| known.and(Numbers::new(&[x])));
            if let Some(grid) = known.grid(width) {
                let mut out = vec![0.0; 2 * ROWS];
                for x in values {
                    prop_assert!(Digits::DigitGrid(grid).cut(&[x; ROWS], &mut out), "{}", x);
                }
            }
        }

        #[test]
        fn digits_are_small_integers_that_add_up(
            counts in prop::collection::vec(-8000..=8000_i32, ROWS),
            times in 1..1000_u32,
            decimals in 0..=8,
        ) {
            let print = |count: &i32| {
                let digits = i64::from(*count) * i64::from(times);
                format!("{digits}e-{decimals}").parse::<f64>().unwrap()
            };
            let values: Vec<f64> = counts.iter().map(print).collect();
            prop_assume!(values.iter().any(|&x| x != 0.0));
            let digits = grid(&values, 16);
            // At most 8000 steps, or fewer if the values have a larger step in common.
            let digits = digits.unwrap();
            let mut out = vec![0.0; 2 * ROWS];
            prop_assert!(digits.cut(&values, &mut out));
            for (row, &value) in values.iter().enumerate() {
                let (low, high) = (out[row], out[ROWS + row]);
                for digit in [low, high] {
                    prop_assert!(digit == digit.round() && digit.abs() <= 32768.0);
                }
                // In integers of the unit, which both sides are multiples of.
                let unit = power_of_two(-digits.unit());
                let sum = digits.join([low as i128, high as i128].into_iter());
                prop_assert_eq!(&sum, &BigInt::from((value * unit) as i128));
            }
        }
    }
}
