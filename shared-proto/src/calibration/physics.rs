//! The physics model in single precision: a curve for each sensor, and what inverting them needs.

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

/// What the board computes with stays finite in single precision while the numbers are within these. They are far
/// from those of any sensor: the scales of the model make all that it fits of order one.
mod range {
    use core::ops::RangeInclusive;

    pub(super) const WRENCH_SCALE: RangeInclusive<f32> = 1e-9..=1e9;
    pub(super) const PRIOR: RangeInclusive<f32> = -1e12..=1e12;
    pub(super) const READING_VARIANCE: RangeInclusive<f32> = 1e-12..=1e6;
    pub(super) const DISPLACEMENT_VARIANCE: RangeInclusive<f32> = 0.0..=1e6;
    pub(super) const LEAST: RangeInclusive<f32> = -1e6..=1e6;
    pub(super) const PER_COUNT: RangeInclusive<f32> = 0.0..=1.0;
    pub(super) const DISPLACEMENT: RangeInclusive<f32> = -1e4..=1e4;
    pub(super) const LOW: RangeInclusive<f32> = -1e3..=1e3;
    pub(super) const CURVE: RangeInclusive<f32> = 1e-3..=1e3;
    pub(super) const FACTOR: RangeInclusive<f32> = -1e4..=1e4;
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

    /// Its numbers in their order.
    pub(super) fn each(&self, mut number: impl FnMut(f32)) {
        let mut all = |part: &[f32]| part.iter().for_each(|&value| number(value));
        all(&self.wrench_scale);
        all(&self.prior);
        all(&[self.reading_variance, self.displacement_variance]);
        for sensor in &self.sensors {
            all(&[sensor.least, sensor.per_count, sensor.offset]);
            all(&sensor.gains);
            all(&[sensor.low, sensor.height, sensor.shape]);
            all(&sensor.factor);
        }
    }

    /// Takes its numbers in their order; `None` if one is missing or outside its range; what was taken before is then to be dropped.
    pub(super) fn fill(&mut self, numbers: &mut impl FnMut() -> Option<f32>) -> Option<()> {
        let mut within = |range: core::ops::RangeInclusive<f32>| {
            numbers().filter(|number| range.contains(number))
        };
        for scale in &mut self.wrench_scale {
            *scale = within(range::WRENCH_SCALE)?;
        }
        for precision in &mut self.prior {
            *precision = within(range::PRIOR)?;
        }
        self.reading_variance = within(range::READING_VARIANCE)?;
        self.displacement_variance = within(range::DISPLACEMENT_VARIANCE)?;
        for sensor in &mut self.sensors {
            sensor.least = within(range::LEAST)?;
            sensor.per_count = within(range::PER_COUNT)?;
            sensor.offset = within(range::DISPLACEMENT)?;
            for gain in &mut sensor.gains {
                *gain = within(range::DISPLACEMENT)?;
            }
            sensor.low = within(range::LOW)?;
            sensor.height = within(range::CURVE)?;
            sensor.shape = within(range::CURVE)?;
            for number in &mut sensor.factor {
                *number = within(range::FACTOR)?;
            }
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
