//! Factors that the sensors share: causes other than the wrench that move several reflectors at once.
//!
//! ```text
//! yᵢⱼ = fᵢ(bᵢ + aᵢᵀxⱼ + cᵢᵀuⱼ) + e      uⱼ ~ N(0, I)      Vⱼ = diag(σ² + τ²d²) + D·C·Cᵀ·D      D = diag f'
//! ```
//!
//! Play and mounting move the plate as a whole, so the sensors' errors are correlated and look like a wrench.
//! Expectation maximisation finds the loadings C and the variances at the maximum of the posterior density (Rubin &
//! Thayer, Psychometrika 47, 1982), with a normal prior of C and residuals corrected as in [`noise`](super::noise).
//! It alternates with Levenberg-Marquardt steps over all parameters, on residuals whitened by V.

use super::cholesky::{Cholesky, identity};
use super::damping::Damping;
use super::expectation::{expect, maximise};
use super::fit::{FittedParameters, Scaled, common_prior, sensors};
use super::response::{
    FACTORS, Loadings, PARAMETERS, Parameters, add_factors, factor_count, move_by,
};
use super::sensor::{Curve, Data, Prior, curve_at, parameter_variances};
use least_squares::symmetric::SymmetricMatrix;

/// Number of rounds of a fit; `WARM_ROUNDS` is for one that starts from the result for nearly the same observations. A
/// round makes [`EM_STEPS`] steps of loadings and variances and [`STEPS`] of the parameters.
const ROUNDS: usize = 12;
const WARM_ROUNDS: usize = 5;
const EM_STEPS: usize = 6;
const STEPS: usize = 2;

/// Fits `new` factors; with `None`, as many as `start`, which fits nearly the same observations in the same scales.
pub(super) fn fit_factors(
    data: &Scaled,
    width: f64,
    start: &FittedParameters,
    new: Option<usize>,
) -> FittedParameters {
    let mut joint = Joint::new(data, width, start);
    let Some(count) = new else { return joint.rounds(WARM_ROUNDS) };
    joint.start(count);
    joint.rounds(ROUNDS)
}

struct Joint<'a> {
    sensors: Vec<Data<'a>>,
    rows: usize,
    width: f64,
    fitted: FittedParameters,
    /// Number of factors: the first columns of the loadings are in use.
    count: usize,
    damping: Damping,
}

/// `F⁻¹·L/v` of each sensor and row, with `L = D·C` and `F·Fᵀ = I + LᵀL/v`, at the slopes with which a round begins.
/// With the variances `v` it gives `Vⱼ⁻¹`.
type Whitening = Vec<Vec<Loadings>>;

struct FactorEquations {
    cost: f64,
    curvature: SymmetricMatrix,
    descent: Vec<f64>,
}

impl<'a> Joint<'a> {
    fn new(data: &'a Scaled, width: f64, start: &FittedParameters) -> Self {
        Self {
            sensors: sensors(data),
            rows: data.rows,
            width,
            fitted: start.clone(),
            count: factor_count(&start.loadings),
            damping: Damping::default(),
        }
    }

    fn curves(&self) -> Vec<Curve> {
        let pairs = self.sensors.iter().zip(&self.fitted.parameters);
        pairs.map(|(sensor, p)| curve_at(p, sensor)).collect()
    }

    /// Starts the loadings along the principal components of the standardised residuals.
    fn start(&mut self, count: usize) {
        let (curves, noise) = (self.curves(), self.fitted.noise);
        let pull = |curve: &Curve, row: usize| {
            let slope = curve.gradient[0][row];
            curve.residual[row] * slope / noise.variance(slope)
        };
        let product = |a: &Curve, b: &Curve| {
            (0..self.rows).map(|row| pull(a, row) * pull(b, row)).sum::<f64>()
        };
        let sizes: Vec<f64> = curves.iter().map(|of| product(of, of).max(1e-300).sqrt()).collect();
        let correlation = SymmetricMatrix::from_fn(curves.len(), |i, j| {
            product(&curves[i], &curves[j]) / (sizes[i] * sizes[j])
        });
        let Some(eigen) = correlation.eigen() else { return };
        // Size of a loading in units of q, at a slope that the curve has over most of its range.
        let size = (noise.displacement + noise.reading / 0.03).sqrt();
        self.count = count.min(curves.len());
        let mut positions: Vec<usize> = (0..curves.len()).collect();
        positions.sort_by(|&a, &b| eigen.values[b].total_cmp(&eigen.values[a]));
        for (factor, position) in positions.into_iter().take(self.count).enumerate() {
            let share = (eigen.values[position] - 0.5).max(0.2).sqrt();
            for (loadings, of_sensor) in self.fitted.loadings.iter_mut().zip(eigen.vector(position))
            {
                loadings[factor] = of_sensor * share * size;
            }
        }
    }

    fn rounds(mut self, rounds: usize) -> FittedParameters {
        for _ in 0..rounds {
            let curves = self.curves();
            self.refine_loadings(&curves);
            let whitening = self.whiten(&curves);
            let prior = common_prior(self.fitted.parameters.iter(), self.width);
            self.refine_parameters(&whitening, &prior);
        }
        self.fitted
    }

