//! From a frame of readings to the wrench.
//!
//! ```text
//! minimise  Σ (yᵢ − fᵢ(x))²/vᵢ + λ·xᵀΣ_w⁻¹x      vᵢ = σ² + τ²·(dfᵢ/dq)² + gᵢᵀCᵢgᵢ
//! ```
//!
//! by Gauss's and Newton's steps with `v` from the step before. `gᵀCg` is what the parameters of the
//! sensor are unsure about there, so a sensor counts little where it was not trained; on a plateau
//! `df/dx` is nothing, so a saturated sensor drops out by itself. The start inverts each curve for its
//! displacement and solves the linear problem that is left. Nothing is carried from frame to frame:
//! results do not depend on the order of rows.
//!
//! Standard errors are those of Laplace's approximation, the curvature at the end (MacKay, Neural
//! Computation 4, 1992).

use super::cholesky::Cholesky;
use super::model::{PhysicsModel, Sensor};
use super::observations::MOST_CHANNELS;
use super::response::{Answer, PARAMETERS, Parameters, SHAPE, displacement};
use shell_data::wrench::PerAxis;

/// Most steps; four or five are usual.
const STEPS: usize = 12;

/// Rest: a step that is shorter than this many standard errors, squared.
const REST: f64 = 1e-6;

/// Halvings of a step that does not lower the sum.
const HALVINGS: usize = 4;

/// How near the plateaus, in shares of h, the start takes a reading.
const MARGIN: f64 = 0.01;

/// What noise of readings the start allows for, in shares of h.
const START_NOISE: f64 = 0.02;

/// A sensor whose curve is flatter than this share of its steepest is on a plateau.
const FLAT: f64 = 0.05;

/// A reading this many standard deviations from its curve does not belong to the wrench found.
const FAR: f64 = 5.0;

/// A wrench and how far to trust it. Masks have bit `i` for channel `i`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// N and N·m.
    pub wrench: PerAxis<f64>,
    /// N and N·m.
    pub standard_errors: PerAxis<f64>,
    /// Channels on a plateau of their curve: they say nothing about this wrench.
    pub saturated: u16,
    /// Channels that were left out: constant in the training data, or not a number in this frame.
    pub left_out: u16,
    /// Channels whose reading is far from what the others say.
    pub misfit: u16,
    /// Whether the steps came to rest.
    pub converged: bool,
}

/// A model made ready to convert frames.
#[derive(Clone, Debug)]
pub struct Inversion {
    sensors: Vec<Ready>,
    channels: usize,
    scale: PerAxis<f64>,
    /// `λ·Σ_w⁻¹`.
    prior: PerAxis<PerAxis<f64>>,
    noise: super::Noise,
    dead: u16,
}

#[derive(Clone, Debug)]
struct Ready {
    channel: usize,
    least: f64,
    per_count: f64,
    offset: f64,
    gains: PerAxis<f64>,
    lo: f64,
    h: f64,
    nu: f64,
    /// Of the parameters.
    covariance: [Parameters; PARAMETERS],
    /// `dy/dq` below which the curve is flat.
    flat: f64,
}

/// The sensors of a frame.
#[derive(Clone, Copy)]
struct Frame {
    /// Readings in ranges above the least; only those of sensors in use are read.
    y: [f64; MOST_CHANNELS],
    /// Sensors in use, by place.
    used: u16,
}

/// Curves and the sum to be minimised at one wrench.
#[derive(Clone, Copy)]
struct State {
    x: PerAxis<f64>,
    residual: [f64; MOST_CHANNELS],
    slope: [f64; MOST_CHANNELS],
    variance: [f64; MOST_CHANNELS],
}

impl Ready {
    fn new(sensor: &Sensor) -> Self {
        let p = &sensor.parameters;
        let (h, nu) = (libm::exp(p[SHAPE + 1]), libm::exp(p[SHAPE + 2]));
        // dy/dq = h·ν·σ^ν·(1 − σ) is steepest where σ = ν/(1 + ν).
        let steepest = h * nu * libm::pow(nu / (1.0 + nu), nu) / (1.0 + nu);
        Self {
            channel: sensor.channel,
            least: sensor.least,
            per_count: sensor.range.recip(),
            offset: p[0],
            gains: std::array::from_fn(|axis| p[1 + axis]),
            lo: p[SHAPE],
            h,
            nu,
            covariance: sensor.covariance,
            flat: FLAT * steepest,
        }
    }

