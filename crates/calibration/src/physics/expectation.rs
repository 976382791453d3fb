//! One step of expectation maximisation (EM) for the loadings, several rows at a time.

use pulp::{Simd, WithSimd};
use shell_data::instructions::arch;

use super::cholesky::{Cholesky, LaneCholesky};
use super::lanes::{MOST_LANES, add_product, load_rows, store_rows};
use super::loadings::{FACTORS, Loadings};
use super::noise::{Noise, Residuals};
use super::observation::MOST_CHANNELS;
use super::sums::Curve;

/// `1/s²` of the prior `N(0, s²)` of a loading: s is 0.06, what a displacement's own play is, a hundredth of the
/// way from plateau to plateau. A weaker prior lets a second factor follow the loads of single poses.
const LOADING_PRECISION: f64 = 300.0;

/// Expected moments of the factors of each row, given its residuals. Columns are as long as those of the curves.
pub(super) struct Expectation {
    /// `E[uuᵀ]`.
    square: [[Vec<f64>; FACTORS]; FACTORS],
    /// `E[u·r]` of each sensor.
    with_residual: Vec<[Vec<f64>; FACTORS]>,
}

impl Expectation {
    /// The E step. `parameter_variances` has the variances of each curve that come from its parameters.
    pub(super) fn new(
        curves: &[Curve],
        parameter_variances: &[Vec<f64>],
        loadings: &[Loadings],
        noise: Noise,
    ) -> Self {
        arch().dispatch(Expect { curves, parameter_variances, loadings, noise })
    }

    /// The M step for a sensor: its most likely loadings, and its first `rows` residuals less the factors.
    pub(super) fn maximise(
        &self,
        sensor: usize,
        (curve, variances): (&Curve, &[f64]),
        noise: Noise,
        rows: usize,
    ) -> (Loadings, Residuals) {
        arch().dispatch(Maximise { of: self, sensor, curve, variances, noise, rows })
    }
}

struct Expect<'a> {
    curves: &'a [Curve],
    parameter_variances: &'a [Vec<f64>],
    loadings: &'a [Loadings],
    noise: Noise,
}

struct Maximise<'a> {
    of: &'a Expectation,
    sensor: usize,
    curve: &'a Curve,
    variances: &'a [f64],
    noise: Noise,
    rows: usize,
}

/// The slopes of a curve at some rows, and those over the variance of the readings there.
#[inline(always)]
fn slopes<S: Simd>(simd: S, curve: &Curve, first: usize, noise: Noise) -> (S::f64s, S::f64s) {
    let slope = load_rows::<S>(&curve.gradient[0], first);
    let variance = noise.variances_at(simd, simd.mul_f64s(slope, slope));
    (slope, simd.div_f64s(slope, variance))
}

/// `square += scale·a·aᵀ`.
#[inline(always)]
fn add_square<S: Simd>(
    simd: S,
    square: &mut [[S::f64s; FACTORS]; FACTORS],
    scale: S::f64s,
    a: &[S::f64s; FACTORS],
) {
    for (row, &ak) in square.iter_mut().zip(a) {
        let scaled = simd.mul_f64s(scale, ak);
        for (sum, &al) in row.iter_mut().zip(a) {
            *sum = simd.add_f64s(simd.mul_f64s(scaled, al), *sum);
        }
    }
}

