//! Joint fit of all sensors: curves near a common mean, noise of maximum likelihood.
//!
//! Sensors of one make resemble each other, so the shape of each curve (lo, ln h, ln ν) has a normal prior about a
//! common mean, which has the prior of [`Prior::weak`] with ten times the variance (a hierarchical model; Gelman et
//! al., Bayesian Data Analysis, 3rd ed., §5.4). The steps of a round, over parameters, common means and the variances
//! of [`Noise`], raise the posterior density.

use super::PhysicsError;
use super::cholesky::{Cholesky, diagonal};
use super::lanes::MOST_LANES;
use super::noise::{Noise, Residuals};
use super::response::{FACTORS, Loadings, PARAMETERS, Parameters, SHAPE};
use super::sensor::{Data, ParameterEstimate, Prior, curve_at, residuals};
use shell_data::statistics::extremes;
use shell_data::wrench::PerAxis;

/// Prior variance of a common mean, divided by that of a sensor about it.
const MEAN_VARIANCE: f64 = 10.0;

/// Effort of a fit. More rounds change predictions by a twentieth of their standard errors.
const FIRST_STEPS: usize = 15;
const ROUNDS: usize = 12;
const STEPS: usize = 4;

/// Rounds of a fit that starts from the result for nearly the same observations.
const WARM_ROUNDS: usize = 4;

const NOISE_STEPS: usize = 20;

/// Maximum number of channels: the flags of a frame have 16 bits, and its values are on the stack.
pub const MOST_CHANNELS: usize = 16;

#[derive(Clone, Debug, PartialEq)]
pub struct Observation {
    /// Group of the observation, for example its pose. Validation holds out whole groups.
    pub group: u64,
    /// N and N·m.
    pub wrench: PerAxis<f64>,
    /// Counts.
    pub readings: Vec<f64>,
}

