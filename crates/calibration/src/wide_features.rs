//! Features in double-double, for readings whose products do not fit an `f64`.
//!
//! Integer readings of up to 16 bits have features that are exact as they are. Readings in volts,
//! or with decimals, do not: what rounding would change is kept in tails.

use std::ops::Range;

use super::features::{Features, Recipe};
use crate::double_double::{two_product, two_sum};
use shell_data::vectorised;

impl Features {
    /// Fills features and what rounding leaves out of them, laid out as by [`Features::fill`].
    /// Returns whether anything was left out.
    pub(super) fn fill_wide(
        &self,
        readings: &[Vec<f64>],
        rows: Range<usize>,
        heads: &mut [f64],
        tails: &mut [f64],
        stride: usize,
    ) -> bool {
        let n = rows.len();
        let mut is_rounded = false;
        for (j, recipe) in self.recipe().iter().enumerate() {
            let (heads_before, head) = heads.split_at_mut(j * stride);
            let (tails_before, tail) = tails.split_at_mut(j * stride);
            let (head, tail) = (&mut head[..n], &mut tail[..n]);
            match *recipe {
                Recipe::One => {
                    head.fill(1.0);
                    tail.fill(0.0);
                }
                Recipe::Reading(channel) => {
                    let (centre, factor) = self.standardise(channel);
                    let readings = &readings[channel][rows.clone()];
                    for ((z, rest), &s) in head.iter_mut().zip(tail.iter_mut()).zip(readings) {
                        let (difference, lost) = two_sum(s, -centre);
                        (*z, *rest) = (difference * factor, lost * factor);
                    }
                }
                Recipe::Product(a, b) => {
                    let of = |j: usize| {
                        (&heads_before[j * stride..][..n], &tails_before[j * stride..][..n])
                    };
                    let (x, y) = (of(a), of(b));
                    fill_product(x, y, head, tail);
                }
            }
            is_rounded |= tail.iter().any(|&rest| rest != 0.0);
        }
        is_rounded
    }
}

vectorised! {
    /// Products of two columns, each of heads and tails.
    fn fill_product(
        x: (&[f64], &[f64]),
        y: (&[f64], &[f64]),
        head: &mut [f64],
        tail: &mut [f64],
    ) {
        let ((x, u), (y, v)) = (x, y);
        let operands = x.iter().zip(u).zip(y.iter().zip(v));
        for ((head, tail), ((&x, &u), (&y, &v))) in head.iter_mut().zip(tail).zip(operands) {
            let (product, error) = two_product(x, y);
            let rest = error + x.mul_add(v, u * y);
            *head = product + rest;
            *tail = rest - (*head - product);
        }
    }
}

#[cfg(test)]
mod tests {
    use num_rational::BigRational;

    use super::super::model::{Basis, Model};
    use super::super::scaling::Scaling;
    use super::*;

    #[test]
    fn features_of_readings_in_volts_have_twice_the_digits() {
        let readings = [vec![2.501_234, 2.7, 0.1], vec![1.0 / 3.0, 0.123, 7.77]];
        let scaling = Scaling { centre: vec![2.625, 1.0 / 7.0], scale: vec![0.25, 8.0] };
        let model = Model { basis: Basis::Poly3, intercept: true, channels: 2, memory: 0 };
        let features = Features::new(model, scaling.clone());
        let (n, p) = (3, features.len());
        let (mut heads, mut tails) = (vec![0.0; n * p], vec![0.0; n * p]);
        assert!(features.fill_wide(&readings, 0..n, &mut heads, &mut tails, n));
        let exact = |value| BigRational::from_float(value).unwrap();
        for (j, term) in model.terms().iter().enumerate() {
            for row in 0..n {
                let z = term.factors().iter().map(|&c| {
                    let c = usize::from(c);
                    (exact(readings[c][row]) - exact(scaling.centre[c])) / exact(scaling.scale[c])
                });
                let truth: BigRational = z.product();
                let error = exact(heads[j * n + row]) + exact(tails[j * n + row]) - &truth;
                // Two products, 2⁻¹⁰³ each.
                assert!(error.clone() * error <= &truth * &truth * exact(2f64.powi(-204)));
            }
        }
    }

    #[test]
    fn features_of_integer_readings_leave_nothing_out() {
        let readings = [vec![4095.0, 0.0, 1234.0], vec![1.0, 65535.0, 17.0]];
        let scaling = Scaling::from_sample(&readings, true);
        let model = Model { basis: Basis::Poly3, intercept: true, channels: 2, memory: 0 };
        let features = Features::new(model, scaling);
        let p = features.len();
        let (mut heads, mut tails) = (vec![0.0; 3 * p], vec![f64::NAN; 3 * p]);
        assert!(!features.fill_wide(&readings, 0..3, &mut heads, &mut tails, 3));
        assert!(tails.iter().all(|&tail| tail == 0.0));
    }
}
