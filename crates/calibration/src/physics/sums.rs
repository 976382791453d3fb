//! Sums over the training data of one sensor, several rows at a time.
//!
//! Rows are assigned in turn to [`MOST_LANES`] sums, which are added at the end, in vectors of any
//! width: the bits are the same on every machine.

use pulp::{Simd, WithSimd};

use super::data::Data;
use super::lanes::{Answers, MOST_LANES};
use super::noise::Residual;
use super::response::{PARAMETERS, Parameters, SHAPE};
use shell_data::instructions::arch;

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

/// The residual of every row as [`Noise`](super::Noise) wants it, for parameters with a covariance.
pub(super) fn residuals(
    p: &Parameters,
    covariance: &[Parameters; PARAMETERS],
    data: &Data<'_>,
) -> Vec<Residual> {
    arch().dispatch(ResidualsOf { p, covariance, data })
}

/// The residuals and gradients of a sensor along its rows, columns as long as those of the data.
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

    /// `gᵀCg` in a row.
    pub(super) fn parameter_variance(&self, c: &[Parameters; PARAMETERS], row: usize) -> f64 {
        let g = self.gradient.each_ref().map(|column| column[row]);
        let product = |row: &Parameters| g.iter().zip(row).map(|(g, c)| g * c).sum::<f64>();
        g.iter().zip(c).map(|(g, row)| g * product(row)).sum::<f64>().max(0.0)
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

struct ResidualsOf<'a> {
    p: &'a Parameters,
    covariance: &'a [Parameters; PARAMETERS],
    data: &'a Data<'a>,
}

/// The curve at some rows.
struct CurveRows<S: Simd> {
    residual: S::f64s,
    gradient: [S::f64s; PARAMETERS],
}

impl<S: Simd> CurveRows<S> {
    #[inline(always)]
    fn at(simd: S, p: &Parameters, (h, nu): (f64, f64), data: &Data<'_>, first: usize) -> Self {
        let vector = |column: &[f64]| S::as_simd_f64s(&column[first..first + S::F64_LANES]).0[0];
        let x = data.wrench.each_ref().map(|column| vector(column));
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
        Self { residual: simd.sub_f64s(vector(data.readings), value), gradient }
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
        for first in (0..data.readings.len()).step_by(S::F64_LANES) {
            let lane = first % MOST_LANES;
            let add = |sums: &mut [f64; MOST_LANES], a: S::f64s, b: S::f64s| {
                let sums = S::as_mut_simd_f64s(&mut sums[lane..lane + S::F64_LANES]).0;
                sums[0] = simd.add_f64s(simd.mul_f64s(a, b), sums[0]);
            };
            let rows = CurveRows::<S>::at(simd, p, shape, data, first);
            let weight = S::as_simd_f64s(&data.weights[first..first + S::F64_LANES]).0[0];
            add(&mut cost, simd.mul_f64s(weight, rows.residual), rows.residual);
            let mut position = 0;
            for (i, descent) in descent.iter_mut().enumerate() {
                let weighted = simd.mul_f64s(weight, rows.gradient[i]);
                add(descent, weighted, rows.residual);
                for &g in &rows.gradient[..=i] {
                    add(&mut information[position], weighted, g);
                    position += 1;
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

impl WithSimd for ResidualsOf<'_> {
    type Output = Vec<Residual>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<Residual> {
        let Self { p, covariance, data } = self;
        let shape = (libm::exp(p[SHAPE + 1]), libm::exp(p[SHAPE + 2]));
        let mut residuals = Vec::with_capacity(data.readings.len());
        for first in (0..data.readings.len()).step_by(S::F64_LANES) {
            let rows = CurveRows::<S>::at(simd, p, shape, data, first);
            let mut square = simd.mul_f64s(rows.residual, rows.residual);
            for (&gi, row) in rows.gradient.iter().zip(covariance) {
                let zero = simd.splat_f64s(0.0);
                let product = rows.gradient.iter().zip(row).fold(zero, |sum, (&g, &c)| {
                    simd.add_f64s(simd.mul_f64s(g, simd.splat_f64s(c)), sum)
                });
                square = simd.add_f64s(simd.mul_f64s(gi, product), square);
            }
            let slope = rows.gradient[0];
            let (mut squares, mut slopes) = ([0.0; MOST_LANES], [0.0; MOST_LANES]);
            S::as_mut_simd_f64s(&mut squares[..S::F64_LANES]).0[0] = square;
            S::as_mut_simd_f64s(&mut slopes[..S::F64_LANES]).0[0] = simd.mul_f64s(slope, slope);
            let pairs = squares.iter().zip(&slopes).take(S::F64_LANES);
            let residual = |(&square, &slope_square)| Residual { square, slope_square };
            residuals.extend(pairs.map(residual));
        }
        residuals.truncate(data.rows);
        residuals
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
            let put = |column: &mut Vec<f64>, values: S::f64s| {
                S::as_mut_simd_f64s(&mut column[first..first + S::F64_LANES]).0[0] = values;
            };
            put(&mut curve.residual, rows.residual);
            curve.gradient.iter_mut().zip(rows.gradient).for_each(|(column, g)| put(column, g));
        }
        curve
    }
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
        assert_eq!(residuals(&p, &[[0.0; 10]; 10], &data).len(), rows);
    }
}