/// Root mean square of each axis of the wrench, N and N·m; 1 for an axis that is never loaded.
pub fn wrench_scale(observations: &[&Observation]) -> PerAxis<f64> {
    std::array::from_fn(|axis| {
        let squares: f64 = observations.iter().map(|o| o.wrench[axis].powi(2)).sum();
        if squares > 0.0 { (squares / observations.len() as f64).sqrt() } else { 1.0 }
    })
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Scales {
    /// Root mean square of each axis, N and N·m; 1 for an axis that is never loaded.
    pub(super) wrench: PerAxis<f64>,
    pub(super) frame_channels: usize,
    /// Position, least reading and range of each channel that varies.
    pub(super) channels: Vec<(usize, f64, f64)>,
}

#[derive(Clone, Debug)]
pub(super) struct Scaled {
    /// Number of rows; columns are padded with zeros to a multiple of [`MOST_LANES`].
    pub(super) rows: usize,
    pub(super) wrench: PerAxis<Vec<f64>>,
    pub(super) readings: Vec<Vec<f64>>,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct FittedParameters {
    pub(super) parameters: Vec<Parameters>,
    pub(super) covariance: Vec<[Parameters; PARAMETERS]>,
    /// Change of a sensor's displacement by each shared factor.
    pub(super) loadings: Vec<Loadings>,
    pub(super) noise: Noise,
}

impl Scales {
    /// # Errors
    /// [`PhysicsError`] if there are too few observations or channels.
    pub(super) fn new(observations: &[&Observation]) -> Result<Self, PhysicsError> {
        let found = observations.len();
        if found < PARAMETERS {
            return Err(PhysicsError::TooFewObservations { found, needed: PARAMETERS });
        }
        let frame_channels = observations.iter().map(|o| o.readings.len()).max().unwrap_or(0);
        if frame_channels == 0 || frame_channels > MOST_CHANNELS {
            return Err(PhysicsError::Channels(frame_channels));
        }
        let is_finite = |o: &&Observation| {
            let mut values = o.wrench.iter().chain(&o.readings);
            o.readings.len() == frame_channels && values.all(|x| x.is_finite())
        };
        if !observations.iter().all(is_finite) {
            return Err(PhysicsError::NotFinite);
        }
        let range = |channel: usize| {
            let (least, most) = extremes(observations.iter().map(|o| o.readings[channel]));
            (channel, least, most - least)
        };
        let varies = |range: &(usize, f64, f64)| range.2 > 0.0;
        let channels: Vec<_> = (0..frame_channels).map(range).filter(varies).collect();
        if channels.len() < 6 {
            return Err(PhysicsError::TooFewChannels(channels.len()));
        }
        Ok(Self { wrench: wrench_scale(observations), frame_channels, channels })
    }

    pub(super) fn apply(&self, observations: &[&Observation]) -> Scaled {
        let rows = observations.len();
        let padded = |mut column: Vec<f64>| {
            column.resize(rows.next_multiple_of(MOST_LANES), 0.0);
            column
        };
        let axis =
            |i: usize| padded(observations.iter().map(|o| o.wrench[i] / self.wrench[i]).collect());
        let channel = |&(channel, least, range): &(usize, f64, f64)| {
            padded(observations.iter().map(|o| (o.readings[channel] - least) / range).collect())
        };
        Scaled {
            rows,
            wrench: std::array::from_fn(axis),
            readings: self.channels.iter().map(channel).collect(),
        }
    }
}

pub(super) fn fit(data: &Scaled, width: f64) -> FittedParameters {
    let prior = Prior::weak(width);
    let mut sensors = sensors(data);
    let estimates = sensors.iter().map(|s| s.fit(&prior, FIRST_STEPS)).collect();
    rounds(&mut sensors, estimates, Noise::START, width, ROUNDS)
}

/// Fits all sensors from the result for nearly the same observations in the same scales.
pub(super) fn fit_from(data: &Scaled, width: f64, start: &FittedParameters) -> FittedParameters {
    let estimates = start.parameters.iter().map(|&p| ParameterEstimate::at(p)).collect();
    let mut sensors = sensors(data);
    for (sensor, &p) in sensors.iter_mut().zip(&start.parameters) {
        let nothing = [[0.0; PARAMETERS]; PARAMETERS];
        weigh(sensor, &residuals(&p, &nothing, sensor), start.noise);
    }
    rounds(&mut sensors, estimates, start.noise, width, WARM_ROUNDS)
}

pub(super) fn sensors(data: &Scaled) -> Vec<Data<'_>> {
    // The slope is 0.15 if a curve runs through its range over some six units of q.
    let weight = Noise::START.variance(0.15).recip();
    let mut weights = vec![weight; data.rows];
    weights.resize(data.wrench[0].len(), 0.0);
    let sensor = |readings| Data {
        wrench: &data.wrench,
        readings,
        rows: data.rows,
        weights: weights.clone(),
    };
    data.readings.iter().map(|readings| sensor(readings)).collect()
}

/// Sets the weights to the inverse variances of the noise, at the slopes in these residuals.
fn weigh(sensor: &mut Data<'_>, residuals: &Residuals, noise: Noise) {
    for (weight, &slope_square) in sensor.weights.iter_mut().zip(&residuals.slope_squares) {
        *weight = noise.variance_at(slope_square).recip();
    }
}

fn rounds(
    sensors: &mut [Data<'_>],
    mut estimates: Vec<ParameterEstimate>,
    mut noise: Noise,
    width: f64,
    rounds: usize,
) -> FittedParameters {
    let mut prior = Prior::weak(width);
    let mut covariance = covariances(sensors, &estimates, &prior);
    for _ in 0..rounds {
        let of = |((sensor, estimate), covariance): ((&Data<'_>, &ParameterEstimate), _)| {
            residuals(&estimate.parameters, covariance, sensor)
        };
        let all: Vec<Residuals> = sensors.iter().zip(&estimates).zip(&covariance).map(of).collect();
        noise = noise.refine(&all, NOISE_STEPS);
        for (sensor, residuals) in sensors.iter_mut().zip(&all) {
            weigh(sensor, residuals, noise);
        }
        prior = common_prior(estimates.iter().map(|of| &of.parameters), width);
        for (sensor, estimate) in sensors.iter().zip(&mut estimates) {
            sensor.refine(estimate, &prior, STEPS);
        }
        covariance = covariances(sensors, &estimates, &prior);
    }
    let parameters: Vec<Parameters> = estimates.iter().map(|of| of.parameters).collect();
    FittedParameters {
        loadings: vec![[0.0; FACTORS]; parameters.len()],
        parameters,
        covariance,
        noise,
    }
}

/// Prior about the most likely common means, given the sensors.
pub(super) fn common_prior<'a>(
    sensors: impl Iterator<Item = &'a Parameters> + Clone,
    width: f64,
) -> Prior {
    let mut prior = Prior::weak(width);
    let (own, count) = (MEAN_VARIANCE.recip(), sensors.clone().count() as f64);
    for (position, mean) in prior.mean.iter_mut().enumerate().skip(SHAPE) {
        let sum: f64 = sensors.clone().map(|p| p[position]).sum();
        *mean = own.mul_add(*mean, sum) / (count + own);
    }
    prior
}

fn covariances(
    sensors: &[Data<'_>],
    estimates: &[ParameterEstimate],
    prior: &Prior,
) -> Vec<[Parameters; PARAMETERS]> {
    let of = |(sensor, estimate): (&Data<'_>, &ParameterEstimate)| {
        let p = &estimate.parameters;
        let information = sensor.cost_along(&curve_at(p, sensor), p, prior).information;
        // The prior makes it positive definite. If rounding spoils that, the prior's covariance is used.
        Cholesky::new(&information)
            .map_or_else(|| diagonal(prior.sd.map(|sd| sd.powi(2))), |f| f.inverse())
    };
    sensors.iter().zip(estimates).map(of).collect()
}
