use num_bigint::{BigInt, Sign};
use num_traits::{Float, ToPrimitive, Zero};

use crate::double_double::DoubleDouble;

/// Integers times a power of two, in lowest terms: one or more is odd, or all are zero and the exponent is 0.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ScaledIntegers {
    pub(crate) exponent: i32,
    pub(crate) values: Vec<BigInt>,
}

impl ScaledIntegers {
    pub(crate) fn zero(len: usize) -> Self {
        Self { exponent: 0, values: vec![BigInt::zero(); len] }
    }

    pub(crate) fn new(exponent: i32, values: Vec<BigInt>) -> Self {
        let mut scaled = Self { exponent, values };
        scaled.reduce();
        scaled
    }

    pub(crate) fn reduce(&mut self) {
        match self.values.iter().filter_map(BigInt::trailing_zeros).min() {
            Some(0) => {}
            Some(zeros) => {
                self.values.iter_mut().for_each(|v| *v >>= zeros);
                self.exponent += i32::try_from(zeros).expect("exponents of f64 are small");
            }
            None => self.exponent = 0,
        }
    }

    fn is_zero(&self) -> bool {
        self.values.iter().all(BigInt::is_zero)
    }

    pub(crate) fn add(&mut self, other: &Self) {
        if other.is_zero() {
            return;
        }
        if self.is_zero() {
            self.clone_from(other);
            return;
        }
        let exponent = self.exponent.min(other.exponent);
        let (own, others) = (self.exponent - exponent, other.exponent - exponent);
        for (value, other) in self.values.iter_mut().zip(&other.values) {
            // A shift by zero would only copy.
            if own > 0 {
                *value <<= own;
            }
            match others {
                0 => *value += other,
                _ => *value += other << others,
            }
        }
        self.exponent = exponent;
        self.reduce();
    }
}

pub(crate) const DIGIT_BITS: u32 = 32;

/// Splits integers into digits that carry the integer's sign: one vector per digit, lowest first.
pub(crate) fn digit_planes(values: &[BigInt]) -> Vec<Vec<i128>> {
    let digits = |value: &BigInt| value.bits().div_ceil(DIGIT_BITS.into()) as usize;
    let count = values.iter().map(digits).max().unwrap_or(0);
    let mut planes = vec![vec![0; values.len()]; count];
    for (position, value) in values.iter().enumerate() {
        let sign = if value.sign() == Sign::Minus { -1 } else { 1 };
        for (plane, digit) in planes.iter_mut().zip(value.iter_u32_digits()) {
            plane[position] = sign * i128::from(digit);
        }
    }
    planes
}

pub(crate) struct DigitPlanes(pub(crate) Vec<Vec<i128>>);

impl DigitPlanes {
    fn digits(&self, position: usize) -> impl DoubleEndedIterator<Item = i128> + Clone {
        self.0.iter().map(move |plane| plane[position])
    }

    pub(crate) fn value(&self, position: usize) -> BigInt {
        join(self.digits(position), DIGIT_BITS)
    }

    pub(crate) fn rounded(&self, position: usize, exponent: i32) -> DoubleDouble {
        match narrow(self.digits(position), DIGIT_BITS) {
            Some(value) if value.unsigned_abs() >> EXACT_BITS == 0 => {
                shifted(round(value), exponent)
            }
            _ => round_scaled(&self.value(position), exponent),
        }
    }
}

fn narrow(parts: impl DoubleEndedIterator<Item = i128>, width: u32) -> Option<i128> {
    parts
        .rev()
        .try_fold(0i128, |sum, part| sum.checked_mul(1i128.checked_shl(width)?)?.checked_add(part))
}

/// `Σ parts_i·2^(width·i)`.
pub(crate) fn join(parts: impl DoubleEndedIterator<Item = i128> + Clone, width: u32) -> BigInt {
    narrow(parts.clone(), width).map_or_else(
        || parts.rev().fold(BigInt::zero(), |sum, part| (sum << width) + part),
        BigInt::from,
    )
}

/// `2^exponent`, for the exponents of normal numbers.
#[inline(always)]
pub(crate) fn power_of_two(exponent: i32) -> f64 {
    debug_assert!((-1022..=1023).contains(&exponent));
    f64::from_bits(((exponent + 1023) as u64) << 52)
}

/// Rounds an integer below 2¹²⁶ to a double-double; exact up to 2¹⁰⁶.
#[inline(always)]
pub(crate) fn round(value: i128) -> DoubleDouble {
    /// Bits per digit. Digits, the highest with at most 47 bits, are exact in `f64`; head and tail hold two.
    const BITS: u32 = 40;
    const MASK: u64 = (1 << BITS) - 1;
    let low = (value as u64 & MASK) as i64;
    let middle = ((value >> BITS) as u64 & MASK) as i64;
    let high = (value >> (2 * BITS)) as i64;
    let (middle, high) =
        (middle as f64 * power_of_two(BITS as i32), high as f64 * power_of_two(2 * BITS as i32));
    DoubleDouble::from_sum(high, middle) + DoubleDouble::from(low as f64)
}

/// Maximum number of bits for which [`round`] is exact.
const EXACT_BITS: u64 = 106;

/// Rounds `value·2^exponent` to a double-double.
pub(crate) fn round_scaled(value: &BigInt, exponent: i32) -> DoubleDouble {
    if value.bits() <= EXACT_BITS {
        return shifted(round(value.to_i128().expect("fewer than 128 bits")), exponent);
    }
    /// Leading bits that affect the result.
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

/// Computes `value·2^exponent` in steps that stay within the range of `f64` unless the result leaves it.
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

/// Returns a finite number as an integer and the exponent of a power of two.
pub(crate) fn integer(value: f64) -> (BigInt, i32) {
    let (significand, exponent, sign) = value.integer_decode();
    (BigInt::from(significand) * sign, exponent.into())
}
