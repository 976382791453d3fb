//! From integers of any length to double-doubles, and back.

use num_bigint::BigInt;
use num_traits::{Float, ToPrimitive};

use crate::double_double::DoubleDouble;

/// `2^exponent` for the exponents of normal numbers.
#[inline(always)]
pub(crate) fn power_of_two(exponent: i32) -> f64 {
    debug_assert!((-1022..=1023).contains(&exponent));
    f64::from_bits(((exponent + 1023) as u64) << 52)
}

/// A double-double of an integer below 2¹²⁶: the integer itself up to 2¹⁰⁶.
#[inline(always)]
pub(crate) fn round(value: i128) -> DoubleDouble {
    /// Digits of so many bits, the highest of at most 47, are exact in `f64`, and so are sums of two
    /// neighbours in a head and a tail.
    const BITS: u32 = 40;
    const MASK: u64 = (1 << BITS) - 1;
    let low = (value as u64 & MASK) as i64;
    let middle = ((value >> BITS) as u64 & MASK) as i64;
    let high = (value >> (2 * BITS)) as i64;
    let (middle, high) =
        (middle as f64 * power_of_two(BITS as i32), high as f64 * power_of_two(2 * BITS as i32));
    DoubleDouble::from_sum(high, middle) + DoubleDouble::from(low as f64)
}

/// [`round`] is exact up to here.
const EXACT_BITS: u64 = 106;

/// `value·2^exponent` as a double-double.
pub(crate) fn round_scaled(value: &BigInt, exponent: i32) -> DoubleDouble {
    if value.bits() <= EXACT_BITS {
        return shifted(round(value.to_i128().expect("fewer than 128 bits")), exponent);
    }
    /// More bits than these do not matter.
    const BITS: u64 = 240;
    let cut = value.bits().saturating_sub(BITS);
    let (value, exponent) = match cut {
        0 => (value.clone(), exponent),
        _ => (value >> cut, exponent + cut as i32),
    };
    let to_f64 = |x: &BigInt| x.to_f64().unwrap_or(0.0);
    let head = to_f64(&value);
    let (significand, up) = integer(head);
    let rest = value - if up >= 0 { significand << up } else { significand >> -up };
    shifted(DoubleDouble::from_sum(head, to_f64(&rest)), exponent)
}

/// `value·2^exponent`, in steps that do not leave the range of `f64` unless the result does.
pub(crate) fn shifted(value: DoubleDouble, exponent: i32) -> DoubleDouble {
    const STEP: i32 = 1000;
    let (mut value, mut exponent) = (value, exponent);
    while exponent.abs() > STEP {
        let step = STEP * exponent.signum();
        value = value.scaled(power_of_two(step));
        exponent -= step;
    }
    value.scaled(power_of_two(exponent))
}

/// A finite number as an integer times a power of two.
pub(crate) fn integer(value: f64) -> (BigInt, i32) {
    let (significand, exponent, sign) = value.integer_decode();
    (BigInt::from(significand) * sign, exponent.into())
}
