//! The parameters of one sensor, by weighted least squares with weak priors.
//!
//! ```text
//! minimise  Σ weightᵢ·(yᵢ − f(xᵢ; p))² + Σ ((p − m)/s)²
//! ```
//!
//! by Levenberg's and Marquardt's steps with the analytic gradient (Nocedal & Wright, Numerical
//! Optimization, 2nd ed., §10.3). The curve's tail bends either way, so there are two starts, at two
//! values of ν; each makes the displacement linear in the wrench by inverting the curve (the
//! *logit-linear* fit) and solves for b and a.

use super::cholesky::Cholesky;
use super::response::{PARAMETERS, Parameters, SHAPE, displacement, move_by};
use super::sums::{Cost, Curve, Data, cost_of, curve_at};

/// Values of ν to start from, on either side of the logistic curve's 1.
const STARTS: [f64; 2] = [0.7, 1.6];

/// A start takes readings to within this share of the plateaus, beyond which noise would rule.
const MARGIN: f64 = 0.02;

/// Priors: means and standard deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Prior {
    pub(super) mean: Parameters,
    pub(super) sd: Parameters,
}

impl Prior {
    /// Before any sensor is known: displacements of a few units of q over the loads of the training
    /// data, and a curve that reaches a twentieth of the range beyond the readings at either end,
    /// each of its parameters uncertain by `width` (lo in ranges, h and ν in factors of e).
    pub(super) fn weak(width: f64) -> Self {
        let (wide, lo, ln_h) = (3.0, -0.05, 0.1);
        Self {
            mean: [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, lo, ln_h, 0.0],
            sd: [wide, wide, wide, wide, wide, wide, wide, width, width, width],
        }
    }
}

/// Parameters under way.
#[derive(Clone, Debug)]
pub(super) struct ParameterEstimate {
    pub(super) parameters: Parameters,
    /// Marquardt's damping.
    damping: f64,
}

impl ParameterEstimate {
    /// One at these parameters.
    pub(super) fn at(parameters: Parameters) -> Self {
        Self { parameters, damping: 1e-2 }
    }
}

impl Data<'_> {
    /// The better of the fits from both starts, after `steps` steps each.
    pub(super) fn fit(&self, prior: &Prior, steps: usize) -> ParameterEstimate {
        let [(first, first_cost), (second, second_cost)] = STARTS.map(|nu| {
            let mut estimate = ParameterEstimate::at(self.start(prior, nu));
            let cost = self.refine(&mut estimate, prior, steps);
            (estimate, cost)
        });
        if second_cost < first_cost { second } else { first }
    }

    /// Makes `steps` steps, each of which lowers the cost or is not taken. Returns what it is then.
    pub(super) fn refine(
        &self,
        estimate: &mut ParameterEstimate,
        prior: &Prior,
        steps: usize,
    ) -> f64 {
        let curve = curve_at(&estimate.parameters, self);
        let mut cost = self.cost_along(&curve, &estimate.parameters, prior);
        for _ in 0..steps {
            let mut damped = cost.information;
            (0..PARAMETERS).for_each(|i| damped[i][i] *= 1.0 + estimate.damping);
            let mut next = estimate.parameters;
            if let Some(factor) = Cholesky::new(&damped) {
                move_by([&mut next], &factor.solve(&cost.descent));
            }
            let next_cost = self.cost_along(&curve_at(&next, self), &next, prior);
            let better = next_cost.value < cost.value;
            if better {
                (estimate.parameters, cost) = (next, next_cost);
            }
            let factor = if better { 0.2 } else { 5.0 };
            estimate.damping = (estimate.damping * factor).clamp(1e-12, 1e8);
        }
        cost.value
    }

    /// What is minimised, at the parameters `p`, whose curve is this.
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

    /// The logit-linear fit at this ν and the prior's plateaus.
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
