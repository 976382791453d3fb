//! Factors that the sensors share: what moves several reflectors at once beside the wrench.
//!
//! ```text
//! yᵢⱼ = fᵢ(bᵢ + aᵢᵀxⱼ + cᵢᵀuⱼ) + e      uⱼ ~ N(0, I)      Vⱼ = diag(σ² + τ²d²) + D·C·Cᵀ·D      D = diag f'
//! ```
//!
//! Play and mounting move the plate as a whole, so sensors err together, along what looks like a wrench. Loadings
//! C and variances are those of greatest posterior density by expectation and maximisation (Rubin & Thayer,
//! Psychometrika 47, 1982), with a normal prior of C; what the parameters took from the residuals is given back,
//! as in [`noise`](super::noise). In turn with that, Levenberg's and Marquardt's steps are made over the parameters
//! of all sensors at once, on residuals whitened by V.

use super::cholesky::Cholesky;
use super::data::Data;
use super::fit::{FittedParameters, Scaled, common_means, sensors};
use super::loadings::{FACTORS, Loadings, add_factors, factor_count};
use super::noise::{Noise, Residual};
use super::response::{PARAMETERS, Parameters, SHAPE};
use super::sensor::Prior;
use super::sums::Curve;
use crate::symmetric::SymmetricMatrix;

/// `1/s²` of the prior `N(0, s²)` of a loading: s is 0.06, what a displacement's own play is, a hundredth of the
/// way from plateau to plateau. A weaker prior lets a second factor follow the loads of single poses.
const LOADING_PRECISION: f64 = 300.0;

/// Effort of a fit, and of one from nearly the same observations. In a round the loadings and variances make
/// [`EM_STEPS`], the parameters [`STEPS`].
const ROUNDS: usize = 12;
const WARM_ROUNDS: usize = 5;
const EM_STEPS: usize = 6;
const STEPS: usize = 2;

/// Fits `count` factors, from a fit without.
pub(super) fn fit_factors(
    data: &Scaled,
    width: f64,
    start: &FittedParameters,
    count: usize,
) -> FittedParameters {
    let mut joint = Joint::new(data, width, start);
    joint.start(count);
    joint.rounds(ROUNDS)
}

/// Fits as many factors as `start` has, which was found for nearly the same observations in the same scales.
pub(super) fn fit_factors_from(
    data: &Scaled,
    width: f64,
    start: &FittedParameters,
) -> FittedParameters {
    Joint::new(data, width, start).rounds(WARM_ROUNDS)
}

/// The fit under way.
struct Joint<'a> {
    sensors: Vec<Data<'a>>,
    rows: usize,
    width: f64,
    fitted: FittedParameters,
    /// Factors in use: the first so many columns of the loadings.
    count: usize,
    /// Marquardt's damping.
    damping: f64,
}

/// `Vⱼ⁻¹`, at the slopes that a round begins with.
struct Whitening {
    /// `L/v` of each sensor and row, with `L = D·C`.
    weighted: Vec<Vec<Loadings>>,
    /// Factors of `M = I + LᵀL/v` of each row.
    factors: Vec<Cholesky<FACTORS>>,
}

