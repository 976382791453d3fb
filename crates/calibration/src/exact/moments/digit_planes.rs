//! Integers of any length in digits of 72 bits, each of which can be moved to another origin alone.
//!
//! To move the origin of readings by less than 2¹⁶ multiplies sums of products of up to three
//! readings by less than `(1 + 2¹⁶)³`; so digits stay below 2¹²¹ and need no carry on the way.

use num_bigint::{BigInt, Sign};
use num_traits::ToPrimitive;

use super::layout::MomentLayout;
use super::rounding::{round, round_scaled, shifted};
use super::scaled_integers::join;
use crate::double_double::DoubleDouble;
use crate::exact::moments::rounding::power_of_two;

const WIDTH: u32 = 72;
const MASK: i128 = (1 << WIDTH) - 1;

/// Sums of one and the features with something else: for each digit, lowest first, those of all sums.
pub(crate) struct DigitPlanes(Vec<Vec<i128>>);

impl DigitPlanes {
    pub(crate) fn new(values: &[BigInt]) -> Self {
        let bits = values.iter().map(BigInt::bits).max().unwrap_or(0);
        let count = (bits / u64::from(WIDTH) + 1) as usize;
        let mut planes = vec![Vec::new(); count];
        for value in values {
            match (&mut planes[..], value.to_i128()) {
                ([only], Some(value)) => only.push(value),
                ([low, high], Some(value)) => {
                    low.push(value & MASK);
                    high.push(value >> WIDTH);
                }
                (planes, _) => push_digits(planes, value),
            }
        }
        Self(planes)
    }

    /// Moves the origin of every channel by `by`.
    pub(crate) fn move_origin(&mut self, layout: &MomentLayout, by: &[i64]) {
        for plane in &mut self.0 {
            layout.move_origin_of_features(plane, by);
        }
    }

    /// The sum at that position.
    pub(crate) fn value(&self, position: usize) -> BigInt {
        join(self.0.iter().map(|plane| plane[position]), WIDTH)
    }

    /// The same times `2^exponent`, rounded to about 30 digits.
    pub(crate) fn rounded(&self, position: usize, exponent: i32) -> DoubleDouble {
        match &self.0[..] {
            [only] => shifted(round(only[position]), exponent),
            [low, high] => {
                // So that they do not cancel.
                let high = high[position] + (low[position] >> WIDTH);
                let high = round(high).scaled(power_of_two(WIDTH as i32));
                shifted(high + round(low[position] & MASK), exponent)
            }
            _ => round_scaled(&self.value(position), exponent),
        }
    }
}

/// The digits of a number, each with its sign.
fn push_digits(planes: &mut [Vec<i128>], value: &BigInt) {
    let mut rest = value.magnitude().clone();
    for plane in planes {
        let digit = (&rest & &(MASK as u128).into()).to_i128().expect("72 bits");
        plane.push(if value.sign() == Sign::Minus { -digit } else { digit });
        rest >>= WIDTH;
    }
}

#[cfg(test)]
mod tests {
    use num_traits::{One, Zero};
    use proptest::prelude::*;

    use super::*;
    use crate::model::Basis;

    proptest! {
        #[test]
        fn sums_move_as_if_each_were_one_integer(
            bits in 1_u32..400,
            seeds in prop::collection::vec(any::<i64>(), 20),
            by in prop::collection::vec(-65_535_i64..=65_535, 3),
        ) {
            // Poly3 of three channels: one and 19 features.
            let layout = MomentLayout::new(Basis::Poly3, 3);
            let values: Vec<BigInt> = (seeds.iter())
                .map(|&seed| BigInt::from(seed).pow(7) % (BigInt::one() << bits))
                .collect();
            let mut planes = DigitPlanes::new(&values);
            planes.move_origin(&layout, &by);
            // In one plane of integers modulo 2¹²⁸, and again of their quotients: by a prime, so that
            // no position of a digit is one there.
            let mut rest = values.clone();
            let mut expected = vec![BigInt::zero(); values.len()];
            let mut weight = BigInt::one();
            while rest.iter().any(|value| !value.is_zero()) {
                let base = BigInt::from(1_000_003);
                let mut digits: Vec<i128> =
                    rest.iter().map(|value| (value % &base).to_i128().unwrap()).collect();
                rest.iter_mut().for_each(|value| *value /= &base);
                layout.move_origin_of_features(&mut digits, &by);
                for (sum, digit) in expected.iter_mut().zip(digits) {
                    *sum += &weight * digit;
                }
                weight *= base;
            }
            for (position, expected) in expected.iter().enumerate() {
                prop_assert_eq!(&planes.value(position), expected);
                // Two roundings to 106 bits, and that of their sum.
                let error = planes.rounded(position, -200) - round_scaled(expected, -200);
                let size = planes.rounded(position, -200).abs().to_f64();
                prop_assert!(error.abs().to_f64() <= size * power_of_two(-100));
            }
        }
    }
}
