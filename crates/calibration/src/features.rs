//! From readings to features: the columns of the design matrix.
//!
//! Every feature of degree two or three is the product of two features that come before it, so a
//! row of the design matrix costs one multiplication per column whatever the model.

use std::ops::Range;

use super::model::{Model, Term};
use super::scaling::Scaling;
use shell_data::vectorised;

/// The features of a model, in the order of its [terms](Model::terms), ready to be evaluated.
#[derive(Clone, Debug, PartialEq)]
pub struct Features {
    model: Model,
    scaling: Scaling,
    recipe: Vec<Recipe>,
}

/// Rows that are worked on at once where features are used as soon as they are made.
pub(super) const LANES: usize = 16;

/// One feature of that many rows.
pub(super) type RowLanes = [f64; LANES];

/// How one feature is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Recipe {
    /// The standardised reading of a channel.
    Reading(usize),
    /// The product of two features that come before.
    Product(usize, usize),
    /// The constant.
    One,
}

impl Features {
    /// The features of `model` over readings standardised by `scaling`.
    ///
    /// # Panics
    /// If `scaling` is not for as many columns as `model`.
    pub fn new(model: Model, scaling: Scaling) -> Self {
        assert_eq!(model.columns(), scaling.channels(), "one scaling per column");
        let recipe = recipe(&model.terms());
        Self { model, scaling, recipe }
    }

    /// The model.
    pub fn model(&self) -> Model {
        self.model
    }

    /// The scaling of the readings.
    pub fn scaling(&self) -> &Scaling {
        &self.scaling
    }

    /// Number of features, the intercept among them.
    pub fn len(&self) -> usize {
        self.recipe.len()
    }

    /// Whether there is no feature: no channels and no intercept.
    pub fn is_empty(&self) -> bool {
        self.recipe.is_empty()
    }

    pub(super) fn recipe(&self) -> &[Recipe] {
        &self.recipe
    }

    /// Fills `rows × len` features, column by column.
    ///
    /// `readings` has one column per channel, in counts, of which `rows` are used. Feature `j` goes
    /// to `columns[j·stride ..][..rows.len()]`, dimensionless.
    ///
    /// # Panics
    /// If a reading column is shorter than `rows.end`, or `columns` too short.
    pub fn fill(
        &self,
        readings: &[Vec<f64>],
        rows: Range<usize>,
        columns: &mut [f64],
        stride: usize,
    ) {
        fill(self, readings, rows, columns, stride);
    }

    /// The features of the [`LANES`] rows from `start`, of which the last may be missing: those repeat
    /// the last row there is.
    #[inline(always)]
    pub(super) fn lanes(&self, readings: &[Vec<f64>], start: usize, features: &mut [RowLanes]) {
        for (j, recipe) in self.recipe.iter().enumerate() {
            let (before, feature) = features.split_at_mut(j);
            let feature = &mut feature[0];
            match *recipe {
                Recipe::One => *feature = [1.0; LANES],
                Recipe::Reading(channel) => {
                    let (centre, factor) = self.standardise(channel);
                    *feature = load(&readings[channel][start..]);
                    for z in feature {
                        *z = (*z - centre) * factor;
                    }
                }
                Recipe::Product(a, b) => {
                    let (a, b) = (&before[a], &before[b]);
                    for i in 0..LANES {
                        feature[i] = a[i] * b[i];
                    }
                }
            }
        }
    }

    /// Centre of a channel and the reciprocal of its scale, exact for a power of two.
    #[inline(always)]
    pub(super) fn standardise(&self, channel: usize) -> (f64, f64) {
        (self.scaling.centre[channel], self.scaling.scale[channel].recip())
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

/// Fills columns of so many rows with features, each from its `place` on. `reading` is the column of a channel, its
/// centre and the reciprocal of its scale.
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

#[inline(always)]
fn load(column: &[f64]) -> RowLanes {
    match column.first_chunk() {
        Some(lanes) => *lanes,
        None => std::array::from_fn(|i| column[i.min(column.len() - 1)]),
    }
}

/// How each of the terms of a model is made.
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

#[cfg(test)]
mod tests {
    use super::super::model::Basis;
    use super::*;

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
}