impl WithSimd for Expect<'_> {
    type Output = Expectation;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Expectation {
        let Self { curves, parameter_variances, loadings, noise } = self;
        let (zero, one) = (simd.splat_f64s(0.0), simd.splat_f64s(1.0));
        let length = curves.first().map_or(0, |curve| curve.residual.len());
        let columns = || std::array::from_fn(|_| vec![0.0; length]);
        let mut expected = Expectation {
            square: std::array::from_fn(|_| columns()),
            with_residual: curves.iter().map(|_| columns()).collect(),
        };
        for first in (0..length).step_by(S::F64_LANES) {
            // `M = I + LᵀL/v` and `Lᵀr/v`, where `L = D·C`; and `L/v`.
            let (mut m, mut pull) = ([[zero; FACTORS]; FACTORS], [zero; FACTORS]);
            (0..FACTORS).for_each(|k| m[k][k] = one);
            let mut weighted = [[zero; FACTORS]; MOST_CHANNELS];
            for ((curve, c), weighted) in curves.iter().zip(loadings).zip(&mut weighted) {
                let (slope, weight) = slopes(simd, curve, first, noise);
                let residual = load_rows::<S>(&curve.residual, first);
                for k in 0..FACTORS {
                    weighted[k] = simd.mul_f64s(weight, simd.splat_f64s(c[k]));
                    pull[k] = simd.add_f64s(simd.mul_f64s(weighted[k], residual), pull[k]);
                    for l in 0..FACTORS {
                        let loading = simd.mul_f64s(slope, simd.splat_f64s(c[l]));
                        m[k][l] = simd.add_f64s(simd.mul_f64s(weighted[k], loading), m[k][l]);
                    }
                }
            }
            let factor = LaneCholesky::new(simd, &m);
            let mean = factor.solve(simd, &pull);
            let mut square = [[zero; FACTORS]; FACTORS];
            for (k, column) in square.iter_mut().enumerate() {
                column[k] = one;
                *column = factor.solve(simd, column);
            }
            add_square(simd, &mut square, one, &mean);
            for (sensor, (curve, weighted)) in curves.iter().zip(&weighted).enumerate() {
                let gain = factor.solve(simd, weighted);
                let variance = load_rows::<S>(&parameter_variances[sensor], first);
                add_square(simd, &mut square, variance, &gain);
                let residual = load_rows::<S>(&curve.residual, first);
                for (k, column) in expected.with_residual[sensor].iter_mut().enumerate() {
                    let (of_mean, of_gain) =
                        (simd.mul_f64s(mean[k], residual), simd.mul_f64s(gain[k], variance));
                    store_rows::<S>(column, first, simd.add_f64s(of_mean, of_gain));
                }
            }
            for (columns, row) in expected.square.iter_mut().zip(square) {
                for (column, element) in columns.iter_mut().zip(row) {
                    store_rows::<S>(column, first, element);
                }
            }
        }
        expected
    }
}

impl WithSimd for Maximise<'_> {
    type Output = (Loadings, Residuals);

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> (Loadings, Residuals) {
        let Self { of: Expectation { square, with_residual }, curve, variances, .. } = self;
        let with_residual = &with_residual[self.sensor];
        let mut a = [[[0.0; MOST_LANES]; FACTORS]; FACTORS];
        let mut b = [[0.0; MOST_LANES]; FACTORS];
        for first in (0..variances.len()).step_by(S::F64_LANES) {
            let (slope, weight) = slopes(simd, curve, first, self.noise);
            let by_slope = simd.mul_f64s(weight, slope);
            for k in 0..FACTORS {
                let pull = (weight, load_rows::<S>(&with_residual[k], first));
                add_product(simd, &mut b[k], first, pull);
                for l in 0..FACTORS {
                    let square = (by_slope, load_rows::<S>(&square[k][l], first));
                    add_product(simd, &mut a[k][l], first, square);
                }
            }
        }
        let sum = |lanes: [f64; MOST_LANES]| lanes.iter().sum::<f64>();
        let mut a = a.map(|row| row.map(sum));
        (0..FACTORS).for_each(|k| a[k][k] += LOADING_PRECISION);
        let c = Cholesky::new(&a).expect("a prior and squares").solve(&b.map(sum));

        let column = || vec![0.0; variances.len()];
        let mut residuals = Residuals { squares: column(), slope_squares: column() };
        for first in (0..variances.len()).step_by(S::F64_LANES) {
            let slope = load_rows::<S>(&curve.gradient[0], first);
            let residual = load_rows::<S>(&curve.residual, first);
            let mut left = simd.mul_f64s(residual, residual);
            left = simd.add_f64s(left, load_rows::<S>(variances, first));
            for k in 0..FACTORS {
                let mut of_square = simd.splat_f64s(0.0);
                for l in 0..FACTORS {
                    let product =
                        simd.mul_f64s(simd.splat_f64s(c[l]), load_rows::<S>(&square[k][l], first));
                    of_square = simd.add_f64s(product, of_square);
                }
                let with_residual = load_rows::<S>(&with_residual[k], first);
                let twice = simd.add_f64s(with_residual, with_residual);
                let term = simd.sub_f64s(simd.mul_f64s(slope, of_square), twice);
                let loading = simd.mul_f64s(slope, simd.splat_f64s(c[k]));
                left = simd.add_f64s(simd.mul_f64s(loading, term), left);
            }
            let left = simd.max_f64s(left, simd.splat_f64s(0.0));
            store_rows::<S>(&mut residuals.squares, first, left);
            store_rows::<S>(&mut residuals.slope_squares, first, simd.mul_f64s(slope, slope));
        }
        residuals.squares.truncate(self.rows);
        residuals.slope_squares.truncate(self.rows);
        (c, residuals)
    }
}