/// What is minimised, its curvature and descent, over the parameters of all sensors.
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
            damping: 1e-2,
        }
    }

    fn curves(&self) -> Vec<Curve> {
        let pairs = self.sensors.iter().zip(&self.fitted.parameters);
        pairs.map(|(sensor, p)| Curve::new(p, sensor)).collect()
    }

    /// Loadings along the principal components of the standardised residuals.
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
        // Where the curve is as steep as over most of its range, in units of q.
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
            let parameters = self.fitted.parameters.iter();
            let mut prior = Prior::weak(self.width);
            prior.mean = common_means(parameters, self.width);
            self.refine_parameters(&whitening, &prior);
        }
        self.fitted
    }

    /// Steps of expectation and maximisation of the loadings and the variances.
    fn refine_loadings(&mut self, curves: &[Curve]) {
        let unsure: Vec<Vec<f64>> = (curves.iter().zip(&self.fitted.covariance))
            .map(|(curve, c)| (0..self.rows).map(|row| curve.parameter_variance(c, row)).collect())
            .collect();
        for _ in 0..EM_STEPS {
            self.step_of_loadings(curves, &unsure);
        }
    }

    fn step_of_loadings(&mut self, curves: &[Curve], unsure: &[Vec<f64>]) {
        let FittedParameters { loadings, noise, .. } = &mut self.fitted;
        let expected: Vec<Expected> = (0..self.rows)
            .map(|row| Expected::new(curves, unsure, loadings, *noise, row))
            .collect();
        let mut all = Vec::with_capacity(curves.len());
        for (sensor, (curve, c)) in curves.iter().zip(&mut *loadings).enumerate() {
            let (mut a, mut b) = ([[0.0; FACTORS]; FACTORS], [0.0; FACTORS]);
            (0..FACTORS).for_each(|k| a[k][k] = LOADING_PRECISION);
            for (row, of) in expected.iter().enumerate() {
                let slope = curve.gradient[0][row];
                let weight = slope / noise.variance(slope);
                for k in 0..FACTORS {
                    b[k] += weight * of.with_residual[sensor][k];
                    (0..FACTORS).for_each(|l| a[k][l] += weight * slope * of.square[k][l]);
                }
            }
            *c = Cholesky::new(&a).expect("a prior and squares").solve(&b);
            let residual = |(row, of): (usize, &Expected)| {
                let slope = curve.gradient[0][row];
                let mut square =
                    curve.residual[row].mul_add(curve.residual[row], unsure[sensor][row]);
                for k in 0..FACTORS {
                    let c_square: f64 = (0..FACTORS).map(|l| c[l] * of.square[k][l]).sum();
                    square += slope * c[k] * (slope * c_square - 2.0 * of.with_residual[sensor][k]);
                }
                Residual { square: square.max(0.0), slope_square: slope * slope }
            };
            all.push(expected.iter().enumerate().map(residual).collect());
        }
        *noise = noise.refine(&all, 1);
    }

    /// Makes the weights those of the noise, and what is shared the whitening.
    fn whiten(&mut self, curves: &[Curve]) -> Whitening {
        let Self { sensors, fitted, rows, .. } = self;
        let mut m = vec![identity(); *rows];
        let mut weighted = Vec::with_capacity(curves.len());
        for ((sensor, curve), c) in sensors.iter_mut().zip(curves).zip(&fitted.loadings) {
            let of_row = |(row, m): (usize, &mut [Loadings; FACTORS])| {
                let slope = curve.gradient[0][row];
                let variance = fitted.noise.variance(slope);
                sensor.weights[row] = variance.recip();
                let loading = c.map(|c| c * slope);
                add_factors(m, &mut [0.0; FACTORS], loading, (0.0, variance));
                loading.map(|l| l / variance)
            };
            weighted.push(m.iter_mut().enumerate().map(of_row).collect());
        }
        let factor = |m| Cholesky::new(m).expect("the identity and squares");
        Whitening { weighted, factors: m.iter().map(factor).collect() }
    }

    /// Steps over the parameters of all sensors, each of which lowers the sum or is not taken.
    fn refine_parameters(&mut self, whitening: &Whitening, prior: &Prior) {
        let mut at = self.equations(&self.fitted.parameters, whitening, prior);
        for _ in 0..STEPS {
            let mut damped = at.curvature.clone();
            for i in 0..damped.size() {
                damped.row_mut(i)[0] *= 1.0 + self.damping;
            }
            let Some(factor) = damped.cholesky() else { break };
            let step = factor.solve(at.descent.clone());
            let mut next = self.fitted.parameters.clone();
            for (position, p) in next.iter_mut().flatten().enumerate() {
                // As for one sensor: h and ν change at most by a factor of e.
                let is_shape = position % PARAMETERS > SHAPE;
                *p += if is_shape { step[position].clamp(-1.0, 1.0) } else { step[position] };
            }
            let there = self.equations(&next, whitening, prior);
            let better = there.cost < at.cost;
            if better {
                (self.fitted.parameters, at) = (next, there);
            }
            self.damping = (self.damping * if better { 0.2 } else { 5.0 }).clamp(1e-12, 1e8);
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
        whitening: &Whitening,
        prior: &Prior,
    ) -> FactorEquations {
        let size = parameters.len() * PARAMETERS;
        let mut curvature = SymmetricMatrix::zeros(size);
        let mut descent = Vec::with_capacity(size);
        let mut cost = 0.0;
        // What is shared: one of each of the factors for every row of the data.
        let mut shared = vec![vec![0.0; size]; self.rows * self.count];
        let mut pulls = vec![0.0; shared.len()];
        for (sensor, (data, p)) in self.sensors.iter().zip(parameters).enumerate() {
            let (own, curve) = (data.cost(p, prior), Curve::new(p, data));
            let first = sensor * PARAMETERS;
            cost += own.value;
            descent.extend(own.descent);
            for (i, information) in own.information.iter().enumerate() {
                for (j, element) in information.iter().enumerate().take(i + 1) {
                    curvature.row_mut(first + j)[i - j] = *element;
                }
            }
            for (row, weighted) in whitening.weighted[sensor].iter().enumerate() {
                let factor = whitening.factors[row].forward(weighted);
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

/// What is expected of the factors of a row, given its residuals.
struct Expected {
    /// `E[uuᵀ]`.
    square: [Loadings; FACTORS],
    /// `E[u·r]` of each sensor.
    with_residual: Vec<Loadings>,
}

impl Expected {
    fn new(
        curves: &[Curve],
        unsure: &[Vec<f64>],
        loadings: &[Loadings],
        noise: Noise,
        row: usize,
    ) -> Self {
        let (mut m, mut pull) = (identity(), [0.0; FACTORS]);
        for (curve, c) in curves.iter().zip(loadings) {
            let slope = curve.gradient[0][row];
            let of = (curve.residual[row], noise.variance(slope));
            add_factors(&mut m, &mut pull, c.map(|c| c * slope), of);
        }
        let factor = Cholesky::new(&m).expect("the identity and squares");
        let mean = factor.solve(&pull);
        let mut square = factor.inverse();
        let mut add = |a: &Loadings, scale: f64| {
            for k in 0..FACTORS {
                (0..FACTORS).for_each(|l| square[k][l] += scale * a[k] * a[l]);
            }
        };
        add(&mean, 1.0);
        let with_residual = curves.iter().zip(loadings).zip(unsure).map(|((curve, c), unsure)| {
            let slope = curve.gradient[0][row];
            let gain = factor.solve(&c.map(|c| c * slope / noise.variance(slope)));
            add(&gain, unsure[row]);
            std::array::from_fn(|k| mean[k].mul_add(curve.residual[row], gain[k] * unsure[row]))
        });
        let with_residual = with_residual.collect();
        Self { square, with_residual }
    }
}

fn identity() -> [Loadings; FACTORS] {
    std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))))
}
