//! The calibration that the board converts with, as it is uploaded and kept in flash.
//!
//! The first byte is the kind. A board that does not know a kind refuses it: for its size when an upload
//! begins, or else for what it is at the end.

mod cubic;
mod physics;

pub use self::cubic::{Cubic, FEATURES};
pub use self::physics::{FACTOR, PRIOR, Physics, PhysicsSensor};

use crate::bytes::Bytes;
use crate::field::{Field, Reader};
use crate::{AXES, CHANNELS};
use core::ops::RangeInclusive;
use crc::{CRC_32_ISO_HDLC, Crc};

/// The range that a number must be in.
type Range = RangeInclusive<f32>;

/// CRC-32 of a calibration in bytes (ISO-HDLC, that of zip and PNG).
///
/// Without a table: it is needed once per upload, and a table would take 1 KiB of flash.
pub fn crc32(bytes: &[u8]) -> u32 {
    Crc::<u32, crc::NoTable>::new(&CRC_32_ISO_HDLC).checksum(bytes)
}

/// A calibration for the board.
#[derive(Clone, Debug, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "the board has no heap to put one on")]
pub enum Calibration {
    /// Powers of the readings; a linear model is one whose other coefficients are zero.
    Cubic(Cubic),
    /// Curves of the sensors, which are inverted for the wrench.
    Physics(Physics),
}

impl Calibration {
    /// Length of the longest in bytes.
    pub const MAX_SIZE: usize = Physics::SIZE;

    /// The name of its kind.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Cubic(_) => "cubic",
            Self::Physics(_) => "physics",
        }
    }

    /// Whether some calibration has so many bytes.
    pub fn is_size(size: usize) -> bool {
        [Cubic::SIZE, Physics::SIZE].contains(&size)
    }

    /// The bytes to upload: kind, channels, axes, a zero, and the numbers.
    pub fn to_bytes(&self) -> CalibrationBytes {
        let mut bytes = CalibrationBytes::new();
        let mut calibration = self.clone();
        bytes.extend(&head(match self {
            Self::Cubic(_) => Cubic::KIND,
            Self::Physics(_) => Physics::KIND,
        }));
        // The visitor accepts every number.
        _ = calibration.each(|number, _| {
            number.write(&mut bytes);
            Some(())
        });
        bytes
    }

    /// A calibration from its bytes; `None` if they are of another kind or a number is not one that
    /// a calibration can have.
    ///
    /// The numbers are written where they stay: a copy takes 2 KiB of the board's stack.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let mut rest = Reader(bytes);
        let kind = rest.array()?;
        let mut calibration = if kind == head(Cubic::KIND) {
            Self::Cubic(Cubic::BLANK)
        } else if kind == head(Physics::KIND) {
            Self::Physics(Physics::BLANK)
        } else {
            return None;
        };
        calibration.each(|number, range| {
            *number = rest.get().filter(|number| range.contains(number))?;
            Some(())
        })?;
        rest.end(calibration)
    }

    /// Calls `number` for each number in its order, with the range that it is in, until one is not taken.
    fn each(&mut self, number: impl FnMut(&mut f32, &Range) -> Option<()>) -> Option<()> {
        match self {
            Self::Cubic(cubic) => cubic.each(number),
            Self::Physics(physics) => physics.each(number),
        }
    }
}

fn head(kind: u8) -> [u8; 4] {
    [kind, CHANNELS as u8, AXES as u8, 0]
}

/// The bytes of a calibration.
pub type CalibrationBytes = Bytes<{ Calibration::MAX_SIZE }>;

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
        // A sensor that is left out.
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
