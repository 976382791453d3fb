//! Sums over the training data of one sensor, several rows at a time.
//!
//! Rows are assigned in turn to [`MOST_LANES`] sums, which are added at the end, in vectors of any
//! width: the bits are the same on every machine.

use pulp::{Simd, WithSimd};

use super::data::Data;
use super::lanes::{Answers, MOST_LANES, load_rows, store_rows};
use super::noise::Residuals;
use super::response::{PARAMETERS, Parameters, SHAPE};
use shell_data::instructions::arch;

/// Rows whose gradients are kept while their products are summed.
const ROWS_AT_ONCE: usize = 64;

/// Places of the lower triangle of a matrix of the parameters.
const TRIANGLE: usize = PARAMETERS * (PARAMETERS + 1) / 2;

/// Of the residuals `r = y − f` with their weights and gradients `g = df/dp`.
#[derive(Clone, Debug)]
pub(super) struct SensorSums {
    /// `Σ weight·g·gᵀ`, lower triangle.
    pub(super) information: [Parameters; PARAMETERS],
    /// `Σ weight·r·g`.
    pub(super) descent: Parameters,
    /// `Σ weight·r²`.
    pub(super) cost: f64,
}

impl SensorSums {
    /// At the parameters `p`.
    pub(super) fn new(p: &Parameters, data: &Data<'_>) -> Self {
        arch().dispatch(SumsOf { p, data })
    }
}

/// The residuals as [`Noise`](super::Noise) wants it, for parameters with a covariance.
pub(super) fn residuals(
    p: &Parameters,
    covariance: &[Parameters; PARAMETERS],
    data: &Data<'_>,
) -> Residuals {
    let curve = Curve::new(p, data);
    let variances = curve.parameter_variances(covariance);
    let squares = curve.residual.iter().zip(&variances).map(|(r, variance)| r * r + variance);
    let slope_squares = curve.gradient[0].iter().map(|slope| slope * slope);
    Residuals {
        squares: squares.take(data.rows).collect(),
        slope_squares: slope_squares.take(data.rows).collect(),
    }
}

/// The residuals and gradients of a sensor along its rows, columns as long as those of the data: zeros beyond its rows.
#[derive(Clone, Debug)]
pub(super) struct Curve {
    /// `y − f`.
    pub(super) residual: Vec<f64>,
    /// `df/dp`, of which the first is the slope `df/dq`.
    pub(super) gradient: [Vec<f64>; PARAMETERS],
}

impl Curve {
    /// At the parameters `p`.
    pub(super) fn new(p: &Parameters, data: &Data<'_>) -> Self {
        arch().dispatch(CurveOf { p, data })
    }

    /// `gᵀCg` along the rows, with the covariance `C` of the parameters.
    pub(super) fn parameter_variances(&self, covariance: &[Parameters; PARAMETERS]) -> Vec<f64> {
        arch().dispatch(VariancesOf { curve: self, covariance })
    }
}

struct CurveOf<'a> {
    p: &'a Parameters,
    data: &'a Data<'a>,
}

struct SumsOf<'a> {
    p: &'a Parameters,
    data: &'a Data<'a>,
}

struct VariancesOf<'a> {
    curve: &'a Curve,
    covariance: &'a [Parameters; PARAMETERS],
}

/// The curve at some rows.
struct CurveRows<S: Simd> {
    residual: S::f64s,
    gradient: [S::f64s; PARAMETERS],
}

impl<S: Simd> CurveRows<S> {
    #[inline(always)]
    fn at(simd: S, p: &Parameters, (h, nu): (f64, f64), data: &Data<'_>, first: usize) -> Self {
        let mut x = [simd.splat_f64s(0.0); 6];
        for (x, column) in x.iter_mut().zip(data.wrench) {
            *x = load_rows::<S>(column, first);
        }
        let mut q = simd.splat_f64s(p[0]);
        for (&gain, &x) in p[1..].iter().zip(&x) {
            q = simd.add_f64s(simd.mul_f64s(simd.splat_f64s(gain), x), q);
        }
        let answers = Answers::at(simd, q, h, nu);
        let mut gradient = [answers.slope; PARAMETERS];
        for (g, x) in gradient[1..].iter_mut().zip(x) {
            *g = simd.mul_f64s(answers.slope, x);
        }
        gradient[SHAPE..].copy_from_slice(&[
            simd.splat_f64s(1.0),
            answers.height,
            answers.by_shape,
        ]);
        let value = simd.add_f64s(answers.height, simd.splat_f64s(p[SHAPE]));
        let readings = load_rows::<S>(data.readings, first);
        Self { residual: simd.sub_f64s(readings, value), gradient }
    }
}

