//! The path of the contact of a bending beam, as functions of `z`.

use core::f64::consts::FRAC_PI_2;

use libm::{acos, cos, sin};

/// Number of Chebyshev terms. Twice as many change means by a relative 10⁻⁶, and extremes by 10⁻⁴.
pub(crate) const TERMS: usize = 32;

/// Largest number of pieces: contact by tip, by face, and again by tip.
pub(crate) const PIECES: usize = 3;

/// The path of a clamped beam's contact along the body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bending {
    /// Values of `z` as in `Path::landmarks`: where the travel falls, or 0; before its maximum; at the table's end.
    pub(crate) landmarks: [f64; 3],
    /// In the order of `z`; the last one may be repeated.
    pub(crate) pieces: [Piece; PIECES],
    /// True if the beam's face comes to lie against the body, but only the tip is modelled.
    pub(crate) lies_against_body: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Piece {
    pub(crate) end: f64,
    pub(crate) reach: Series,
    /// Force over `z`, in `EI/L²`, per length of normal and tangent in a [`Contact`](crate::Contact).
    pub(crate) push: Series,
}

impl Bending {
    #[inline]
    pub(crate) fn piece(&self, z: f64) -> &Piece {
        self.pieces.iter().find(|piece| z <= piece.end).unwrap_or(&self.pieces[PIECES - 1])
    }

    /// Returns `z` where contact changes between tip and face.
    pub(crate) fn changes(&self) -> [f64; PIECES - 1] {
        core::array::from_fn(|i| self.pieces[i].end)
    }
}

/// A function as a Chebyshev series.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Series {
    start: f64,
    length: f64,
    coefficients: [f64; TERMS],
}

/// Returns Chebyshev node `i` on [0, 1].
pub(crate) fn node(i: usize) -> f64 {
    let root = sin(FRAC_PI_2 * (i as f64 + 0.5) / TERMS as f64);
    root * root
}

impl Series {
    pub(crate) fn through(values: &[f64; TERMS], [start, end]: [f64; 2]) -> Self {
        let coefficients = core::array::from_fn(|term| {
            let at = |i: usize| cos(term as f64 * acos(2.0 * node(i) - 1.0));
            let sum: f64 = values.iter().enumerate().map(|(i, value)| value * at(i)).sum();
            sum * if term == 0 { 1.0 } else { 2.0 } / TERMS as f64
        });
        Self { start, length: end - start, coefficients }
    }

    /// Evaluates value and slope by Clenshaw's recurrence.
    #[inline]
    pub(crate) fn at(&self, place: f64) -> (f64, f64) {
        let t = 2.0 * (place - self.start) / self.length - 1.0;
        let ([mut b, mut before], [mut slope, mut slope_before]) = ([0.0; 2], [0.0; 2]);
        for &coefficient in self.coefficients[1..].iter().rev() {
            (slope, slope_before) = (2.0 * (b + t * slope) - slope_before, slope);
            (b, before) = (coefficient + 2.0 * t * b - before, b);
        }
        let value = self.coefficients[0] + t * b - before;
        (value, 2.0 * (b + t * slope - slope_before) / self.length)
    }
}
