//! Numbers of 106 bits, as unevaluated sums of two doubles (Dekker, Numer. Math. 18, 224, 1971).

use std::ops::{Add, Div, Mul, Sub};

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Wide(f64, f64);

impl From<f64> for Wide {
    fn from(value: f64) -> Self {
        Self(value, 0.0)
    }
}

impl From<Wide> for f64 {
    fn from(value: Wide) -> Self {
        value.0
    }
}

impl Wide {
    pub(crate) fn min(self, other: Self) -> Self {
        if f64::from(self - other) <= 0.0 { self } else { other }
    }
}

fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let of_b = sum - a;
    (sum, (a - (sum - of_b)) + (b - of_b))
}

/// Needs `|a| ≥ |b|`.
fn quick_two_sum(a: f64, b: f64) -> Wide {
    let sum = a + b;
    Wide(sum, b - (sum - a))
}

fn split(a: f64) -> (f64, f64) {
    let scaled = 134_217_729.0 * a;
    let high = scaled - (scaled - a);
    (high, a - high)
}

fn two_product(a: f64, b: f64) -> (f64, f64) {
    let product = a * b;
    let ((ah, al), (bh, bl)) = (split(a), split(b));
    (product, ((ah * bh - product) + ah * bl + al * bh) + al * bl)
}

impl Add for Wide {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        let (high, low) = two_sum(self.0, other.0);
        let (carry, rest) = two_sum(self.1, other.1);
        let Self(high, low) = quick_two_sum(high, low + carry);
        quick_two_sum(high, low + rest)
    }
}

impl Sub for Wide {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        self + Self(-other.0, -other.1)
    }
}

impl Mul for Wide {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        let (high, low) = two_product(self.0, other.0);
        quick_two_sum(high, low + (self.0 * other.1 + self.1 * other.0))
    }
}

impl Div for Wide {
    type Output = Self;

    fn div(self, other: Self) -> Self {
        let first = self.0 / other.0;
        let rest = self - other * Self(first, 0.0);
        let second = rest.0 / other.0;
        let rest = rest - other * Self(second, 0.0);
        quick_two_sum(first, second) + Self(rest.0 / other.0, 0.0)
    }
}
