//! Powers of the readings times coefficients.

use super::Wrench;
use nalgebra::{SMatrixView, SVector};
use shared_proto::{AXES, CHANNELS, Cubic, FEATURES};

/// The wrench of a frame of readings in counts by a cubic calibration.
///
/// `w = C·φ(z) + c` in single precision, with `z = (r − centre) · scale` and the features
/// φ = (z1, z1², z1³, z2, …). Readings are 16-bit integers, exact in an `f32`, and z is of order
/// one, so what is lost is of the order of 25 roundings of the largest term: 3e-6 of it.
pub(super) fn wrench(calibration: &Cubic, readings: &[u16; CHANNELS]) -> Wrench {
    let Cubic { centre, scale, coefficients, intercept } = calibration;
    // Six numbers per feature, one feature after another: columns of a 6 × 24 matrix.
    let coefficients = coefficients.as_flattened();
    let coefficients = SMatrixView::<f32, AXES, FEATURES>::from_slice(coefficients);
    let mut features = SVector::<f32, FEATURES>::zeros();
    let columns = features.as_mut_slice().as_chunks_mut().0.iter_mut();
    let channels = readings.iter().zip(centre).zip(scale);
    for (powers, ((&reading, centre), scale)) in columns.zip(channels) {
        let z = (f32::from(reading) - centre) * scale;
        *powers = [z, z * z, z * z * z];
    }
    coefficients * features + Wrench::from_column_slice(intercept)
}
