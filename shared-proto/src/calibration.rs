//! The calibration that the board converts with, in its format for upload and flash.
//!
//! The first byte is the kind. A board refuses an unknown kind when the upload begins if no known
//! kind has its size, otherwise at the end.

use crate::field::{Bytes, Field, Reader, fields};
use crate::{AXES, CHANNELS};
use core::ops::RangeInclusive;
use crc::{CRC_32_ISO_HDLC, Crc};

/// Returns the CRC-32 (ISO-HDLC, as in zip and PNG). A table would take 1 KiB of flash.
pub fn crc32(bytes: &[u8]) -> u32 {
    Crc::<u32, crc::NoTable>::new(&CRC_32_ISO_HDLC).checksum(bytes)
}

/// A calibration for the board.
#[derive(Clone, Debug, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "the board has no heap to put one on")]
pub enum Calibration {
    /// Powers of the readings; a linear model has zeros for the higher coefficients.
    Cubic(Cubic),
    /// Response curves of the sensors, which the board inverts.
    Physics(Physics),
}

impl Calibration {
    /// Length of the longest calibration in bytes.
    pub const MAX_SIZE: usize = Physics::SIZE;

    /// Returns the name of the calibration's kind.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Cubic(_) => "cubic",
            Self::Physics(_) => "physics",
        }
    }

    /// Returns true if a kind of calibration has `size` bytes.
    pub fn is_size(size: usize) -> bool {
        [Cubic::SIZE, Physics::SIZE].contains(&size)
    }

    /// Returns the bytes to upload: kind, channels, axes, a zero, and the numbers.
    pub fn to_bytes(&self) -> CalibrationBytes {
        let mut bytes = CalibrationBytes::new();
        match self {
            Self::Cubic(cubic) => {
                bytes.extend(&head(Cubic::KIND));
                cubic.write(&mut bytes);
            }
            Self::Physics(physics) => {
                bytes.extend(&head(Physics::KIND));
                physics.write(&mut bytes);
            }
        }
        bytes
    }

    /// Parses a calibration; `None` if the kind is unknown or a number is out of range.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let mut rest = Reader(bytes);
        let kind: [u8; 4] = rest.get()?;
        let calibration = if kind == head(Cubic::KIND) {
            Self::Cubic(rest.get().filter(Cubic::is_usable)?)
        } else if kind == head(Physics::KIND) {
            Self::Physics(rest.get().filter(Physics::is_usable)?)
        } else {
            return None;
        };
        rest.end(calibration)
    }
}

fn head(kind: u8) -> [u8; 4] {
    [kind, CHANNELS as u8, AXES as u8, 0]
}

/// The bytes of a calibration.
pub type CalibrationBytes = Bytes<{ Calibration::MAX_SIZE }>;

/// Features of the cubic model: z, z², z³ of each channel, channel by channel.
pub const FEATURES: usize = 3 * CHANNELS;

/// A model of powers of the readings. A reading r becomes `z = (r - centre) · scale`. The wrench is
/// the sum of z, z², z³ of each channel times their coefficients, plus the intercept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cubic {
    /// Centre of each channel, in counts of a sample's readings.
    pub centre: [f32; CHANNELS],
    /// Reciprocal of each channel's spread, in 1/count.
    pub scale: [f32; CHANNELS],
    /// Coefficients of Fx, Fy, Fz in N, Mx, My, Mz in N·m, for each feature (z1, z1², z1³, z2, …).
    pub coefficients: [[f32; AXES]; FEATURES],
    /// Constant term of each axis, in N and N·m.
    pub intercept: [f32; AXES],
}

impl Cubic {
    const KIND: u8 = 1;

    const SIZE: usize = 4 + 4 * (2 * CHANNELS + FEATURES * AXES + AXES);

    fn is_usable(&self) -> bool {
        let Self { centre, scale, coefficients, intercept } = self;
        let parts = [&centre[..], scale, coefficients.as_flattened(), intercept];
        parts.into_iter().flatten().all(|value| value.is_finite())
    }
}

fields!(Cubic { centre, scale, coefficients, intercept });

/// Numbers in the lower triangle of the prior's precision.
pub const PRIOR: usize = AXES * (AXES + 1) / 2;