impl WithSimd for SumsOf<'_> {
    type Output = SensorSums;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> SensorSums {
        let Self { p, data } = self;
        let shape = (libm::exp(p[SHAPE + 1]), libm::exp(p[SHAPE + 2]));
        let mut information = [[0.0; MOST_LANES]; TRIANGLE];
        let mut descent = [[0.0; MOST_LANES]; PARAMETERS];
        let mut cost = [0.0; MOST_LANES];
        // Sums of products of two columns stay in registers along these rows.
        let mut gradient = [[0.0; ROWS_AT_ONCE]; PARAMETERS];
        let mut weighted = [[0.0; ROWS_AT_ONCE]; PARAMETERS];
        let (mut residual, mut weighted_residual) = ([0.0; ROWS_AT_ONCE], [0.0; ROWS_AT_ONCE]);
        for start in (0..data.readings.len()).step_by(ROWS_AT_ONCE) {
            let count = ROWS_AT_ONCE.min(data.readings.len() - start);
            for first in (0..count).step_by(S::F64_LANES) {
                let rows = CurveRows::<S>::at(simd, p, shape, data, start + first);
                let weight = load_rows::<S>(&data.weights, start + first);
                store_rows::<S>(&mut residual, first, rows.residual);
                let product = simd.mul_f64s(weight, rows.residual);
                store_rows::<S>(&mut weighted_residual, first, product);
                for (i, g) in rows.gradient.into_iter().enumerate() {
                    store_rows::<S>(&mut gradient[i], first, g);
                    store_rows::<S>(&mut weighted[i], first, simd.mul_f64s(weight, g));
                }
            }
            let residual = &residual[..count];
            add_products(simd, &mut cost, &weighted_residual, residual);
            let mut sums = information.iter_mut();
            for (i, weighted) in weighted.iter().enumerate() {
                add_products(simd, &mut descent[i], weighted, residual);
                for (gradient, sums) in gradient[..=i].iter().zip(&mut sums) {
                    add_products(simd, sums, weighted, &gradient[..count]);
                }
            }
        }
        let sum = |lanes: &[f64; MOST_LANES]| lanes.iter().sum::<f64>();
        let mut sums = SensorSums {
            information: [[0.0; PARAMETERS]; PARAMETERS],
            descent: descent.each_ref().map(sum),
            cost: sum(&cost),
        };
        let positions = (0..PARAMETERS).flat_map(|i| (0..=i).map(move |j| (i, j)));
        for ((i, j), lanes) in positions.zip(&information) {
            sums.information[i][j] = sum(lanes);
        }
        sums
    }
}

impl WithSimd for CurveOf<'_> {
    type Output = Curve;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Curve {
        let Self { p, data } = self;
        let shape = (libm::exp(p[SHAPE + 1]), libm::exp(p[SHAPE + 2]));
        let column = || vec![0.0; data.readings.len()];
        let mut curve = Curve { residual: column(), gradient: std::array::from_fn(|_| column()) };
        for first in (0..data.readings.len()).step_by(S::F64_LANES) {
            let rows = CurveRows::<S>::at(simd, p, shape, data, first);
            store_rows::<S>(&mut curve.residual, first, rows.residual);
            for (column, g) in curve.gradient.iter_mut().zip(rows.gradient) {
                store_rows::<S>(column, first, g);
            }
        }
        for column in curve.gradient.iter_mut().chain([&mut curve.residual]) {
            column[data.rows..].fill(0.0);
        }
        curve
    }
}

