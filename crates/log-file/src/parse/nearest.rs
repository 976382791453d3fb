//! The double nearest to an integer of up to 64 bits times a power of ten.
//!
//! A product with the first 128 bits of the power of five rounds correctly in all cases but ties, which are possible
//! only if the product is exact (D. Lemire, "Number parsing at a gigabyte per second", Software: Practice and
//! Experience 51, 2021; N. Mushtak and D. Lemire, "Fast number parsing without fallback", ibid. 53, 2023).

/// The powers of ten that recordings need: 19 digits, with as many zeros before and after them.
const EXPONENTS: std::ops::RangeInclusive<i32> = -LARGEST..=LARGEST;
const LARGEST: i32 = 55;

/// Returns `mantissa · 10^exponent`, correctly rounded; `None` for powers that no recording needs.
#[inline(always)]
pub(crate) fn nearest(mantissa: u64, exponent: i32) -> Option<f64> {
    /// The bits of a product after the bits of the double, the rounding bit and a possible leading zero.
    const BEHIND: u64 = u64::MAX >> 55;
    if mantissa == 0 || !EXPONENTS.contains(&exponent) {
        return (mantissa == 0).then_some(0.0);
    }
    let zeros = mantissa.leading_zeros();
    let mantissa = mantissa << zeros;
    let power = POWERS_OF_FIVE[(exponent + LARGEST) as usize];
    let (power, more) = ((power >> 64) as u64, power as u64);
    let mut product = u128::from(mantissa) * u128::from(power);
    if (product >> 64) as u64 & BEHIND == BEHIND {
        // The lower part of the product may carry into the bits that are kept.
        product += (u128::from(mantissa) * u128::from(more)) >> 64;
    }
    let (high, low) = ((product >> 64) as u64, product as u64);
    let first = (high >> 63) as u32;
    let mut bits = high >> (9 + first);
    // Ties round to even. They need a power of five that divides a mantissa or is shorter than 64 bits.
    let is_tie =
        low <= 1 && (-4..=23).contains(&exponent) && bits & 3 == 1 && bits << (9 + first) == high;
    bits &= !u64::from(is_tie);
    bits = (bits + (bits & 1)) >> 1;
    // ⌊log₂ 10^exponent⌋. The result is never too small or too large for a double.
    let twos = (exponent * 217_706) >> 16;
    let power_of_two = (twos + 63 + 1023 - zeros as i32 + first as i32) as u64;
    // A mantissa that is rounded up to the next power of two carries into the exponent.
    Some(f64::from_bits(((power_of_two - 1) << 52) + bits))
}

/// The first 128 bits of the powers of five, rounded down; reciprocals of those below 2⁶⁴ are rounded up.
static POWERS_OF_FIVE: [u128; 2 * LARGEST as usize + 1] = {
    let middle = LARGEST as usize;
    let mut powers = [0; 2 * LARGEST as usize + 1];
    let mut power: u128 = 1;
    let mut i = 0;
    while i <= middle {
        powers[middle + i] = power << power.leading_zeros();
        if i < middle {
            power *= 5;
        }
        i += 1;
    }
    // Divides 2³²⁰ repeatedly by five, beginning with the highest word.
    let mut quotient = [1_u64, 0, 0, 0, 0, 0];
    let mut i = 1;
    while i <= middle {
        let (mut word, mut remainder) = (0, 0);
        while word < quotient.len() {
            let dividend = (remainder as u128) << 64 | quotient[word] as u128;
            quotient[word] = (dividend / 5) as u64;
            remainder = (dividend % 5) as u64;
            word += 1;
        }
        let first = first_128_bits(&quotient);
        powers[middle - i] = if i <= 27 { first + 1 } else { first };
        i += 1;
    }
    powers
};

const fn first_128_bits(words: &[u64; 6]) -> u128 {
    let mut first = 0;
    while words[first] == 0 {
        first += 1;
    }
    let zeros = words[first].leading_zeros();
    let high = (words[first] as u128) << 64 | words[first + 1] as u128;
    match zeros {
        0 => high,
        _ => high << zeros | (words[first + 2] >> (64 - zeros)) as u128,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn assert_as_std(mantissa: u64, exponent: i32) {
        let expected: f64 = format!("{mantissa}e{exponent}").parse().unwrap();
        let found = nearest(mantissa, exponent).map(f64::to_bits);
        assert_eq!(found, Some(expected.to_bits()), "{mantissa}e{exponent}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(100_000))]

        #[test]
        fn any_mantissa_rounds_as_in_the_standard_library(
            mantissa in any::<u64>(),
            shift in 0_u32..64,
            exponent in EXPONENTS,
        ) {
            assert_as_std(mantissa >> shift, exponent);
        }

        /// Numbers halfway between two doubles, and their neighbours: 2⁵³ + 1 times powers of two and
        /// five that fit 64 bits.
        #[test]
        fn halfway_cases_round_to_even(
            odd in (1_u64 << 52..1 << 53).prop_map(|bits| 2 * bits + 1),
            shift in 0_u32..11,
            exponent in -4_i32..=23,
            step in -1_i64..=1,
        ) {
            assert_as_std((odd << shift).wrapping_add_signed(step), 0);
            let fives = 5_u64.pow(exponent.unsigned_abs().min(4));
            if let Some(product) = odd.checked_mul(fives) {
                assert_as_std(product.wrapping_add_signed(step), -(exponent.min(4)));
            }
            assert_as_std((odd >> 30 | 1).wrapping_add_signed(step), exponent);
        }
    }

    #[test]
    fn bounds_of_mantissa_and_exponent_round_as_in_the_standard_library() {
        for exponent in EXPONENTS {
            for shift in 0..64 {
                for step in -1..=1 {
                    assert_as_std((1_u64 << shift).wrapping_add_signed(step), exponent);
                }
            }
            assert_as_std(u64::MAX, exponent);
            assert_as_std(9_999_999_999_999_999_999, exponent);
        }
        assert_eq!(nearest(1, -LARGEST - 1), None);
        assert_eq!(nearest(1, LARGEST + 1), None);
        assert_eq!(nearest(0, 400), Some(0.0));
    }
}