    #[inline]
    fn answer(&self, x: &PerAxis<f64>) -> Answer {
        let q = (0..6).fold(self.offset, |q, axis| self.gains[axis].mul_add(x[axis], q));
        Answer::at_displacement(q, self.lo, self.h, self.nu)
    }

    /// `gᵀCg`.
    #[inline]
    fn parameter_variance(&self, answer: &Answer, x: &PerAxis<f64>) -> f64 {
        let g = answer.gradient(x);
        let mut variance = 0.0;
        for i in 0..PARAMETERS {
            let mut below = 0.0;
            for j in 0..i {
                below = self.covariance[i][j].mul_add(g[j], below);
            }
            variance = g[i].mul_add(2.0_f64.mul_add(below, self.covariance[i][i] * g[i]), variance);
        }
        variance.max(0.0)
    }
}

impl Inversion {
    /// Makes a model ready.
    pub fn new(model: &PhysicsModel) -> Self {
        let all = ((1_u32 << model.channels) - 1) as u16;
        let known = model.sensors.iter().fold(0, |mask, sensor| mask | 1 << sensor.channel);
        Self {
            sensors: model.sensors.iter().map(Ready::new).collect(),
            channels: model.channels,
            scale: model.wrench_scale,
            prior: model.load_precision.map(|row| row.map(|x| model.lambda * x)),
            noise: model.noise,
            dead: all & !known,
        }
    }

    /// The wrench of one frame of readings, in counts. Allocates nothing.
    ///
    /// # Panics
    /// If there are not as many readings as the model has channels.
    pub fn invert(&self, readings: &[f64]) -> Estimate {
        assert_eq!(readings.len(), self.channels, "one reading per channel");
        let mut frame = Frame { y: [0.0; MOST_CHANNELS], used: 0 };
        let mut left_out = self.dead;
        for (place, sensor) in self.sensors.iter().enumerate() {
            let y = (readings[sensor.channel] - sensor.least) * sensor.per_count;
            if y.is_finite() {
                (frame.y[place], frame.used) = (y, frame.used | 1 << place);
            } else {
                left_out |= 1 << sensor.channel;
            }
        }
        let mut state = self.state(&frame, self.start(&frame));
        let mut converged = false;
        let mut factor = None;
        for _ in 0..STEPS {
            let (curvature, descent) = self.normal_equations(&frame, &state);
            factor = Cholesky::new(&curvature);
            let Some(factor) = &factor else { break };
            let step = factor.solve(&descent);
            let length: f64 = step.iter().zip(&descent).map(|(s, d)| s * d).sum();
            state = self.advance(&frame, &state, &step);
            if length < REST {
                converged = true;
                break;
            }
        }
        self.estimate(&frame, &state, factor.as_ref(), left_out, converged)
    }

    fn estimate(
        &self,
        frame: &Frame,
        state: &State,
        factor: Option<&Cholesky<6>>,
        left_out: u16,
        converged: bool,
    ) -> Estimate {
        let (mut saturated, mut misfit) = (0, 0);
        for (place, sensor) in self.in_use(frame) {
            let bit = 1 << sensor.channel;
            saturated |= if state.slope[place] < sensor.flat { bit } else { 0 };
            let far = state.residual[place].powi(2) > FAR * FAR * state.variance[place];
            misfit |= if far { bit } else { 0 };
        }
        let standard_error = |axis: usize| {
            let unit = std::array::from_fn(|i| if i == axis { 1.0 } else { 0.0 });
            factor.map_or(f64::INFINITY, |f| f.quadratic(&unit).sqrt()) * self.scale[axis]
        };
        Estimate {
            wrench: std::array::from_fn(|axis| state.x[axis] * self.scale[axis]),
            standard_errors: std::array::from_fn(standard_error),
            saturated,
            left_out,
            misfit,
            converged,
        }
    }

