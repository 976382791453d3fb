//! Fit of one sensor's parameters by weighted least squares with weak priors.
//!
//! ```text
//! minimise  Σ weightᵢ·(yᵢ − f(xᵢ; p))² + Σ ((p − m)/s)²
//! ```
//!
//! Levenberg-Marquardt steps with the analytic gradient find the minimum (Nocedal & Wright, Numerical Optimization, 2nd
//! ed., §10.3). The tail of a curve may bend either way, so there are two starts, at two values of ν. Each start
//! inverts the curve and solves for b and a, in which the displacement is linear (*logit-linear* fit).
//!
//! Rows are dealt to [`MOST_LANES`] partial sums, with the same bits for vectors of any width.

use pulp::Simd;

use super::cholesky::Cholesky;
use super::damping::Damping;
use super::lanes::{LaneResponse, Lanes, MOST_LANES, linear, quadratic_form};
use super::noise::Residuals;
use super::response::{PARAMETERS, Parameters, SHAPE, displacement, move_by};
use shell_data::vectorised;
use shell_data::wrench::PerAxis;

/// Number of rows whose products are summed before the next rows.
const ROWS_AT_ONCE: usize = 64;

/// Values of ν to start from, on either side of 1, the value of the logistic curve.
const STARTS: [f64; 2] = [0.7, 1.6];

/// A start keeps readings this share of h away from the flat ends, where noise would dominate.
const MARGIN: f64 = 0.02;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Prior {
    pub(super) mean: Parameters,
    pub(super) sd: Parameters,
}

impl Prior {
    /// Prior before any sensor is known. Displacements are a few units of q over the training
    /// loads. The curve reaches a twentieth of the range beyond the readings at either end, and its
    /// parameters are uncertain by `width` (lo in ranges, h and ν in factors of e).
    pub(super) fn weak(width: f64) -> Self {
        let (wide, lo, ln_h) = (3.0, -0.05, 0.1);
        Self {
            mean: [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, lo, ln_h, 0.0],
            sd: [wide, wide, wide, wide, wide, wide, wide, width, width, width],
        }
    }
}

#[derive(Clone, Debug)]
pub(super) struct ParameterEstimate {
    pub(super) parameters: Parameters,
    damping: Damping,
}

impl ParameterEstimate {
    pub(super) fn at(parameters: Parameters) -> Self {
        Self { parameters, damping: Damping::default() }
    }
}

impl Data<'_> {
    pub(super) fn fit(&self, prior: &Prior, steps: usize) -> ParameterEstimate {
        let [(first, first_cost), (second, second_cost)] = STARTS.map(|nu| {
            let mut estimate = ParameterEstimate::at(self.start(prior, nu));
            let cost = self.refine(&mut estimate, prior, steps);
            (estimate, cost)
        });
        if second_cost < first_cost { second } else { first }
    }

    /// Makes `steps` steps, rejects those that do not lower the cost, and returns the final cost.
    pub(super) fn refine(
        &self,
        estimate: &mut ParameterEstimate,
        prior: &Prior,
        steps: usize,
    ) -> f64 {
        let ParameterEstimate { parameters, damping } = estimate;
        let cost = |p: &Parameters| self.cost_along(&curve_at(p, self), p, prior);
        let mut at = cost(parameters);
        for _ in 0..steps {
            let mut damped = at.information;
            (0..PARAMETERS).for_each(|i| damped[i][i] *= damping.scale());
            let next = Cholesky::new(&damped).map(|factor| {
                let mut next = *parameters;
                move_by([&mut next], &factor.solve(&at.descent));
                (next, cost(&next))
            });
            if let Some(next) = damping.accept(next, |(_, next)| next.value < at.value) {
                (*parameters, at) = next;
            }
        }
        at.value
    }

    pub(super) fn cost_along(&self, curve: &Curve, p: &Parameters, prior: &Prior) -> Cost {
        let mut cost = cost_of(curve, &self.weights);
        for (i, value) in p.iter().enumerate() {
            let (precision, off) = (prior.sd[i].powi(-2), prior.mean[i] - value);
            cost.information[i][i] += precision;
            cost.descent[i] += precision * off;
            cost.value += precision * off * off;
        }
        cost
    }

    /// Logit-linear fit at this ν, with the prior's lo and h.
    fn start(&self, prior: &Prior, nu: f64) -> Parameters {
        let mut p = prior.mean;
        p[SHAPE + 2] = libm::log(nu);
        let (lo, h) = (p[SHAPE], libm::exp(p[SHAPE + 1]));
        let (mut a, mut b) = ([[0.0; 7]; 7], [0.0; 7]);
        for (i, (&y, weight)) in self.readings.iter().zip(&self.weights).enumerate() {
            let (q, slope) = displacement(y, lo, h, nu, MARGIN);
            let row: [f64; 7] =
                std::array::from_fn(|k| if k == 0 { 1.0 } else { self.wrench[k - 1][i] });
            let weight = weight * slope * slope;
            for i in 0..7 {
                b[i] += weight * row[i] * q;
                (0..=i).for_each(|j| a[i][j] += weight * row[i] * row[j]);
            }
        }
        // An axis that is never loaded keeps its gain at zero.
        let trace: f64 = (0..7).map(|i| a[i][i]).sum();
        (0..7).for_each(|i| a[i][i] += 1e-3 * trace / 7.0);
        if let Some(factor) = Cholesky::new(&a) {
            p[..7].copy_from_slice(&factor.solve(&b));
        }
        p
    }
}