impl WithSimd for VariancesOf<'_> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<f64> {
        let Self { curve, covariance } = self;
        let mut variances = vec![0.0; curve.residual.len()];
        for first in (0..variances.len()).step_by(S::F64_LANES) {
            let mut gradient = [simd.splat_f64s(0.0); PARAMETERS];
            for (g, column) in gradient.iter_mut().zip(&curve.gradient) {
                *g = load_rows::<S>(column, first);
            }
            let variance = quadratic_form(simd, &gradient, covariance);
            store_rows::<S>(&mut variances, first, variance);
        }
        variances
    }
}

/// Adds the products of two columns, the rows in turn to the lanes of a sum.
#[inline(always)]
fn add_products<S: Simd>(
    simd: S,
    sums: &mut [f64; MOST_LANES],
    a: &[f64; ROWS_AT_ONCE],
    b: &[f64],
) {
    for lane in (0..MOST_LANES).step_by(S::F64_LANES) {
        let mut sum = load_rows::<S>(sums, lane);
        for (a, b) in a.as_chunks::<MOST_LANES>().0.iter().zip(b.as_chunks::<MOST_LANES>().0) {
            let product = simd.mul_f64s(load_rows::<S>(a, lane), load_rows::<S>(b, lane));
            sum = simd.add_f64s(product, sum);
        }
        store_rows::<S>(sums, lane, sum);
    }
}

/// `gᵀCg`, not below zero.
#[inline(always)]
fn quadratic_form<S: Simd>(
    simd: S,
    g: &[S::f64s; PARAMETERS],
    c: &[Parameters; PARAMETERS],
) -> S::f64s {
    let zero = simd.splat_f64s(0.0);
    let mut sum = zero;
    for (&gi, row) in g.iter().zip(c) {
        let mut product = zero;
        for (&g, &c) in g.iter().zip(row) {
            product = simd.add_f64s(simd.mul_f64s(g, simd.splat_f64s(c)), product);
        }
        sum = simd.add_f64s(simd.mul_f64s(gi, product), sum);
    }
    simd.max_f64s(sum, zero)
}

#[cfg(test)]
mod tests {
    use pulp::Scalar;

    use super::*;
    use crate::physics::response::Answer;

    #[test]
    fn sums_are_those_of_the_definition_in_vectors_of_any_width() {
        let p = [0.3, 0.5, -1.2, 0.7, 0.1, -0.4, 0.9, -0.05, 0.1, -0.3];
        let value = |row: usize, k: usize| ((row * 31 + k * 17) % 19) as f64 / 10.0 - 0.9;
        let rows = 21;
        let pad = |column: Vec<f64>| [column, vec![0.0; 3]].concat();
        let column = |k: usize| pad((0..rows).map(|row| value(row, k)).collect());
        let wrench = std::array::from_fn(column);
        let (readings, weights) = (column(7), pad(vec![2.0; rows]));
        let data = Data { wrench: &wrench, readings: &readings, rows, weights };
        let found = SensorSums::new(&p, &data);
        let (mut cost, mut information, mut descent) = (0.0, 0.0, 0.0);
        for row in 0..rows {
            let x = std::array::from_fn(|axis| wrench[axis][row]);
            let answer = Answer::at(&p, &x);
            let (g, r) = (answer.gradient(&x), readings[row] - answer.value);
            cost += 2.0 * r * r;
            information += 2.0 * g[9] * g[4];
            descent += 2.0 * g[8] * r;
        }
        // The curve in lanes is right to 1e-12.
        assert!((found.cost - cost).abs() < 1e-10);
        assert!((found.information[9][4] - information).abs() < 1e-10);
        assert!((found.descent[8] - descent).abs() < 1e-10);
        let narrow = SumsOf { p: &p, data: &data }.with_simd(Scalar);
        assert_eq!((found.cost, found.descent), (narrow.cost, narrow.descent));
        assert_eq!(found.information, narrow.information);
        assert_eq!(residuals(&p, &[[0.0; 10]; 10], &data).squares.len(), rows);
    }
}
