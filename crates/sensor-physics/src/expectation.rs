//! One step of expectation maximisation (EM) for the loadings, several rows at a time.

use pulp::Simd;

use super::cholesky::{Cholesky, LaneCholesky};
use super::fit::MOST_CHANNELS;
use super::lanes::{Lanes, MOST_LANES, add_rows};
use super::noise::{Noise, Residuals};
use super::response::{FACTORS, Loadings};
use super::sensor::Curve;
use shell_data::vectorised;

/// `1/s²` of the prior `N(0, s²)` of a loading. s = 0.06 is about the play of a single displacement, and a hundredth
/// of the curve's width. With a weaker prior, a second factor follows the loads of single poses.
const LOADING_PRECISION: f64 = 300.0;

/// Expected moments of the factors of each row, given its residuals; padded as the curves are.
pub(super) struct Expectation {
    /// `E[uuᵀ]`.
    square: [[Vec<f64>; FACTORS]; FACTORS],
    /// `E[u·r]` of each sensor.
    with_residual: Vec<[Vec<f64>; FACTORS]>,
}

/// Slopes of a curve at some rows, and the slopes divided by the variance of the readings there.
#[inline(always)]
fn slopes<S: Simd>(simd: S, curve: &Curve, first: usize, noise: Noise) -> (Lanes<S>, Lanes<S>) {
    let slope = Lanes::load(simd, &curve.gradient[0], first);
    (slope, slope / noise.variance_at(slope * slope))
}

#[inline(always)]
fn add_square<S: Simd>(
    square: &mut [[Lanes<S>; FACTORS]; FACTORS],
    scale: Lanes<S>,
    a: &[Lanes<S>; FACTORS],
) {
    for (row, &ak) in square.iter_mut().zip(a) {
        for (sum, &al) in row.iter_mut().zip(a) {
            *sum = scale * ak * al + *sum;
        }
    }
}

vectorised! {
    /// Makes the E step. `variances` holds the variance of each curve due to its uncertain parameters.
    pub(super) fn expect<S: Simd>(
        simd: S,
        curves: &[Curve],
        variances: &[Vec<f64>],
        loadings: &[Loadings],
        noise: Noise,
    ) -> Expectation {
        let (zero, one) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, 1.0));
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
                let residual = Lanes::load(simd, &curve.residual, first);
                for k in 0..FACTORS {
                    weighted[k] = weight * c[k];
                    pull[k] = weighted[k] * residual + pull[k];
                    for l in 0..FACTORS {
                        m[k][l] = weighted[k] * (slope * c[l]) + m[k][l];
                    }
                }
            }
            let factor = LaneCholesky::new(&m);
            let mean = factor.solve(&pull);
            let mut square = [[zero; FACTORS]; FACTORS];
            for (k, column) in square.iter_mut().enumerate() {
                column[k] = one;
                *column = factor.solve(column);
            }
            add_square(&mut square, one, &mean);
            for (sensor, (curve, weighted)) in curves.iter().zip(&weighted).enumerate() {
                let gain = factor.solve(weighted);
                let variance = Lanes::load(simd, &variances[sensor], first);
                add_square(&mut square, variance, &gain);
                let residual = Lanes::load(simd, &curve.residual, first);
                for (k, column) in expected.with_residual[sensor].iter_mut().enumerate() {
                    (mean[k] * residual + gain[k] * variance).store(column, first);
                }
            }
            for (columns, row) in expected.square.iter_mut().zip(square) {
                for (column, element) in columns.iter_mut().zip(row) {
                    element.store(column, first);
                }
            }
        }
        expected
    }
}

vectorised! {
    /// The M step for a sensor: its most likely loadings, and its first `rows` residuals without the factors.
    pub(super) fn maximise<S: Simd>(
        simd: S,
        of: &Expectation,
        sensor: usize,
        curve: &Curve,
        variances: &[f64],
        noise: Noise,
        rows: usize,
    ) -> (Loadings, Residuals) {
        let Expectation { square, with_residual } = of;
        let with_residual = &with_residual[sensor];
        let mut a = [[[0.0; MOST_LANES]; FACTORS]; FACTORS];
        let mut b = [[0.0; MOST_LANES]; FACTORS];
        for first in (0..variances.len()).step_by(S::F64_LANES) {
            let (slope, weight) = slopes(simd, curve, first, noise);
            for k in 0..FACTORS {
                let with_residual = Lanes::load(simd, &with_residual[k], first);
                add_rows(&mut b[k], first, weight * with_residual);
                for l in 0..FACTORS {
                    let square = Lanes::load(simd, &square[k][l], first);
                    add_rows(&mut a[k][l], first, weight * slope * square);
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
            let slope = Lanes::load(simd, &curve.gradient[0], first);
            let residual = Lanes::load(simd, &curve.residual, first);
            let mut left = residual * residual + Lanes::load(simd, variances, first);
            for k in 0..FACTORS {
                let mut of_square = Lanes::splat(simd, 0.0);
                for l in 0..FACTORS {
                    of_square = Lanes::load(simd, &square[k][l], first) * c[l] + of_square;
                }
                let with_residual = Lanes::load(simd, &with_residual[k], first);
                let term = slope * of_square - (with_residual + with_residual);
                left = slope * c[k] * term + left;
            }
            left.max(0.0).store(&mut residuals.squares, first);
            (slope * slope).store(&mut residuals.slope_squares, first);
        }
        residuals.squares.truncate(rows);
        residuals.slope_squares.truncate(rows);
        (c, residuals)
    }
}
