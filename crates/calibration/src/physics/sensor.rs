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
use super::response::{Answer, PARAMETERS, Parameters, SHAPE, displacement};
use shell_data::wrench::PerAxis;

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

/// What one sensor is fitted to.
#[derive(Clone, Debug)]
pub(super) struct Data<'a> {
    /// Wrenches, in units of the model's scales.
    pub(super) wrench: &'a [PerAxis<f64>],
    /// Readings, in ranges above the least.
    pub(super) readings: &'a [f64],
    /// Inverse variances.
    pub(super) weights: Vec<f64>,
}

/// Parameters under way.
#[derive(Clone, Debug)]
pub(super) struct Estimate {
    pub(super) parameters: Parameters,
    /// The sum that is minimised.
    pub(super) cost: f64,
    /// Marquardt's damping.
    damping: f64,
}

impl Data<'_> {
    /// The better of the fits from both starts, after `steps` steps each.
    pub(super) fn fit(&self, prior: &Prior, steps: usize) -> Estimate {
        let [first, second] = STARTS.map(|nu| {
            let mut estimate = self.begin(self.start(prior, nu), prior);
            self.refine(&mut estimate, prior, steps);
            estimate
        });
        if second.cost < first.cost { second } else { first }
    }

    /// An estimate at these parameters.
    pub(super) fn begin(&self, parameters: Parameters, prior: &Prior) -> Estimate {
        Estimate { parameters, cost: self.cost(&parameters, prior), damping: 1e-2 }
    }

    /// Makes `steps` steps, each of which lowers the cost or is not taken.
    pub(super) fn refine(&self, estimate: &mut Estimate, prior: &Prior, steps: usize) {
        estimate.cost = self.cost(&estimate.parameters, prior);
        for _ in 0..steps {
            let (information, gradient) = self.normal_equations(&estimate.parameters, prior);
            let mut damped = information;
            (0..PARAMETERS).for_each(|i| damped[i][i] *= 1.0 + estimate.damping);
            let mut next = estimate.parameters;
            if let Some(factor) = Cholesky::new(&damped) {
                let step = factor.solve(&gradient);
                for (place, (next, step)) in next.iter_mut().zip(step).enumerate() {
                    // h and ν change at most by a factor of e: further the line is not straight.
                    *next += if place > SHAPE { step.clamp(-1.0, 1.0) } else { step };
                }
            }
            let cost = self.cost(&next, prior);
            let better = cost < estimate.cost;
            if better {
                (estimate.parameters, estimate.cost) = (next, cost);
            }
            let factor = if better { 0.2 } else { 5.0 };
            estimate.damping = (estimate.damping * factor).clamp(1e-12, 1e8);
        }
    }

    /// The inverse of the parameters' covariance: Gauss's and Newton's curvature of the cost, and
    /// half its steepest descent.
    pub(super) fn normal_equations(
        &self,
        p: &Parameters,
        prior: &Prior,
    ) -> ([Parameters; PARAMETERS], Parameters) {
        let (mut information, mut descent) = ([[0.0; PARAMETERS]; PARAMETERS], [0.0; PARAMETERS]);
        for i in 0..PARAMETERS {
            let precision = prior.sd[i].powi(-2);
            (information[i][i], descent[i]) = (precision, precision * (prior.mean[i] - p[i]));
        }
        for ((x, y), weight) in self.wrench.iter().zip(self.readings).zip(&self.weights) {
            let answer = Answer::at(p, x);
            let (gradient, residual) = (answer.gradient(x), y - answer.value);
            for i in 0..PARAMETERS {
                let weighted = weight * gradient[i];
                descent[i] = weighted.mul_add(residual, descent[i]);
                for j in 0..=i {
                    information[i][j] = weighted.mul_add(gradient[j], information[i][j]);
                }
            }
        }
        (information, descent)
    }

    fn cost(&self, p: &Parameters, prior: &Prior) -> f64 {
        let prior = (0..PARAMETERS).map(|i| ((p[i] - prior.mean[i]) / prior.sd[i]).powi(2));
        let mut cost: f64 = prior.sum();
        for ((x, y), weight) in self.wrench.iter().zip(self.readings).zip(&self.weights) {
            let residual = y - Answer::at(p, x).value;
            cost = (weight * residual).mul_add(residual, cost);
        }
        cost
    }

    /// The logit-linear fit at this ν and the prior's plateaus.
    fn start(&self, prior: &Prior, nu: f64) -> Parameters {
        let mut p = prior.mean;
        p[SHAPE + 2] = libm::log(nu);
        let (lo, h) = (p[SHAPE], libm::exp(p[SHAPE + 1]));
        let (mut a, mut b) = ([[0.0; 7]; 7], [0.0; 7]);
        for ((x, &y), weight) in self.wrench.iter().zip(self.readings).zip(&self.weights) {
            let (q, slope) = displacement(y, lo, h, nu, MARGIN);
            let row: [f64; 7] = std::array::from_fn(|i| if i == 0 { 1.0 } else { x[i - 1] });
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
