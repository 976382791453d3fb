//! One instrument and one reference sensor under one sequence of loads.

use super::geometry::RigidMotion;
use super::parameters::Reference;
use crate::SimulationError;
use shell_data::random::{Purpose, RandomStream};
use shell_data::wrench::{PerAxis, cross};

use super::{LoadScript, RecordingKind, SensorModel, SensorParameters, SimulatedFrame};

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RecordingSettings {
    pub kind: RecordingKind,
    pub rate_hz: f64,
    pub start_time_s: f64,
    /// Determines loads, noise, light, temperature and mounting.
    pub seed: u64,
    pub unit_seed: u64,
    pub noise_scale: f64,
    pub adc_bits: u32,
    pub elastic: bool,
}

impl RecordingSettings {
    pub const fn new(kind: RecordingKind) -> Self {
        Self {
            kind,
            rate_hz: 100.0,
            start_time_s: 0.0,
            seed: 1,
            unit_seed: 1,
            noise_scale: 1.0,
            adc_bits: 12,
            elastic: false,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorSample {
    pub time_s: f64,
    pub frame: SimulatedFrame,
    pub wrench: PerAxis<f64>,
    pub pose: u64,
}

#[derive(Clone, Debug)]
pub struct SensorRecording {
    settings: RecordingSettings,
    load: LoadScript,
    sensor: SensorModel,
    reference: ReferenceSensor,
    row: u64,
}

impl SensorRecording {
    /// Sets up a recording. Different kinds share only the instrument, even with equal seeds.
    ///
    /// # Errors
    /// [`SimulationError`] if rate, time or converter are invalid.
    pub fn new(settings: RecordingSettings) -> Result<Self, SimulationError> {
        let RecordingSettings { kind, rate_hz, start_time_s, seed, .. } = settings;
        check_timing(rate_hz, start_time_s)?;
        let mut unit = SensorParameters::noisy_unit(settings.unit_seed, settings.noise_scale)?;
        unit.adc_bits = settings.adc_bits;
        unit.elastic = settings.elastic;
        // The two highest bits of a seed, unused in practice, move to the end and hold the kind.
        let session_seed = seed.rotate_left(2) ^ kind as u64;
        Ok(Self {
            settings,
            load: LoadScript::new(kind, seed),
            sensor: SensorModel::new(&unit, session_seed)?,
            reference: ReferenceSensor::new(&unit.reference, session_seed),
            row: 0,
        })
    }
}

pub(super) fn check_timing(rate_hz: f64, start_time_s: f64) -> Result<(), SimulationError> {
    let is_clock = rate_hz.is_finite() && rate_hz > 0.0 && start_time_s.is_finite();
    ensure!(
        is_clock,
        "rate {rate_hz} Hz from {start_time_s} s on: a rate above 0 and a finite start wanted"
    );
    Ok(())
}

impl Iterator for SensorRecording {
    type Item = SensorSample;

    fn next(&mut self) -> Option<SensorSample> {
        let elapsed_s = self.row as f64 / self.settings.rate_hz;
        self.row += 1;
        let wrench = self.load.wrench_at(elapsed_s);
        Some(SensorSample {
            time_s: self.settings.start_time_s + elapsed_s,
            frame: self.sensor.sample(elapsed_s, &wrench),
            wrench: self.reference.sample(&wrench),
            pose: LoadScript::pose_number(elapsed_s),
        })
    }
}

/// A reference sensor, mounted for one recording with axes rotated and shifted from the shell's. It
/// has a zero error, noise, and a finite resolution.
#[derive(Clone, Debug)]
pub struct ReferenceSensor {
    parameters: Reference,
    turn: RigidMotion,
    shift_m: [f64; 3],
    zero: PerAxis<f64>,
    noise: RandomStream,
}

impl ReferenceSensor {
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

    /// Returns the reading under `wrench` (N and N·m, shell frame), in whole steps of the sensor.
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
            // Adding zero turns −0 into 0.
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
            // A variance has a relative sd of √(2/n) = 0.01; the limit is five of these. Rounding to steps adds 3e-4.
            assert!((ratio - 1.0).abs() < 0.051, "{ratio}");
        }
    }
}