/// Number of parameters of a sensor: b, a (six), lo, ln h, ln ν.
const PARAMETERS: usize = AXES + 4;

/// Numbers in the lower triangle of a factor of the parameters' covariance.
pub const FACTOR: usize = PARAMETERS * (PARAMETERS + 1) / 2;

/// Response curves of the sensors.
///
/// A sensor's scaled reading `y = (r − least) · per_count` is `low + height·σ(offset +
/// gains·x)^shape` with `σ(q) = 1/(1 + e⁻ᵠ)` and `x` the wrench in units of `wrench_scale`. The
/// wrench of a frame minimises `Σ (y − f(x))²/v + xᵀPx` with `P` from `prior` and `v =
/// reading_variance + displacement_variance·(df/dq)² + |Lᵀg|²`, `g = df/d(b, a, lo, ln h, ln ν)`,
/// `L` from `factor`.
#[derive(Clone, Debug, PartialEq)]
pub struct Physics {
    /// Scale of the wrench, in N and N·m.
    pub wrench_scale: [f32; AXES],
    /// Precision of the wrench's prior in these scales: lower triangle, row by row.
    pub prior: [f32; PRIOR],
    /// Variance of a response `y`.
    pub reading_variance: f32,
    /// Variance of the displacement `offset + gains·x`.
    pub displacement_variance: f32,
    /// The sensor of each channel.
    pub sensors: [PhysicsSensor; CHANNELS],
}

/// One sensor of a [`Physics`]; it is left out if `per_count` is zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhysicsSensor {
    /// Reading that is zero on the scale of the curve, in counts.
    pub least: f32,
    /// Size of a count on that scale.
    pub per_count: f32,
    /// b: the displacement without load.
    pub offset: f32,
    /// a: displacement per unit of each axis.
    pub gains: [f32; AXES],
    /// The lower plateau.
    pub low: f32,
    /// h: height of the upper plateau above the lower.
    pub height: f32,
    /// ν: asymmetry of the curve between its ends.
    pub shape: f32,
    /// `L` of the parameters' covariance `L·Lᵀ`: lower triangle, row by row.
    pub factor: [f32; FACTOR],
}

impl Physics {
    const KIND: u8 = 2;

    const SIZE: usize = 4 + 4 * (AXES + PRIOR + 2 + CHANNELS * PhysicsSensor::NUMBERS);

    /// Returns true if all numbers are in ranges in which the board's computation is finite in single precision. They
    /// are far wider than any sensor needs.
    fn is_usable(&self) -> bool {
        let all = |numbers: &[f32], range: RangeInclusive<f32>| {
            numbers.iter().all(|number| range.contains(number))
        };
        all(&self.wrench_scale, 1e-9..=1e9)
            && all(&self.prior, -1e12..=1e12)
            && (1e-12..=1e6).contains(&self.reading_variance)
            && (0.0..=1e6).contains(&self.displacement_variance)
            && self.sensors.iter().all(|sensor| {
                (-1e6..=1e6).contains(&sensor.least)
                    && (0.0..=1.0).contains(&sensor.per_count)
                    && (-1e4..=1e4).contains(&sensor.offset)
                    && all(&sensor.gains, -1e4..=1e4)
                    && (-1e3..=1e3).contains(&sensor.low)
                    && (1e-3..=1e3).contains(&sensor.height)
                    && (1e-3..=1e3).contains(&sensor.shape)
                    && all(&sensor.factor, -1e4..=1e4)
            })
    }
}

fields!(Physics { wrench_scale, prior, reading_variance, displacement_variance, sensors });
fields!(PhysicsSensor { least, per_count, offset, gains, low, height, shape, factor });

impl PhysicsSensor {
    const NUMBERS: usize = 2 + PARAMETERS + FACTOR;
}

