//! A sensor made ready to be inverted.

use super::MOST_UNKNOWNS;
use crate::physics::model::Sensor;
use crate::physics::noise::Noise;
use crate::physics::response::{PARAMETERS, Parameters, SHAPE, displacement};

/// How near the plateaus, in shares of h, the start takes a reading.
const MARGIN: f64 = 0.01;

/// What noise of readings the start allows for, in shares of h.
const START_NOISE: f64 = 0.02;

/// A sensor whose curve is flatter than this share of its steepest is on a plateau.
const FLAT: f64 = 0.05;

/// Steps of the tables that a start is read from: it is off by less than a hundredth of q.
const TABLE_STEPS: usize = 128;

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Ready {
    pub(super) channel: usize,
    pub(super) least: f64,
    pub(super) per_count: f64,
    pub(super) offset: f64,
    /// a, and then c.
    pub(super) gains: [f64; MOST_UNKNOWNS],
    pub(super) lo: f64,
    pub(super) h: f64,
    pub(super) nu: f64,
    /// Of the parameters, the lower triangle, with twice what is off its diagonal.
    pub(super) covariance: [Parameters; PARAMETERS],
    /// `dy/dq` below which the curve is flat.
    pub(super) flat: f64,
    /// At even shares of the way from plateau to plateau: `q − b`, and its weight in the start.
    table: Vec<(f64, f64)>,
}

impl Ready {
    pub(super) fn new(sensor: &Sensor, noise: &Noise) -> Self {
        let p = &sensor.parameters;
        let (lo, h, nu) = (p[SHAPE], libm::exp(p[SHAPE + 1]), libm::exp(p[SHAPE + 2]));
        // dy/dq = h·ν·σ^ν·(1 − σ) is steepest where σ = ν/(1 + ν).
        let steepest = h * nu * libm::pow(nu / (1.0 + nu), nu) / (1.0 + nu);
        let entry = |step: usize| {
            let share = step as f64 / TABLE_STEPS as f64;
            let (q, slope) = displacement(h.mul_add(share, lo), lo, h, nu, MARGIN);
            let variance = noise.variance(slope) + (START_NOISE * h).powi(2);
            (q - p[0], slope * slope / variance)
        };
        let mut covariance = sensor.covariance;
        for (i, row) in covariance.iter_mut().enumerate() {
            row[..i].iter_mut().for_each(|c| *c *= 2.0);
        }
        Self {
            channel: sensor.channel,
            least: sensor.least,
            per_count: sensor.range.recip(),
            offset: p[0],
            gains: std::array::from_fn(|i| if i < 6 { p[1 + i] } else { sensor.loadings[i - 6] }),
            lo,
            h,
            nu,
            covariance,
            flat: FLAT * steepest,
            table: (0..=TABLE_STEPS).map(entry).collect(),
        }
    }

    /// A reading, in counts, in ranges above the least.
    #[inline]
    pub(super) fn scaled(&self, reading: f64) -> f64 {
        (reading - self.least) * self.per_count
    }

    /// The displacement less b that a scaled reading says by itself, and the weight of that.
    #[inline]
    pub(super) fn start(&self, y: f64) -> (f64, f64) {
        let position = ((y - self.lo) / self.h).clamp(0.0, 1.0) * TABLE_STEPS as f64;
        let step = (position as usize).min(TABLE_STEPS - 1);
        let (share, (q0, w0), (q1, w1)) =
            (position - step as f64, self.table[step], self.table[step + 1]);
        (share.mul_add(q1 - q0, q0), share.mul_add(w1 - w0, w0))
    }
}
