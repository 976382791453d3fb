//! The path of the tip of a bending beam, as functions of `z`.

use core::f64::consts::FRAC_PI_2;

use libm::{acos, cos, sin};

/// Number of Chebyshev terms: twice as many change the means of the paper's channels by a relative 10⁻⁶,
/// extremes by 10⁻⁴.
pub(crate) const TERMS: usize = 32;

/// The path of a clamped beam's tip along the body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bending {
    /// As in `Path::landmarks`: where the travel falls, otherwise 0; before its maximum; the table's end.
    pub(crate) landmarks: [f64; 3],
    /// Forward reach of the tip over `z`, in m.
    pub(crate) reach: Series,
    /// Factor of normal and tangent over `z`, in units of `EI/L²`; normal and tangent have the length of
    /// those in a [`Contact`](crate::Contact).
    pub(crate) push: Series,
    /// True if the beam's face comes to lie against the body; this model only has contact at the tip.
    pub(crate) lies_against_body: bool,
}

/// A function given by its values at Chebyshev nodes, as a series.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Series {
    length: f64,
    coefficients: [f64; TERMS],
}

/// Returns Chebyshev node `i` on [0, 1].
pub(crate) fn node(i: usize) -> f64 {
    let root = sin(FRAC_PI_2 * (i as f64 + 0.5) / TERMS as f64);
    root * root
}

impl Series {
    pub(crate) fn through(values: &[f64; TERMS], length: f64) -> Self {
        let coefficients = core::array::from_fn(|term| {
            let at = |i: usize| cos(term as f64 * acos(2.0 * node(i) - 1.0));
            let sum: f64 = values.iter().enumerate().map(|(i, value)| value * at(i)).sum();
            sum * if term == 0 { 1.0 } else { 2.0 } / TERMS as f64
        });
        Self { length, coefficients }
    }

    /// Evaluates value and slope by Clenshaw's recurrence.
    #[inline]
    pub(crate) fn at(&self, place: f64) -> (f64, f64) {
        let t = 2.0 * place / self.length - 1.0;
        let ([mut b, mut before], [mut slope, mut slope_before]) = ([0.0; 2], [0.0; 2]);
        for &coefficient in self.coefficients[1..].iter().rev() {
            (slope, slope_before) = (2.0 * (b + t * slope) - slope_before, slope);
            (b, before) = (coefficient + 2.0 * t * b - before, b);
        }
        let value = self.coefficients[0] + t * b - before;
        (value, 2.0 * (b + t * slope - slope_before) / self.length)
    }
}
