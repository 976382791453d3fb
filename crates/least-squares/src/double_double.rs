//! Numbers as unevaluated sums of a head and a tail: about 31 decimal digits, the exponent range of `f64`.
//!
//! The error-free transformations are by Knuth (TAOCP 2, §4.2.2) and Dekker (Numer. Math. 18, 1971). The
//! operations are the accurate ones of Joldes, Muller and Popescu (ACM TOMS 44, 2017), with a relative error below
//! 2⁻¹⁰² for sums and 2⁻¹⁰⁰ for products and quotients. Products use `f64::mul_add`, which is exact on every machine.

use std::iter::Sum;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// A head and a tail, `|tail| ≤ ulp(head) / 2`.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
pub struct DoubleDouble {
    head: f64,
    tail: f64,
}

/// Returns `a + b` and its rounding error, exactly.
#[inline(always)]
pub fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let b_part = sum - a;
    (sum, (a - (sum - b_part)) + (b - b_part))
}

/// Returns `a·b` and its rounding error, exactly unless the error underflows.
#[inline(always)]
pub fn two_product(a: f64, b: f64) -> (f64, f64) {
    let product = a * b;
    (product, a.mul_add(b, -product))
}

/// Like [`two_sum`], for `|a| ≥ |b|` or `a = 0`.
#[inline(always)]
fn fast_two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    (sum, b - (sum - a))
}

impl DoubleDouble {
    pub const ZERO: Self = Self { head: 0.0, tail: 0.0 };
    pub const ONE: Self = Self { head: 1.0, tail: 0.0 };

    #[inline(always)]
    pub fn from_sum(a: f64, b: f64) -> Self {
        let (head, tail) = two_sum(a, b);
        Self { head, tail }
    }

    #[inline(always)]
    pub fn from_product(a: f64, b: f64) -> Self {
        let (head, tail) = two_product(a, b);
        Self { head, tail }
    }

    /// Builds a number from its head, [`Self::to_f64`], and its tail, [`Self::tail`].
    #[inline(always)]
    pub const fn from_parts(head: f64, tail: f64) -> Self {
        Self { head, tail }
    }

    /// Multiplies by a power of two, exactly unless the result under- or overflows.
    #[inline(always)]
    pub const fn scaled(self, power_of_two: f64) -> Self {
        Self { head: self.head * power_of_two, tail: self.tail * power_of_two }
    }

    #[inline(always)]
    pub const fn to_f64(self) -> f64 {
        self.head
    }

    #[inline(always)]
    pub const fn tail(self) -> f64 {
        self.tail
    }

    pub fn is_finite(self) -> bool {
        self.head.is_finite() && self.tail.is_finite()
    }

    /// Square root, by a step of Newton's method (Karp's trick). NaN for a negative number.
    #[inline(always)]
    pub fn sqrt(self) -> Self {
        if self.head <= 0.0 {
            return Self::from(self.head.sqrt());
        }
        let root = self.head.sqrt();
        let remainder = self - Self::from_product(root, root);
        Self::from_sum(root, remainder.head / (2.0 * root))
    }
}

impl From<f64> for DoubleDouble {
    #[inline(always)]
    fn from(value: f64) -> Self {
        Self { head: value, tail: 0.0 }
    }
}

impl Neg for DoubleDouble {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self { head: -self.head, tail: -self.tail }
    }
}

impl Add for DoubleDouble {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        let (head, error) = two_sum(self.head, other.head);
        let (tail, tail_error) = two_sum(self.tail, other.tail);
        let (head, error) = fast_two_sum(head, error + tail);
        let (head, tail) = fast_two_sum(head, error + tail_error);
        Self { head, tail }
    }
}

impl Sub for DoubleDouble {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for DoubleDouble {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        let (head, error) = two_product(self.head, other.head);
        let cross = self.head.mul_add(other.tail, self.tail * other.head);
        let (head, tail) = fast_two_sum(head, error + cross);
        Self { head, tail }
    }
}

impl Div for DoubleDouble {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        let first = self.head / other.head;
        let remainder = self - other * Self::from(first);
        let second = remainder.head / other.head;
        let remainder = remainder - other * Self::from(second);
        let third = remainder.head / other.head;
        let (head, tail) = fast_two_sum(first, second);
        Self { head, tail } + Self::from(third)
    }
}

impl AddAssign for DoubleDouble {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl SubAssign for DoubleDouble {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl Sum for DoubleDouble {
    fn sum<I: Iterator<Item = Self>>(values: I) -> Self {
        values.fold(Self::ZERO, Add::add)
    }
}

#[cfg(test)]
mod tests {
    use num_bigint::BigInt;
    use num_rational::BigRational;
    use proptest::prelude::*;

    use super::*;

    impl DoubleDouble {
        pub fn abs(self) -> Self {
            if self.head < 0.0 { -self } else { self }
        }
    }

    fn exact(value: DoubleDouble) -> BigRational {
        let part = |x| BigRational::from_float(x).expect("a finite number");
        part(value.head) + part(value.tail)
    }

    /// `|value − truth| ≤ 2^−bits · |truth|`
    fn close(value: DoubleDouble, truth: &BigRational, bits: u32) -> bool {
        let error = exact(value) - truth;
        let bound = truth / BigRational::from_integer(BigInt::from(2).pow(bits));
        error.clone() * error <= bound.clone() * bound
    }

    fn number() -> impl Strategy<Value = DoubleDouble> {
        (-1e6..1e6_f64, -1.0..1.0_f64)
            .prop_map(|(head, tail)| DoubleDouble::from_sum(head, tail * head * 2f64.powi(-54)))
    }

    proptest! {
        // Bounds proved in the paper: 3u² + 13u³ for the sum, 5u² for the product (u = 2⁻⁵³), twice
        // that for quotient and root.
        #[test]
        fn operations_agree_with_exact_rational_arithmetic(a in number(), b in number()) {
            prop_assert!(close(a + b, &(exact(a) + exact(b)), 102));
            prop_assert!(close(a - b, &(exact(a) - exact(b)), 102));
            prop_assert!(close(a * b, &(exact(a) * exact(b)), 103));
            prop_assume!(b.head != 0.0);
            prop_assert!(close(a / b, &(exact(a) / exact(b)), 101));
        }

        #[test]
        fn the_square_of_the_root_is_the_number(a in number()) {
            let root = a.abs().sqrt();
            prop_assert!(close(root, &(exact(a.abs()) / exact(root)), 100));
        }
    }

    #[test]
    fn the_root_of_zero_is_zero_and_of_negative_numbers_nan() {
        assert_eq!(DoubleDouble::ZERO.sqrt(), DoubleDouble::ZERO);
        assert!(DoubleDouble::from(-1.0).sqrt().to_f64().is_nan());
    }
}