/// Data for the fit of one sensor. Columns are padded without weight from `rows` on to a multiple
/// of [`MOST_LANES`].
#[derive(Clone, Debug)]
pub(super) struct Data<'a> {
    /// Wrench in units of the model's scales.
    pub(super) wrench: &'a PerAxis<Vec<f64>>,
    /// Readings in ranges of the channel, above its least reading.
    pub(super) readings: &'a [f64],
    pub(super) rows: usize,
    pub(super) weights: Vec<f64>,
}

/// A sum of squares, its curvature and its descent, for weighted residuals `r = y − f` with gradients `g = df/dp`. The
/// terms of a prior are added.
pub(super) struct Cost {
    /// `Σ weight·r²`.
    pub(super) value: f64,
    /// `Σ weight·g·gᵀ`, lower triangle: the Gauss-Newton curvature of half the cost and, with that
    /// of the prior, the inverse of the parameters' covariance.
    pub(super) information: [Parameters; PARAMETERS],
    /// `Σ weight·r·g`: the steepest descent of half the cost.
    pub(super) descent: Parameters,
}

/// Residuals for [`Noise`](super::Noise), of parameters with a covariance.
pub(super) fn residuals(
    p: &Parameters,
    covariance: &[Parameters; PARAMETERS],
    data: &Data<'_>,
) -> Residuals {
    let curve = curve_at(p, data);
    let variances = parameter_variances(&curve, covariance);
    let squares = curve.residual.iter().zip(&variances).map(|(r, variance)| r * r + variance);
    let slope_squares = curve.gradient[0].iter().map(|slope| slope * slope);
    Residuals {
        squares: squares.take(data.rows).collect(),
        slope_squares: slope_squares.take(data.rows).collect(),
    }
}

/// Residuals and gradients along the rows of a sensor, with zeros beyond `rows`.
#[derive(Clone, Debug)]
pub(super) struct Curve {
    /// `y − f`.
    pub(super) residual: Vec<f64>,
    /// `df/dp`; the first is the slope `df/dq`.
    pub(super) gradient: [Vec<f64>; PARAMETERS],
}

vectorised! {
    pub(super) fn curve_at<S: Simd>(simd: S, p: &Parameters, data: &Data<'_>) -> Curve {
        let column = || vec![0.0; data.readings.len()];
        let mut curve = Curve { residual: column(), gradient: std::array::from_fn(|_| column()) };
        let (h, nu) = (libm::exp(p[SHAPE + 1]), libm::exp(p[SHAPE + 2]));
        for first in (0..data.readings.len()).step_by(S::F64_LANES) {
            let mut x = [Lanes::splat(simd, 0.0); 6];
            for (x, column) in x.iter_mut().zip(data.wrench) {
                *x = Lanes::load(simd, column, first);
            }
            let response = LaneResponse::at(linear(p[0], &p[1..], &x), h, nu);
            let residual = Lanes::load(simd, data.readings, first) - (response.height + p[SHAPE]);
            residual.store(&mut curve.residual, first);
            for (column, g) in curve.gradient.iter_mut().zip(response.gradient(&x)) {
                g.store(column, first);
            }
        }
        for column in curve.gradient.iter_mut().chain([&mut curve.residual]) {
            column[data.rows..].fill(0.0);
        }
        curve
    }
}

