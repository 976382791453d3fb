//! Integers of any length times a common power of two.

use num_bigint::BigInt;
use num_traits::Zero;

/// Integers times a power of two, in lowest terms: not all of them even, exponent 0 if all zero.
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
            // A shift by zero is a copy.
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

/// `Σ parts_i·2^(width·i)`.
pub(crate) fn join(parts: impl DoubleEndedIterator<Item = i128> + Clone, width: u32) -> BigInt {
    let narrow = parts
        .clone()
        .rev()
        .try_fold(0i128, |sum, part| sum.checked_mul(1i128.checked_shl(width)?)?.checked_add(part));
    narrow.map_or_else(
        || parts.rev().fold(BigInt::zero(), |sum, part| (sum << width) + part),
        BigInt::from,
    )
}
