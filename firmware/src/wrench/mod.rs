//! Conversion of readings to a wrench on the board.

mod physics;

use nalgebra::{SMatrixView, SVector};
use shared_proto::{AXES, CHANNELS, Calibration, Cubic, FEATURES};

type Wrench = SVector<f32, AXES>;

/// Applies a calibration and a zero, in single precision.
#[derive(Clone, Debug)]
pub struct Converter {
    calibration: Calibration,
    zero: Option<Wrench>,
    taring: Option<Taring>,
}

#[derive(Clone, Debug)]
struct Taring {
    mean: Wrench,
    taken: u16,
    frames: u16,
}

impl Converter {
    pub fn new(calibration: Calibration) -> Self {
        Self { calibration, zero: None, taring: None }
    }

    /// Returns Fx, Fy, Fz in N and Mx, My, Mz in N·m for readings in counts.
    ///
    /// Channels in `saturated` are unreliable; only a physics calibration can leave them out. A
    /// frame contributes to a zero that is being taken.
    pub fn convert(&mut self, readings: &[u16; CHANNELS], saturated: u8) -> [f32; AXES] {
        let wrench = match &self.calibration {
            Calibration::Cubic(cubic) => cubic_wrench(cubic, readings),
            Calibration::Physics(model) => physics::invert(model, readings, saturated).into(),
        };
        self.tare(wrench);
        (wrench - self.zero.unwrap_or_default()).into()
    }

    /// Takes the mean of the next `frames` wrenches as zero; 0 removes the zero.
    pub fn start_zero(&mut self, frames: u16) {
        self.taring = (frames > 0).then(|| Taring { mean: Wrench::zeros(), taken: 0, frames });
        if frames == 0 {
            self.zero = None;
        }
    }

    pub fn is_zeroed(&self) -> bool {
        self.zero.is_some()
    }

    /// Returns true while a zero is being taken, which needs converted frames.
    pub fn is_taring(&self) -> bool {
        self.taring.is_some()
    }

    fn tare(&mut self, wrench: Wrench) {
        let Some(taring) = &mut self.taring else { return };
        taring.taken += 1;
        taring.mean += (wrench - taring.mean) / f32::from(taring.taken);
        if taring.taken == taring.frames {
            self.zero = Some(taring.mean);
            self.taring = None;
        }
    }
}

/// Computes `w = C·φ(z) + c` in single precision, with `z = (r − centre) · scale` and the features
/// φ = (z1, z1², z1³, z2, …). 16-bit readings are exact in an `f32`, and z is of order one, so the
/// error is about 25 roundings of the largest term: 3e-6 of it.
fn cubic_wrench(calibration: &Cubic, readings: &[u16; CHANNELS]) -> Wrench {
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

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use proptest::prelude::*;
    use shared_proto::{Cubic, FEATURES};

    fn cubic() -> Cubic {
        let mut coefficients = [[0.0; AXES]; FEATURES];
        for (feature, row) in coefficients.iter_mut().enumerate() {
            for (axis, value) in row.iter_mut().enumerate() {
                *value = ((feature * 6 + axis) as f32 * 0.7).sin();
            }
        }
        let centre = [20_000.0, 30_000.0, 40_000.0, 33_333.0, 1.5, 9_999.0, 50_000.0, 25_000.0];
        let scale = [1e-4, 9e-5, 8e-5, 2e-4, 3e-5, 1e-4, 1e-4, 5e-5];
        Cubic { centre, scale, coefficients, intercept: [0.5, -1.0, 0.25, 0.0, 1e-3, 2.0] }
    }

    fn converter() -> Converter {
        Converter::new(Calibration::Cubic(cubic()))
    }

    /// The formula, term by term, in double precision.
    fn wrench(calibration: &Cubic, readings: &[u16; CHANNELS]) -> ([f64; AXES], f64) {
        let (mut wrench, mut largest) = ([0.0; AXES], 0.0_f64);
        for (axis, value) in wrench.iter_mut().enumerate() {
            *value = f64::from(calibration.intercept[axis]);
            for (channel, &reading) in readings.iter().enumerate() {
                let offset = f64::from(reading) - f64::from(calibration.centre[channel]);
                let z = offset * f64::from(calibration.scale[channel]);
                for power in 0..3 {
                    let coefficient = calibration.coefficients[3 * channel + power][axis];
                    let term = f64::from(coefficient) * z.powi(power as i32 + 1);
                    largest = largest.max(term.abs());
                    *value += term;
                }
            }
        }
        (wrench, largest)
    }

    proptest! {
        #[test]
        fn wrenches_equal_those_of_the_formula(readings: [u16; CHANNELS]) {
            let (expected, largest) = wrench(&cubic(), &readings);
            let actual = converter().convert(&readings, 0);
            for (actual, expected) in actual.into_iter().zip(expected) {
                // 25 terms, each rounded, and sums of at most 25 times the largest term.
                let tolerance = 25.0 * f64::from(f32::EPSILON) * largest.max(1.0);
                prop_assert!((f64::from(actual) - expected).abs() < tolerance);
            }
        }
    }

    #[test]
    fn the_zero_is_the_mean_of_the_frames_asked_for() {
        let mut converter = converter();
        let (a, b) = ([20_000; CHANNELS], [20_100; CHANNELS]);
        let (before_a, before_b) = (converter.convert(&a, 0), converter.convert(&b, 0));
        converter.start_zero(2);
        assert!(converter.is_taring() && !converter.is_zeroed());
        assert_eq!(converter.convert(&a, 0), before_a);
        converter.convert(&b, 0);
        assert!(!converter.is_taring() && converter.is_zeroed());
        for axis in 0..AXES {
            let mean = (before_a[axis] + before_b[axis]) / 2.0;
            assert!((converter.convert(&a, 0)[axis] - (before_a[axis] - mean)).abs() < 1e-5);
        }
        converter.start_zero(0);
        assert_eq!(converter.convert(&a, 0), before_a);
        assert!(!converter.is_zeroed());
    }

    #[test]
    fn a_second_zero_replaces_the_first() {
        let mut converter = converter();
        let readings = [12_345; CHANNELS];
        for _ in 0..3 {
            converter.start_zero(1);
            assert_eq!(converter.convert(&readings, 0), [0.0; AXES]);
        }
    }
}
