//! Powers of the readings times coefficients.

use super::Wrench;
use nalgebra::{SMatrix, SVector};
use shared_proto::{AXES, CHANNELS, Cubic, FEATURES};

/// Applies a cubic calibration.
///
/// `w = C·φ(z) + c` in single precision, with `z = (r − centre) · scale` and the features
/// φ = (z1, z1², z1³, z2, …). Readings are 16-bit integers, exact in an `f32`, and z is of order
/// one, so what is lost is of the order of 25 roundings of the largest term: 3e-6 of it.
#[derive(Clone, Debug)]
pub(super) struct Powers {
    centre: [f32; CHANNELS],
    scale: [f32; CHANNELS],
    coefficients: SMatrix<f32, AXES, FEATURES>,
    intercept: Wrench,
}

impl Powers {
    pub(super) fn new(calibration: &Cubic) -> Self {
        let Cubic { centre, scale, coefficients, intercept } = calibration;
        Self {
            centre: *centre,
            scale: *scale,
            // Six numbers per feature, one feature after another: columns of a 6 × 24 matrix.
            coefficients: SMatrix::from_column_slice(coefficients.as_flattened()),
            intercept: Wrench::from_column_slice(intercept),
        }
    }

    /// The wrench of a frame of readings in counts.
    #[expect(clippy::op_ref, reason = "the matrix is 576 bytes long, and would be copied")]
    pub(super) fn wrench(&self, readings: &[u16; CHANNELS]) -> Wrench {
        let mut features = SVector::<f32, FEATURES>::zeros();
        let columns = features.as_mut_slice().chunks_exact_mut(3);
        let channels = readings.iter().zip(&self.centre).zip(&self.scale);
        for (powers, ((&reading, centre), scale)) in columns.zip(channels) {
            let z = (f32::from(reading) - centre) * scale;
            powers.copy_from_slice(&[z, z * z, z * z * z]);
        }
        &self.coefficients * features + self.intercept
    }
}
