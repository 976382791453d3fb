//! The reference sensor that a calibration is recorded against.
//!
//! It measures the wrench in its own axes, which stand nearly but not quite on the shell's: a turn
//! and a shift from its mounting, a zero that was not quite zero, noise, and its own resolution.

use shell_data::wrench::{PerAxis, cross};

use super::geometry::RigidMotion;
use super::parameters::Reference;
use shell_data::random::{Purpose, RandomStream};

/// A reference sensor, mounted for one recording.
#[derive(Clone, Debug)]
pub struct ReferenceSensor {
    parameters: Reference,
    turn: RigidMotion,
    shift_m: [f64; 3],
    zero: PerAxis<f64>,
    noise: RandomStream,
}

impl ReferenceSensor {
    /// Mounts the sensor for the recording that `seed` names.
    pub fn new(parameters: &Reference, seed: u64) -> Self {
        let mut mounting = RandomStream::new(seed, Purpose::Mounting, 0);
        let mut draw = |scale: f64| scale * mounting.normal();
        let [x, y, z] = std::array::from_fn(|_| draw(parameters.turn_rad));
        let shift_m = std::array::from_fn(|_| draw(parameters.shift_m));
        let zero = std::array::from_fn(|axis| draw(parameters.zero[axis / 3]));
        Self {
            parameters: *parameters,
            turn: RigidMotion::new(&[0.0, 0.0, 0.0, x, y, z]),
            shift_m,
            zero,
            noise: RandomStream::new(seed, Purpose::Reference, 0),
        }
    }

    /// The reading under `wrench` (N and N·m, shell frame): a whole number of the sensor's steps.
    pub fn sample(&mut self, wrench: &PerAxis<f64>) -> PerAxis<f64> {
        let &[fx, fy, fz, mx, my, mz] = wrench;
        // About an origin shifted by r the moment is less by r × F.
        let [less_x, less_y, less_z] = cross(self.shift_m, [fx, fy, fz]);
        let moment = [mx - less_x, my - less_y, mz - less_z];
        let force = self.turn.turn(&[fx, fy, fz]);
        let moment = self.turn.turn(&moment);
        std::array::from_fn(|axis| {
            let (kind, position) = (axis / 3, axis % 3);
            let true_value = [force, moment][kind][position] + self.zero[axis];
            let step = self.parameters.resolution[kind];
            let value = true_value + self.parameters.noise[kind] * self.noise.normal();
            // Adding zero turns a negative zero into zero.
            (value / step).round() * step + 0.0
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor_model::SensorParameters;

    fn ideal() -> Reference {
        let nominal = SensorParameters::nominal().reference;
        Reference { noise: [0.0; 2], zero: [0.0; 2], turn_rad: 0.0, shift_m: 0.0, ..nominal }
    }

    #[test]
    fn a_perfect_mounting_reads_the_wrench_to_half_a_step() {
        let mut sensor = ReferenceSensor::new(&ideal(), 1);
        let wrench = [1.2345, -2.3456, 0.777, 0.0123, -0.0234, 0.0345];
        for (axis, (read, truth)) in sensor.sample(&wrench).into_iter().zip(wrench).enumerate() {
            let step = ideal().resolution[axis / 3];
            assert!((read - truth).abs() <= 0.5000001 * step);
            assert!((read / step - (read / step).round()).abs() < 1e-9);
        }
    }

    #[test]
    fn a_mounting_with_no_zero_error_keeps_the_size_of_the_force() {
        let parameters = Reference { turn_rad: 0.3, resolution: [1e-9; 2], ..ideal() };
        let mut sensor = ReferenceSensor::new(&parameters, 2);
        let read = sensor.sample(&[1.0, 2.0, 2.0, 0.0, 0.0, 0.0]);
        let size = read[..3].iter().map(|f| f * f).sum::<f64>().sqrt();
        assert!((size - 3.0).abs() < 1e-8);
        assert!((read[0] - 1.0).abs() > 0.01);
    }

    #[test]
    fn noise_has_the_size_that_the_parameters_say() {
        let noise = [0.1, 0.01];
        let mut sensor = ReferenceSensor::new(&Reference { noise, ..ideal() }, 3);
        let n = 20_000;
        let mut sums = [0.0; 6];
        for _ in 0..n {
            for (sum, read) in sums.iter_mut().zip(sensor.sample(&[0.0; 6])) {
                *sum += read * read;
            }
        }
        for (axis, sum) in sums.into_iter().enumerate() {
            let ratio = sum / n as f64 / (noise[axis / 3] * noise[axis / 3]);
            // Relative sd of a variance √(2/n) = 0.01, five of them; rounding to steps adds 3e-4.
            assert!((ratio - 1.0).abs() < 0.051, "{ratio}");
        }
    }
}
