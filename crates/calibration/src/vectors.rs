//! Inner products and multiples of columns, compiled for the widest vectors that the machine has.
//!
//! Each is a value with [`WithSimd`] and not a closure: a closure may stay a function of its own,
//! which then knows nothing of wide vectors, and calls the library for every fused multiply-add.

use pulp::{Simd, WithSimd};
use shell_data::instructions::arch;

/// Sums carried side by side: enough to hide how long one addition takes.
const LANES: usize = 16;

/// `xᵀy`, of equal lengths.
pub(super) fn dot(x: &[f64], y: &[f64]) -> f64 {
    arch().dispatch(Dot { x, y })
}

/// `y += c·x`, of equal lengths.
pub(super) fn add_multiple(y: &mut [f64], c: f64, x: &[f64]) {
    arch().dispatch(AddMultiple { y, c, x });
}

struct Dot<'a> {
    x: &'a [f64],
    y: &'a [f64],
}

impl WithSimd for Dot<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let mut sums = [0.0; LANES];
        let ((x, x_rest), (y, y_rest)) = (self.x.as_chunks(), self.y.as_chunks());
        for (x, y) in x.iter().zip(y) {
            let (x, y): (&[f64; LANES], &[f64; LANES]) = (x, y);
            for lane in 0..LANES {
                sums[lane] = x[lane].mul_add(y[lane], sums[lane]);
            }
        }
        let rest: f64 = x_rest.iter().zip(y_rest).map(|(x, y)| x * y).sum();
        sums.iter().sum::<f64>() + rest
    }
}

struct AddMultiple<'a> {
    y: &'a mut [f64],
    c: f64,
    x: &'a [f64],
}

impl WithSimd for AddMultiple<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for (y, &x) in self.y.iter_mut().zip(self.x) {
            *y = self.c.mul_add(x, *y);
        }
    }
}
