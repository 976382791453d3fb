use super::PhysicsError;
use super::cholesky::{Cholesky, identity};
use super::fit::{FittedParameters, Observation, Scaled, Scales, fit};
use super::noise::Noise;
use super::response::{
    FACTORS, Loadings, PARAMETERS, Parameters, Response, add_factors, factor_count,
};
use shell_data::wrench::PerAxis;

/// Multiple of the identity that keeps the prior finite for an axis that is never loaded.
const LEAST_LOAD: f64 = 1e-6;

#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PhysicsModel {
    /// Number of channels of a frame, including those without a sensor in the model.
    pub channels: usize,
    /// Divisors of a wrench, N and N·m: the root mean square of the training loads.
    pub wrench_scale: PerAxis<f64>,
    /// `Σ_w⁻¹`, the inverse second moments of the training loads, in these scales.
    pub load_precision: PerAxis<PerAxis<f64>>,
    /// λ, the weight of this prior of the wrench.
    pub lambda: f64,
    /// Standard deviation of the priors of lo, ln h and ln ν.
    pub prior_width: f64,
    pub noise: Noise,
    /// One sensor for each channel that varies.
    pub sensors: Vec<Sensor>,
}

#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Sensor {
    /// Channel of the frame, from 0.
    pub channel: usize,
    /// Least reading in the training data, counts.
    pub least: f64,
    /// Greatest minus least reading, counts; `y = (reading − least)/range`.
    pub range: f64,
    pub parameters: Parameters,
    pub covariance: [Parameters; PARAMETERS],
    /// c: displacement per shared factor, which has variance 1; zero without factors.
    #[serde(default)]
    pub loadings: Loadings,
}

impl Sensor {
    /// Response to a wrench in the model's scales, and its variance from noise and parameters.
    pub fn response(&self, x: &PerAxis<f64>, noise: &Noise) -> (Response, f64) {
        let response = Response::at(&self.parameters, x);
        let g = response.gradient(x);
        let product = |row: &Parameters| g.iter().zip(row).map(|(g, c)| g * c).sum::<f64>();
        let unsure: f64 = g.iter().zip(&self.covariance).map(|(g, row)| g * product(row)).sum();
        (response, noise.variance(response.slope) + unsure.max(0.0))
    }
}

impl PhysicsModel {
    pub fn parameter_count(&self) -> usize {
        self.sensors.iter().map(|sensor| sensor.parameters.len()).sum()
    }

    /// Channels, from 0, that never change.
    pub fn dead_channels(&self) -> Vec<usize> {
        let is_dead = |channel: &usize| self.sensors.iter().all(|of| of.channel != *channel);
        (0..self.channels).filter(is_dead).collect()
    }

    pub fn factor_count(&self) -> usize {
        factor_count(self.sensors.iter().map(|sensor| &sensor.loadings))
    }

    /// Model without shared factors. The mean variance of their displacements becomes independent noise of each sensor.
    #[must_use]
    pub fn without_factors(&self) -> Self {
        let mut model = self.clone();
        let shared: f64 = self.sensors.iter().flat_map(|of| of.loadings).map(|c| c * c).sum();
        model.noise.displacement += shared / self.sensors.len().max(1) as f64;
        model.sensors.iter_mut().for_each(|sensor| sensor.loadings = [0.0; FACTORS]);
        model
    }

    /// Log density of an observation's readings at its wrench, up to a constant of all models in the same scales.
    pub(super) fn ln_density(&self, o: &Observation) -> f64 {
        let x = std::array::from_fn(|axis| o.wrench[axis] / self.wrench_scale[axis]);
        // V = diag(v) + LLᵀ, so r·V⁻¹·r = Σr²/v − |M^(−½)·Lᵀr/v|² and det V = Πv·det M, M = I + LᵀL/v.
        let mut m = identity();
        let (mut pull, mut sum) = ([0.0; FACTORS], 0.0);
        for sensor in &self.sensors {
            let (response, variance) = sensor.response(&x, &self.noise);
            let residual =
                (o.readings[sensor.channel] - sensor.least) / sensor.range - response.value;
            sum += residual * residual / variance + libm::log(variance);
            add_factors(
                &mut m,
                &mut pull,
                sensor.loadings.map(|c| c * response.slope),
                (residual, variance),
            );
        }
        let factor = Cholesky::new(&m).expect("the identity and squares");
        let explained: f64 = factor.forward(&pull).iter().map(|x| x * x).sum();
        -0.5 * (sum - explained + factor.ln_determinant())
    }

    pub(super) fn from_fit(
        scales: &Scales,
        data: &Scaled,
        fitted: &FittedParameters,
        (lambda, prior_width): (f64, f64),
    ) -> Self {
        let sensor = |i: usize| {
            let (channel, least, range) = scales.channels[i];
            Sensor {
                channel,
                least,
                range,
                parameters: fitted.parameters[i],
                covariance: fitted.covariance[i],
                loadings: fitted.loadings[i],
            }
        };
        Self {
            channels: scales.frame_channels,
            wrench_scale: scales.wrench,
            load_precision: load_precision(data),
            lambda,
            prior_width,
            noise: fitted.noise,
            sensors: (0..scales.channels.len()).map(sensor).collect(),
        }
    }

    /// Fits with the λ and prior width given; see [`Choice`](super::Choice) for choosing them.
    ///
    /// # Errors
    /// [`PhysicsError`] if there are too few observations or channels.
    pub fn fit(
        observations: &[Observation],
        lambda: f64,
        width: f64,
    ) -> Result<Self, PhysicsError> {
        let chosen: Vec<&Observation> = observations.iter().collect();
        let scales = Scales::new(&chosen)?;
        let data = scales.apply(&chosen);
        let fitted = fit(&data, width);
        Ok(Self::from_fit(&scales, &data, &fitted, (lambda, width)))
    }
}

fn load_precision(data: &Scaled) -> PerAxis<PerAxis<f64>> {
    let moment = |i: usize, j: usize| {
        let products = data.wrench[i].iter().zip(&data.wrench[j]).map(|(a, b)| a * b);
        products.sum::<f64>() / data.rows as f64
    };
    let mut moments: PerAxis<PerAxis<f64>> =
        std::array::from_fn(|i| std::array::from_fn(|j| moment(i, j)));
    (0..6).for_each(|i| moments[i][i] += LEAST_LOAD);
    Cholesky::new(&moments).map_or_else(identity, |factor| factor.inverse())
}
