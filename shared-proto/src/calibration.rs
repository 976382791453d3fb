//! The calibration that the board converts with, as it is uploaded and kept in flash.
//!
//! It is the `cubic` model in single precision: every reading r is made
//! `z = (r - centre) · scale`, and the wrench is the sum of z, z², z³ of each channel times their
//! coefficients, plus the intercept. A `linear` model is one whose other coefficients are zero.

use crate::bytes::Reader;
use crate::{AXES, CHANNELS};
use crc::{CRC_32_ISO_HDLC, Crc};

/// Features of the model: z, z², z³ of each channel, channel by channel.
pub const FEATURES: usize = 3 * CHANNELS;

/// Version of the layout: the first byte.
const LAYOUT: u8 = 1;

/// CRC-32 of a calibration in bytes (ISO-HDLC, that of zip and PNG).
///
/// Without a table: it is needed once per upload, and a table would take 1 KiB of flash.
pub fn crc32(bytes: &[u8]) -> u32 {
    Crc::<u32, crc::NoTable>::new(&CRC_32_ISO_HDLC).checksum(bytes)
}

/// A calibration for the board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// Centre of each channel, in counts of a sample's readings.
    pub centre: [f32; CHANNELS],
    /// One over the spread of each channel, in 1/count.
    pub scale: [f32; CHANNELS],
    /// Per feature (z1, z1², z1³, z2, …), the coefficients of Fx, Fy, Fz in N, Mx, My, Mz in N·m.
    pub coefficients: [[f32; AXES]; FEATURES],
    /// What is added to each axis, in N and N·m.
    pub intercept: [f32; AXES],
}

impl Calibration {
    /// Length in bytes: layout, channels, axes, a zero, and the numbers.
    pub const SIZE: usize = 4 + 4 * (2 * CHANNELS + FEATURES * AXES + AXES);

    /// The bytes to upload.
    pub fn to_bytes(&self) -> [u8; Self::SIZE] {
        let mut bytes = [0; Self::SIZE];
        let head = [LAYOUT, CHANNELS as u8, AXES as u8, 0].into_iter();
        let numbers = self
            .centre
            .iter()
            .chain(&self.scale)
            .chain(self.coefficients.as_flattened())
            .chain(&self.intercept)
            .flat_map(|number| number.to_le_bytes());
        bytes.iter_mut().zip(head.chain(numbers)).for_each(|(to, from)| *to = from);
        bytes
    }

    /// A calibration from its bytes; `None` if they have another layout or a number is not finite.
    pub fn from_bytes(bytes: &[u8; Self::SIZE]) -> Option<Self> {
        let mut rest = Reader(bytes);
        if rest.array()? != [LAYOUT, CHANNELS as u8, AXES as u8, 0] {
            return None;
        }
        let mut calibration = Self {
            centre: [0.0; CHANNELS],
            scale: [0.0; CHANNELS],
            coefficients: [[0.0; AXES]; FEATURES],
            intercept: [0.0; AXES],
        };
        let numbers = calibration
            .centre
            .iter_mut()
            .chain(&mut calibration.scale)
            .chain(calibration.coefficients.as_flattened_mut())
            .chain(&mut calibration.intercept);
        for number in numbers {
            *number = rest.f32().filter(|number| number.is_finite())?;
        }
        rest.end(calibration)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn calibration() -> Calibration {
        let mut coefficients = [[0.0; AXES]; FEATURES];
        for (i, value) in coefficients.as_flattened_mut().iter_mut().enumerate() {
            *value = i as f32 / 7.0;
        }
        Calibration { centre: [1e4; 8], scale: [1e-4; 8], coefficients, intercept: [-0.5; 6] }
    }

    #[test]
    fn bytes_and_back_is_the_same_calibration() {
        assert_eq!(Calibration::from_bytes(&calibration().to_bytes()), Some(calibration()));
    }

    #[test]
    fn another_layout_and_numbers_that_are_none_are_refused() {
        for (at, value) in [(0, 2), (1, 7), (2, 5), (3, 1)] {
            let mut bytes = calibration().to_bytes();
            bytes[at] = value;
            assert_eq!(Calibration::from_bytes(&bytes), None);
        }
        let mut bytes = calibration().to_bytes();
        bytes[4..8].copy_from_slice(&f32::NAN.to_le_bytes());
        assert_eq!(Calibration::from_bytes(&bytes), None);
    }

    #[test]
    fn crc32_has_the_check_value_of_its_catalogue_entry() {
        assert_eq!(crc32(b"123456789"), 0xCBF4_3926);
    }
}