vectorised! {
    fn cost_of<S: Simd>(simd: S, curve: &Curve, weights: &[f64]) -> Cost {
        let Curve { residual, gradient } = curve;
        let mut information = [[[0.0; MOST_LANES]; PARAMETERS]; PARAMETERS];
        let mut descent = [[0.0; MOST_LANES]; PARAMETERS];
        let mut value = [0.0; MOST_LANES];
        // Keeps the sums of products of two columns in registers over these rows.
        let mut weighted = [0.0; ROWS_AT_ONCE];
        for start in (0..weights.len()).step_by(ROWS_AT_ONCE) {
            let rows = start..weights.len().min(start + ROWS_AT_ONCE);
            let (weights, residual) = (&weights[rows.clone()], &residual[rows.clone()]);
            weigh(&mut weighted, weights, residual);
            add_products(simd, &mut value, &weighted, residual);
            for (i, column) in gradient.iter().enumerate() {
                weigh(&mut weighted, weights, &column[rows.clone()]);
                add_products(simd, &mut descent[i], &weighted, residual);
                for (column, sums) in gradient[..=i].iter().zip(&mut information[i]) {
                    add_products(simd, sums, &weighted, &column[rows.clone()]);
                }
            }
        }
        let sum = |lanes: [f64; MOST_LANES]| lanes.iter().sum::<f64>();
        Cost {
            value: sum(value),
            information: information.map(|row| row.map(sum)),
            descent: descent.map(sum),
        }
    }
}

vectorised! {
    /// `gᵀCg` for each row of a curve, with the covariance `C` of the parameters.
    pub(super) fn parameter_variances<S: Simd>(
        simd: S,
        curve: &Curve,
        covariance: &[Parameters; PARAMETERS],
    ) -> Vec<f64> {
        let mut variances = vec![0.0; curve.residual.len()];
        for first in (0..variances.len()).step_by(S::F64_LANES) {
            let mut gradient = [Lanes::splat(simd, 0.0); PARAMETERS];
            for (g, column) in gradient.iter_mut().zip(&curve.gradient) {
                *g = Lanes::load(simd, column, first);
            }
            let rows = covariance.iter().map(|row| &row[..]);
            quadratic_form(&gradient, rows).store(&mut variances, first);
        }
        variances
    }
}

#[inline(always)]
fn weigh(weighted: &mut [f64; ROWS_AT_ONCE], weights: &[f64], column: &[f64]) {
    for ((weighted, weight), x) in weighted.iter_mut().zip(weights).zip(column) {
        *weighted = weight * x;
    }
}

/// Adds the products of two columns; rows are assigned in turn to the lanes of a sum.
#[inline(always)]
fn add_products<S: Simd>(
    simd: S,
    sums: &mut [f64; MOST_LANES],
    a: &[f64; ROWS_AT_ONCE],
    b: &[f64],
) {
    for lane in (0..MOST_LANES).step_by(S::F64_LANES) {
        let mut sum = Lanes::load(simd, sums, lane);
        for (a, b) in a.as_chunks::<MOST_LANES>().0.iter().zip(b.as_chunks::<MOST_LANES>().0) {
            sum = Lanes::load(simd, a, lane) * Lanes::load(simd, b, lane) + sum;
        }
        sum.store(sums, lane);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::response::Response;

    #[test]
    fn sums_equal_those_of_the_definition() {
        let p = [0.3, 0.5, -1.2, 0.7, 0.1, -0.4, 0.9, -0.05, 0.1, -0.3];
        let value = |row: usize, k: usize| ((row * 31 + k * 17) % 19) as f64 / 10.0 - 0.9;
        let rows = 21;
        let pad = |column: Vec<f64>| [column, vec![0.0; 3]].concat();
        let column = |k: usize| pad((0..rows).map(|row| value(row, k)).collect());
        let wrench = std::array::from_fn(column);
        let (readings, weights) = (column(7), pad(vec![2.0; rows]));
        let data = Data { wrench: &wrench, readings: &readings, rows, weights };
        let found = cost_of(&curve_at(&p, &data), &data.weights);
        let (mut cost, mut information, mut descent) = (0.0, 0.0, 0.0);
        for row in 0..rows {
            let x = std::array::from_fn(|axis| wrench[axis][row]);
            let response = Response::at(&p, &x);
            let (g, r) = (response.gradient(&x), readings[row] - response.value);
            cost += 2.0 * r * r;
            information += 2.0 * g[9] * g[4];
            descent += 2.0 * g[8] * r;
        }
        // The curve in lanes is right to 1e-12.
        assert!((found.value - cost).abs() < 1e-10);
        assert!((found.information[9][4] - information).abs() < 1e-10);
        assert!((found.descent[8] - descent).abs() < 1e-10);
        assert_eq!(residuals(&p, &[[0.0; 10]; 10], &data).squares.len(), rows);
    }
}
