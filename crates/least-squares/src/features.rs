//! Features of readings: the columns of the design matrix. Every feature of degree two or three is the product of two
//! earlier ones. Features of integer readings of up to 16 bits are exact in `f64`; others are in double-double where
//! that matters, with the rounding errors as tails.

use std::ops::Range;

use crate::double_double::{two_product, two_sum};
use crate::model::{Model, Term};
use crate::scaling::Scaling;
use shell_data::vectorised;

/// Features of a model, in the order of its [terms](Model::terms), ready to evaluate.
#[derive(Clone, Debug, PartialEq)]
pub struct Features {
    pub model: Model,
    pub scaling: Scaling,
    recipe: Vec<Recipe>,
}

/// Rows evaluated together where features are used immediately.
pub const LANES: usize = 16;

/// One feature of [`LANES`] rows.
pub type RowLanes = [f64; LANES];

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Recipe {
    Reading(usize),
    Product(usize, usize),
    One,
}

impl Features {
    /// # Panics
    /// If the numbers of columns of `scaling` and `model` differ.
    pub fn new(model: Model, scaling: Scaling) -> Self {
        assert_eq!(model.columns(), scaling.centre.len(), "one scaling per column");
        let recipe = recipe(&model.terms());
        Self { model, scaling, recipe }
    }

    /// Number of features, including the intercept.
    pub fn len(&self) -> usize {
        self.recipe.len()
    }

    pub fn is_empty(&self) -> bool {
        self.recipe.is_empty()
    }

    pub(super) fn recipe(&self) -> &[Recipe] {
        &self.recipe
    }

    /// Fills `rows × len` dimensionless features: feature `j` goes to `columns[j·stride ..][..rows.len()]`.
    /// `readings` has one column per channel, in counts.
    ///
    /// # Panics
    /// If a reading column is shorter than `rows.end`, or `columns` is too short.
    pub fn fill(
        &self,
        readings: &[Vec<f64>],
        rows: Range<usize>,
        columns: &mut [f64],
        stride: usize,
    ) {
        fill(self, readings, rows, columns, stride);
    }

    /// Computes the features of the [`LANES`] rows from `start`. Beyond the last row, lanes stay unchanged.
    #[inline(always)]
    pub fn lanes(&self, readings: &[Vec<f64>], start: usize, features: &mut [RowLanes]) {
        let columns = features.as_flattened_mut();
        let reading = |channel: usize| {
            let (centre, factor) = self.standardise(channel);
            (&readings[channel][start..], centre, factor)
        };
        match readings.first().map_or(LANES, |column| column.len() - start) {
            LANES.. => fill_columns(&self.recipe, columns, LANES, |j| j * LANES, reading),
            rows => fill_columns(&self.recipe, columns, rows, |j| j * LANES, reading),
        }
    }

    /// Centre of a channel and reciprocal of its scale. For a power of two, the reciprocal is exact.
    #[inline(always)]
    pub fn standardise(&self, channel: usize) -> (f64, f64) {
        (self.scaling.centre[channel], self.scaling.scale[channel].recip())
    }

    /// Computes features and their rounding errors, as in [`Features::fill`]. Returns true if any error is nonzero.
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
    fn fill(
        features: &Features,
        readings: &[Vec<f64>],
        rows: Range<usize>,
        columns: &mut [f64],
        stride: usize,
    ) {
        let reading = |channel: usize| {
            let (centre, factor) = features.standardise(channel);
            (&readings[channel][rows.clone()], centre, factor)
        };
        fill_columns(&features.recipe, columns, rows.len(), |j| j * stride, reading);
    }
}

/// Fills columns with the features of `rows` rows, feature `j` from `place(j)`. `reading` returns the column of a
/// channel, its centre and the reciprocal of its scale.
#[inline(always)]
pub(crate) fn fill_columns<'a>(
    recipe: &[Recipe],
    columns: &mut [f64],
    rows: usize,
    place: impl Fn(usize) -> usize,
    reading: impl Fn(usize) -> (&'a [f64], f64, f64),
) {
    for (j, recipe) in recipe.iter().enumerate() {
        let (before, column) = columns.split_at_mut(place(j));
        let column = &mut column[..rows];
        match *recipe {
            Recipe::One => column.fill(1.0),
            Recipe::Reading(channel) => {
                let (readings, centre, factor) = reading(channel);
                for (z, s) in column.iter_mut().zip(readings) {
                    *z = (s - centre) * factor;
                }
            }
            Recipe::Product(a, b) => {
                let (a, b) = (&before[place(a)..][..rows], &before[place(b)..][..rows]);
                for i in 0..rows {
                    column[i] = a[i] * b[i];
                }
            }
        }
    }
}

pub(crate) fn recipe(terms: &[Term]) -> Vec<Recipe> {
    let position = |factors: &[u8]| {
        let term = Term::product(factors);
        terms.iter().position(|t| *t == term).expect("a model contains the factors of its terms")
    };
    let recipe_of = |term: &Term| match term.factors() {
        [] => Recipe::One,
        [channel] => Recipe::Reading(usize::from(*channel)),
        [head @ .., last] => Recipe::Product(position(head), position(&[*last])),
    };
    terms.iter().map(recipe_of).collect()
}

vectorised! {
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
    use super::*;
    use crate::model::{Basis, Model};
    use crate::scaling::Scaling;
    use num_rational::BigRational;

    #[test]
    fn features_are_products_of_standardised_readings() {
        let readings = [vec![0.0, 3.0, 8.0, -2.0], vec![0.0, 10.0, 2.0, 6.0]];
        let scaling = Scaling { centre: vec![1.0, 4.0], scale: vec![2.0, 1.0] };
        for basis in Basis::ALL {
            let model = Model { basis, intercept: true, channels: 2, memory: 0 };
            let features = Features::new(model, scaling.clone());
            let (stride, rows) = (5, 1..4);
            let mut columns = vec![f64::NAN; stride * features.len()];
            features.fill(&readings, rows.clone(), &mut columns, stride);
            for (j, term) in model.terms().iter().enumerate() {
                for row in rows.clone() {
                    let z = |&c: &u8| {
                        let c = usize::from(c);
                        (readings[c][row] - scaling.centre[c]) / scaling.scale[c]
                    };
                    let expected: f64 = term.factors().iter().map(z).product();
                    assert_eq!(columns[j * stride + row - 1], expected, "{}", term.name());
                }
            }
        }
    }

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
                // Two products, with a relative error of 2⁻¹⁰³ each.
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