    fn in_use<'a>(&'a self, frame: &Frame) -> impl Iterator<Item = (usize, &'a Ready)> {
        let used = frame.used;
        self.sensors.iter().enumerate().filter(move |(place, _)| used & (1 << place) != 0)
    }

    /// The wrench of the displacements that the readings alone say.
    fn start(&self, frame: &Frame) -> PerAxis<f64> {
        let (mut a, mut b) = (self.prior, [0.0; 6]);
        for (place, sensor) in self.in_use(frame) {
            let (q, slope) = displacement(frame.y[place], sensor.lo, sensor.h, sensor.nu, MARGIN);
            let variance = self.noise.variance(slope) + (START_NOISE * sensor.h).powi(2);
            let weight = slope * slope / variance;
            add(&mut a, &mut b, &sensor.gains, weight, weight * (q - sensor.offset));
        }
        Cholesky::new(&a).map_or([0.0; 6], |factor| factor.solve(&b))
    }

    #[inline]
    fn state(&self, frame: &Frame, x: PerAxis<f64>) -> State {
        let zero = [0.0; MOST_CHANNELS];
        let mut state = State { x, residual: zero, slope: zero, variance: zero };
        for (place, sensor) in self.in_use(frame) {
            let answer = sensor.answer(&x);
            state.residual[place] = frame.y[place] - answer.value;
            state.slope[place] = answer.slope;
            state.variance[place] =
                self.noise.variance(answer.slope) + sensor.parameter_variance(&answer, &x);
        }
        state
    }

    /// The curvature of half the sum and its descent.
    #[inline]
    fn normal_equations(
        &self,
        frame: &Frame,
        state: &State,
    ) -> (PerAxis<PerAxis<f64>>, PerAxis<f64>) {
        let mut a = self.prior;
        let mut b = self.prior.map(|row| -inner(&row, &state.x));
        for (place, sensor) in self.in_use(frame) {
            let (slope, weight) = (state.slope[place], state.variance[place].recip());
            let pull = weight * slope * state.residual[place];
            add(&mut a, &mut b, &sensor.gains, weight * slope * slope, pull);
        }
        (a, b)
    }

    /// A step on, or a part of it, that lowers the sum for the variances of `state`; without one,
    /// where it was.
    #[inline]
    fn advance(&self, frame: &Frame, state: &State, step: &PerAxis<f64>) -> State {
        let before = self.sum(frame, state, &state.variance);
        let mut share = 1.0_f64;
        for _ in 0..HALVINGS {
            let x = std::array::from_fn(|axis| share.mul_add(step[axis], state.x[axis]));
            let next = self.state(frame, x);
            if self.sum(frame, &next, &state.variance) <= before {
                return next;
            }
            share *= 0.5;
        }
        *state
    }

    #[inline]
    fn sum(&self, frame: &Frame, state: &State, variance: &[f64; MOST_CHANNELS]) -> f64 {
        let prior: f64 = (0..6).map(|i| state.x[i] * inner(&self.prior[i], &state.x)).sum();
        let square = |(place, _): (usize, &Ready)| state.residual[place].powi(2) / variance[place];
        self.in_use(frame).map(square).fold(prior, |sum, square| sum + square)
    }
}

#[inline]
fn inner(a: &PerAxis<f64>, b: &PerAxis<f64>) -> f64 {
    a.iter().zip(b).fold(0.0, |sum, (a, b)| a.mul_add(*b, sum))
}

/// `A += weight·g·gᵀ` (lower triangle), `b += pull·g`.
#[inline]
fn add(
    a: &mut PerAxis<PerAxis<f64>>,
    b: &mut PerAxis<f64>,
    gains: &PerAxis<f64>,
    weight: f64,
    pull: f64,
) {
    for i in 0..6 {
        b[i] = pull.mul_add(gains[i], b[i]);
        let weighted = weight * gains[i];
        for j in 0..=i {
            a[i][j] = weighted.mul_add(gains[j], a[i][j]);
        }
    }
}
