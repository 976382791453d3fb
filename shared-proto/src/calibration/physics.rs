//! The physics model in single precision: a curve for each sensor, and what inverting them needs.

use core::slice::from_mut;

use super::Range;
use crate::{AXES, CHANNELS};

/// Numbers in the lower triangle of the prior's precision, row by row.
pub const PRIOR: usize = AXES * (AXES + 1) / 2;

/// Parameters of a sensor: b, a (six), lo, ln h, ln ν.
const PARAMETERS: usize = AXES + 4;

/// Numbers in the lower triangle of a factor of their covariance, row by row.
pub const FACTOR: usize = PARAMETERS * (PARAMETERS + 1) / 2;

/// Curves of the sensors.
///
/// A sensor answers `y = low + height·σ(offset + gains·x)^shape` with `σ(q) = 1/(1 + e⁻ᵠ)`, where
/// `y = (r − least) · per_count` is its reading and `x` the wrench in units of `wrench_scale`. The wrench of a
/// frame minimises `Σ (y − f(x))²/v + xᵀPx` with `P` of `prior` and `v = reading_variance +
/// displacement_variance·(df/dq)² + |Lᵀg|²`, `g = df/d(b, a, lo, ln h, ln ν)`, `L` of `factor`.
#[derive(Clone, Debug, PartialEq)]
pub struct Physics {
    /// What a wrench is divided by, in N and N·m.
    pub wrench_scale: [f32; AXES],
    /// The precision of the prior of the wrench in these scales: lower triangle, row by row.
    pub prior: [f32; PRIOR],
    /// Variance of an answer `y`.
    pub reading_variance: f32,
    /// Variance of the displacement `offset + gains·x`.
    pub displacement_variance: f32,
    /// The sensor of each channel.
    pub sensors: [PhysicsSensor; CHANNELS],
}

/// One sensor of a [`Physics`]. One whose `per_count` is zero is left out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhysicsSensor {
    /// The reading that is zero in the scale of the curve, in counts of a sample's readings.
    pub least: f32,
    /// What a count is in that scale.
    pub per_count: f32,
    /// b: the displacement without a load.
    pub offset: f32,
    /// a: by how much a unit of each axis displaces.
    pub gains: [f32; AXES],
    /// The lower plateau.
    pub low: f32,
    /// h: the upper plateau above it.
    pub height: f32,
    /// ν: how unlike the curve is at its ends.
    pub shape: f32,
    /// `L` of the parameters' covariance `L·Lᵀ`: lower triangle, row by row.
    pub factor: [f32; FACTOR],
}

impl Physics {
    /// Its kind, the first byte.
    pub(super) const KIND: u8 = 2;

    /// Length in bytes.
    pub(super) const SIZE: usize = 4 + 4 * (AXES + PRIOR + 2 + CHANNELS * PhysicsSensor::NUMBERS);

    /// Without numbers.
    pub(super) const BLANK: Self = Self {
        wrench_scale: [0.0; AXES],
        prior: [0.0; PRIOR],
        reading_variance: 0.0,
        displacement_variance: 0.0,
        sensors: [PhysicsSensor::NONE; CHANNELS],
    };

    /// Calls `number` for each of its numbers in their order, with the range that it is in, until one is not taken.
    ///
    /// What the board computes with stays finite in single precision while the numbers are within these ranges. They
    /// are far from those of any sensor: the scales of the model make all that it fits of order one.
    pub(super) fn each(
        &mut self,
        mut number: impl FnMut(&mut f32, &Range) -> Option<()>,
    ) -> Option<()> {
        let mut all = |numbers: &mut [f32], range: Range| {
            numbers.iter_mut().try_for_each(|value| number(value, &range))
        };
        all(&mut self.wrench_scale, 1e-9..=1e9)?;
        all(&mut self.prior, -1e12..=1e12)?;
        all(from_mut(&mut self.reading_variance), 1e-12..=1e6)?;
        all(from_mut(&mut self.displacement_variance), 0.0..=1e6)?;
        for sensor in &mut self.sensors {
            all(from_mut(&mut sensor.least), -1e6..=1e6)?;
            all(from_mut(&mut sensor.per_count), 0.0..=1.0)?;
            all(from_mut(&mut sensor.offset), -1e4..=1e4)?;
            all(&mut sensor.gains, -1e4..=1e4)?;
            all(from_mut(&mut sensor.low), -1e3..=1e3)?;
            all(from_mut(&mut sensor.height), 1e-3..=1e3)?;
            all(from_mut(&mut sensor.shape), 1e-3..=1e3)?;
            all(&mut sensor.factor, -1e4..=1e4)?;
        }
        Some(())
    }
}

impl PhysicsSensor {
    /// Numbers of a sensor.
    const NUMBERS: usize = 2 + PARAMETERS + FACTOR;

    /// A channel that is left out.
    pub const NONE: Self = Self {
        least: 0.0,
        per_count: 0.0,
        offset: 0.0,
        gains: [0.0; AXES],
        low: 0.0,
        height: 1.0,
        shape: 1.0,
        factor: [0.0; FACTOR],
    };
}