    fn refine_loadings(&mut self, curves: &[Curve]) {
        let pairs = curves.iter().zip(&self.fitted.covariance);
        let variances: Vec<Vec<f64>> =
            pairs.map(|(curve, c)| parameter_variances(curve, c)).collect();
        let FittedParameters { loadings, noise, .. } = &mut self.fitted;
        for _ in 0..EM_STEPS {
            let now = *noise;
            let of = expect(curves, &variances, loadings, now);
            let mut all = Vec::with_capacity(curves.len());
            for (sensor, (c, variances)) in loadings.iter_mut().zip(&variances).enumerate() {
                let residuals;
                (*c, residuals) = maximise(&of, sensor, &curves[sensor], variances, now, self.rows);
                all.push(residuals);
            }
            *noise = now.refine(&all, 1);
        }
    }

    fn whiten(&mut self, curves: &[Curve]) -> Whitening {
        let Self { sensors, fitted, rows, .. } = self;
        let mut m = vec![identity(); *rows];
        let mut whitening = Vec::with_capacity(curves.len());
        for ((sensor, curve), c) in sensors.iter_mut().zip(curves).zip(&fitted.loadings) {
            let of_row = |(row, m): (usize, &mut [Loadings; FACTORS])| {
                let slope = curve.gradient[0][row];
                let variance = fitted.noise.variance(slope);
                sensor.weights[row] = variance.recip();
                let loading = c.map(|c| c * slope);
                add_factors(m, &mut [0.0; FACTORS], loading, (0.0, variance));
                loading.map(|l| l / variance)
            };
            whitening.push(m.iter_mut().enumerate().map(of_row).collect::<Vec<Loadings>>());
        }
        for (row, m) in m.iter().enumerate() {
            let factor = Cholesky::new(m).expect("the identity and squares");
            whitening.iter_mut().for_each(|of| of[row] = factor.forward(&of[row]));
        }
        whitening
    }

    /// Makes steps of the parameters of all sensors; rejects steps that do not lower the cost.
    fn refine_parameters(&mut self, whitening: &[Vec<Loadings>], prior: &Prior) {
        let mut at = self.equations(&self.fitted.parameters, whitening, prior);
        for _ in 0..STEPS {
            let mut damped = at.curvature.clone();
            for i in 0..damped.size {
                damped.row_mut(i)[0] *= self.damping.scale();
            }
            let next = damped.cholesky().map(|factor| {
                let mut next = self.fitted.parameters.clone();
                move_by(&mut next, &factor.solve(at.descent.clone()));
                let there = self.equations(&next, whitening, prior);
                (next, there)
            });
            if let Some(next) = self.damping.accept(next, |(_, next)| next.cost < at.cost) {
                (self.fitted.parameters, at) = next;
            }
        }
        if let Some(factor) = at.curvature.cholesky() {
            let inverse = factor.inverse();
            for (sensor, c) in self.fitted.covariance.iter_mut().enumerate() {
                let first = sensor * PARAMETERS;
                *c = std::array::from_fn(|i| {
                    std::array::from_fn(|j| {
                        inverse.square_element(first + i.min(j), first + i.max(j))
                    })
                });
            }
        }
    }

    fn equations(
        &self,
        parameters: &[Parameters],
        whitening: &[Vec<Loadings>],
        prior: &Prior,
    ) -> FactorEquations {
        let size = parameters.len() * PARAMETERS;
        let mut curvature = SymmetricMatrix::zeros(size);
        let mut descent = Vec::with_capacity(size);
        let mut cost = 0.0;
        // The shared part: one vector for each factor of every row of the data.
        let mut shared = vec![vec![0.0; size]; self.rows * self.count];
        let mut pulls = vec![0.0; shared.len()];
        for (sensor, (data, p)) in self.sensors.iter().zip(parameters).enumerate() {
            let curve = curve_at(p, data);
            let own = data.cost_along(&curve, p, prior);
            let first = sensor * PARAMETERS;
            cost += own.value;
            descent.extend(own.descent);
            for (i, information) in own.information.iter().enumerate() {
                for (j, element) in information.iter().enumerate().take(i + 1) {
                    curvature.row_mut(first + j)[i - j] = *element;
                }
            }
            for (row, factor) in whitening[sensor].iter().enumerate() {
                for (k, factor) in factor.iter().enumerate().take(self.count) {
                    let position = row * self.count + k;
                    pulls[position] += factor * curve.residual[row];
                    let of_row = curve.gradient.iter().map(|gradient| factor * gradient[row]);
                    shared[position][first..].iter_mut().zip(of_row).for_each(|(to, it)| *to = it);
                }
            }
        }
        curvature.subtract_squares(&shared);
        for (shared, pull) in shared.iter().zip(&pulls) {
            cost -= pull * pull;
            descent.iter_mut().zip(shared).for_each(|(descent, shared)| *descent -= pull * shared);
        }
        FactorEquations { cost, curvature, descent }
    }
}