/// A channel that is left out.
impl Default for PhysicsSensor {
    fn default() -> Self {
        Self {
            least: 0.0,
            per_count: 0.0,
            offset: 0.0,
            gains: [0.0; AXES],
            low: 0.0,
            height: 1.0,
            shape: 1.0,
            factor: [0.0; FACTOR],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cubic() -> Calibration {
        let mut coefficients = [[0.0; AXES]; FEATURES];
        for (i, value) in coefficients.as_flattened_mut().iter_mut().enumerate() {
            *value = i as f32 / 7.0;
        }
        let cubic =
            Cubic { centre: [1e4; 8], scale: [1e-4; 8], coefficients, intercept: [-0.5; 6] };
        Calibration::Cubic(cubic)
    }

    fn physics() -> Calibration {
        let sensor = |i: usize| PhysicsSensor {
            least: 3_000.0 + i as f32,
            per_count: 1e-4,
            offset: 0.25,
            gains: core::array::from_fn(|axis| (axis * i) as f32 / 8.0 - 1.0),
            low: -0.05,
            height: 1.1,
            shape: 0.75,
            factor: core::array::from_fn(|k| k as f32 / 512.0),
        };
        Calibration::Physics(Physics {
            wrench_scale: [2.0, 3.0, 4.0, 0.1, 0.2, 0.3],
            prior: core::array::from_fn(|k| k as f32),
            reading_variance: 1e-4,
            displacement_variance: 0.0,
            sensors: core::array::from_fn(sensor),
        })
    }

    #[test]
    fn bytes_and_back_is_the_same_calibration() {
        for (calibration, size) in [(cubic(), 668), (physics(), 2_264)] {
            let bytes = calibration.to_bytes();
            assert_eq!(bytes.len(), size);
            assert!(Calibration::is_size(size) && size <= Calibration::MAX_SIZE);
            assert_eq!(Calibration::from_bytes(&bytes), Some(calibration));
        }
    }

    #[test]
    fn other_kinds_lengths_and_numbers_that_are_none_are_refused() {
        for calibration in [cubic(), physics()] {
            let bytes = calibration.to_bytes();
            for (at, value) in [(0, 3), (1, 7), (2, 5), (3, 1)] {
                let mut bytes = bytes;
                bytes.as_mut_slice()[at] = value;
                assert_eq!(Calibration::from_bytes(&bytes), None);
            }
            for number in [f32::NAN, f32::INFINITY] {
                let mut bytes = bytes;
                bytes.as_mut_slice()[4..8].copy_from_slice(&number.to_le_bytes());
                assert_eq!(Calibration::from_bytes(&bytes), None);
            }
            assert_eq!(Calibration::from_bytes(&bytes[..bytes.len() - 1]), None);
        }
        let mut bytes = physics().to_bytes();
        bytes.as_mut_slice()[0] = Cubic::KIND;
        assert_eq!(Calibration::from_bytes(&bytes), None);
        assert_eq!(Calibration::from_bytes(&[]), None);
    }

    #[test]
    fn numbers_that_the_board_could_not_compute_with_are_refused() {
        let Calibration::Physics(good) = physics() else { panic!() };
        let change = |change: &dyn Fn(&mut Physics)| {
            let mut physics = good.clone();
            change(&mut physics);
            Calibration::from_bytes(&Calibration::Physics(physics).to_bytes())
        };
        assert!(change(&|_| ()).is_some());
        assert!(change(&|it| it.sensors[3].per_count = 0.0).is_some());
        assert_eq!(change(&|it| it.wrench_scale[0] = 0.0), None);
        assert_eq!(change(&|it| it.prior[20] = 1e13), None);
        assert_eq!(change(&|it| it.reading_variance = 0.0), None);
        assert_eq!(change(&|it| it.displacement_variance = -1e-9), None);
        assert_eq!(change(&|it| it.sensors[7].per_count = -1e-4), None);
        assert_eq!(change(&|it| it.sensors[7].least = 1e7), None);
        assert_eq!(change(&|it| it.sensors[7].gains[5] = -1e5), None);
        assert_eq!(change(&|it| it.sensors[7].height = 0.0), None);
        assert_eq!(change(&|it| it.sensors[7].shape = 1e4), None);
        assert_eq!(change(&|it| it.sensors[7].factor[54] = 1e5), None);
    }

    #[test]
    fn crc32_has_the_check_value_of_its_catalogue_entry() {
        assert_eq!(crc32(b"123456789"), 0xCBF4_3926);
    }
}
