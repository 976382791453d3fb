//! Sums of products with long integers, in 128-bit arithmetic.
//!
//! The multipliers are cut into digits of 32 bits and what they are multiplied with into halves of 64
//! bits. A product is below 2⁹⁶ in magnitude, so 2³¹ of them can be added up without a carry.

use num_bigint::{BigInt, Sign};

use crate::exact::moments::scaled_integers::join;
use shell_data::wrench::PerAxis;

const WIDTH: u32 = 32;

/// Six columns of integers of any length.
pub(crate) struct Multipliers {
    /// How many digits those of each axis have.
    counts: PerAxis<usize>,
    /// AxisRow by row, axis by axis the digits with their sign, lowest first.
    digits: Vec<i64>,
}

/// The sums of products of one digit with the lower and the upper halves.
#[derive(Clone, Copy, Default)]
struct Halves {
    low: i128,
    high: i128,
}

impl Multipliers {
    /// Of six columns of the same length.
    pub(crate) fn new(columns: &PerAxis<Vec<BigInt>>) -> Self {
        let counts = columns.each_ref().map(|column| {
            let bits = column.iter().map(BigInt::bits).max().unwrap_or(0);
            bits.div_ceil(u64::from(WIDTH)) as usize
        });
        let rows = columns[0].len();
        let mut digits = Vec::with_capacity(rows * counts.iter().sum::<usize>());
        for row in 0..rows {
            for (column, &count) in columns.iter().zip(&counts) {
                let sign = if column[row].sign() == Sign::Minus { -1 } else { 1 };
                let own = column[row].iter_u32_digits().map(|digit| sign * i64::from(digit));
                digits.extend(own.chain(std::iter::repeat(0)).take(count));
            }
        }
        Self { counts, digits }
    }

    /// For each axis the sum of products with `integers`, row by row.
    pub(crate) fn sums_with(&self, integers: impl Iterator<Item = i128>) -> PerAxis<BigInt> {
        let all: usize = self.counts.iter().sum();
        let mut sums = vec![Halves::default(); all];
        for (integer, digits) in integers.zip(self.digits.chunks_exact(all.max(1))) {
            let (low, high) = (i128::from(integer as u64), integer >> 64);
            for (sums, &digit) in sums.iter_mut().zip(digits) {
                sums.low += low * i128::from(digit);
                sums.high += high * i128::from(digit);
            }
        }
        let mut sums = &sums[..];
        self.counts.map(|count| {
            let own = sums.split_off(..count).expect("as many as there are digits");
            let low = join(own.iter().map(|sum| sum.low), WIDTH);
            let high = join(own.iter().map(|sum| sum.high), WIDTH);
            low + (high << 64)
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn sums_are_those_of_long_arithmetic(
            seeds in prop::collection::vec((any::<i128>(), any::<[i64; 6]>(), 0_u32..9), 0..20),
            cut in 0_u32..127,
        ) {
            let column = |axis: usize| -> Vec<BigInt> {
                let power = |(_, seeds, power): &(i128, [i64; 6], u32)| {
                    // Some axes of short integers, some of zeros.
                    BigInt::from(seeds[axis] % [i64::MAX, 1000, 1][axis % 3]).pow(*power)
                        * seeds[axis].signum() * (axis as i64 % 3 - 2).signum()
                };
                seeds.iter().map(power).collect()
            };
            let columns: PerAxis<Vec<BigInt>> = std::array::from_fn(column);
            let integers = || seeds.iter().map(|(integer, ..)| integer >> cut);
            let found = Multipliers::new(&columns).sums_with(integers());
            for (found, column) in found.iter().zip(&columns) {
                let expected: BigInt = column.iter().zip(integers()).map(|(a, b)| a * b).sum();
                prop_assert_eq!(found, &expected);
            }
        }
    }
}
