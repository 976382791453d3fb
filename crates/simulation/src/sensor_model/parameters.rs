//! All constants of the sensor model, with their sources.

use super::geometry::Reflector;
use super::springs::Spring;
use crate::SimulationError;
use shell_data::random::{Purpose, RandomStream};

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorChannel {
    pub reflector: Reflector,
    /// Reading at the optimum distance, as a fraction of the full scale.
    pub gain: f64,
    pub gain_drift_per_k: f64,
    /// Change of the dark reading, as a fraction of the full scale, per K.
    pub offset_drift_per_k: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorNoise {
    /// Amplifier and converter, as a fraction of the full scale.
    pub read: f64,
    /// Shot noise: variance over signal, both as fractions of the full scale.
    pub shot: f64,
    /// Emitter's intensity, relative.
    pub emitter: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surroundings {
    /// Light left after the ambient reading is subtracted, as a fraction of the full scale.
    pub ambient: f64,
    /// Temperature at the start relative to other recordings, K (standard deviation).
    pub start_k: f64,
    pub warm_up_k: f64,
    pub warm_up_s: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reference {
    /// Resolution of forces, N, and moments, N·m.
    pub resolution: [f64; 2],
    /// Noise of forces, N, and moments, N·m (standard deviations).
    pub noise: [f64; 2],
    /// Zero error of one recording, N and N·m (standard deviations).
    pub zero: [f64; 2],
    /// Rotation of its axes by mounting, relative to the shell's, rad, per axis.
    pub turn_rad: f64,
    /// Shift of its origin by mounting, relative to the shell's, m, per axis.
    pub shift_m: f64,
}

#[derive(Clone, Debug, PartialEq)]
pub struct SensorParameters {
    /// Springs of the reflector plate; the frame's origin is at their centre.
    pub springs: [Spring; 4],
    /// True for springs without creep and hysteresis, so that a calibration can be exact.
    pub elastic: bool,
    /// Four flat, two tilted about y, two tilted about x.
    pub channels: [SensorChannel; 8],
    pub noise: SensorNoise,
    pub surroundings: Surroundings,
    pub adc_bits: u32,
    pub reference: Reference,
}

/// One step of the original board's 12-bit converter, as a fraction of its full scale.
const LSB_12: f64 = 1.0 / 4096.0;
const MM: f64 = 1e-3;

// Deviations of a unit from the design (standard deviations).

const STIFFNESS_SPREAD: f64 = 0.05;
/// Deviation of a photointerrupter's position and of its unloaded gap, m.
const POSITION_SPREAD_M: f64 = 0.05 * MM;
const TILT_SPREAD_RAD: f64 = 0.01;
const GAIN_SPREAD: f64 = 0.10;
const GAIN_DRIFT_SPREAD: f64 = 5e-4;
/// Temperature coefficient of the dark reading, fraction of the full scale per K.
const OFFSET_DRIFT_SPREAD: f64 = 0.3 * LSB_12;

impl SensorParameters {
    /// The instrument as designed.
    ///
    /// Sources, and assumptions where there is no source:
    /// - Four flat reflectors, two tilted about y, two about x: the paper on the shell (§II-A) and
    ///   Goldberg et al. 2015. Positions are assumed, on a board of 5 cm × 5 cm: the flat ones near
    ///   the corners, for Mx and My; each tilted pair far apart, for Mz.
    /// - Springs: a hand or a beam exerts up to some 3 N on the shell of an 87 g robot (0.85 N). On
    ///   the original board this changes readings by a few hundred to a thousand counts, a few
    ///   tenths of a millimetre on the slope of the response. With 6 N/mm along z and 2.4 N/mm
    ///   across per spring, 1 N moves the plate 0.04 mm along z and 0.10 mm along x or y.
    /// - Unloaded gap: 1.2 mm, on the falling side of the response, so that the plate can travel
    ///   0.5 mm both ways without passing the maximum at 0.7 mm.
    /// - Gain: some 1950 of 4096 counts without load, 800 to 3800 under load; recordings of the
    ///   original board go from 700 to 2900.
    /// - Noise: 2.5 counts of 4096 from amplifier and converter, shot noise of 800,000 effective
    ///   electrons at full scale, 0.02 % of the emitter's intensity, together 4.0 counts without
    ///   load, which give 0.02 N; the paper has 0.015 to 0.048 N. The original board smooths its
    ///   readings, to 0.7 to 1.6 counts.
    /// - Temperature: an infrared emitter loses about 0.7 % per K, a phototransistor gains about
    ///   0.5 %; the difference is taken as −0.2 % per K.
    /// - Reference: resolution of a small strain-gauge sensor for 25 N and 250 N·mm (1/160 N, 1/32
    ///   N·mm), with noise of 1.5 steps.
    pub fn nominal() -> Self {
        let spring = |[x, y]: [f64; 2]| Spring {
            position_m: [x * MM, y * MM, 0.0],
            stiffness_n_per_m: [2400.0, 2400.0, 6000.0],
        };
        let channel = |[x, y]: [f64; 2], tilt_x_deg: f64, tilt_y_deg: f64| SensorChannel {
            reflector: Reflector {
                position_m: [x * MM, y * MM],
                gap_m: 1.2 * MM,
                tilt_x_rad: tilt_x_deg.to_radians(),
                tilt_y_rad: tilt_y_deg.to_radians(),
            },
            gain: 0.85,
            gain_drift_per_k: -0.002,
            offset_drift_per_k: 0.0,
        };
        Self {
            springs: [[25.0, 20.0], [-25.0, 20.0], [-25.0, -20.0], [25.0, -20.0]].map(spring),
            elastic: false,
            channels: [
                channel([18.0, 15.0], 0.0, 0.0),
                channel([-18.0, 15.0], 0.0, 0.0),
                channel([-18.0, -15.0], 0.0, 0.0),
                channel([18.0, -15.0], 0.0, 0.0),
                channel([0.0, 20.0], 0.0, 30.0),
                channel([0.0, -20.0], 0.0, 30.0),
                channel([20.0, 0.0], 30.0, 0.0),
                channel([-20.0, 0.0], 30.0, 0.0),
            ],
            noise: SensorNoise { read: 2.5 * LSB_12, shot: 1.0 / 8e5, emitter: 2e-4 },
            surroundings: Surroundings {
                ambient: 2.0 * LSB_12,
                start_k: 0.5,
                warm_up_k: 0.5,
                warm_up_s: 300.0,
            },
            adc_bits: 12,
            reference: Reference {
                resolution: [1.0 / 160.0, 1e-3 / 32.0],
                noise: [1.5 / 160.0, 1.5e-3 / 32.0],
                zero: [0.01, 1e-4],
                turn_rad: 0.005,
                shift_m: 0.3 * MM,
            },
        }
    }

    /// Returns a unit: this design with normal deviations, cut off at three standard deviations.
    pub fn unit(&self, unit_seed: u64) -> Self {
        let mut stream = RandomStream::new(unit_seed, Purpose::Unit, 0);
        let mut deviate = |scale: f64| scale * stream.normal().clamp(-3.0, 3.0);
        let mut unit = self.clone();
        for spring in &mut unit.springs {
            for stiffness in &mut spring.stiffness_n_per_m {
                *stiffness *= 1.0 + deviate(STIFFNESS_SPREAD);
            }
        }
        for channel in &mut unit.channels {
            let reflector = &mut channel.reflector;
            for position in &mut reflector.position_m {
                *position += deviate(POSITION_SPREAD_M);
            }
            reflector.gap_m += deviate(POSITION_SPREAD_M);
            reflector.tilt_x_rad += deviate(TILT_SPREAD_RAD);
            reflector.tilt_y_rad += deviate(TILT_SPREAD_RAD);
            channel.gain *= 1.0 + deviate(GAIN_SPREAD);
            channel.gain_drift_per_k += deviate(GAIN_DRIFT_SPREAD);
            channel.offset_drift_per_k += deviate(OFFSET_DRIFT_SPREAD);
        }
        unit
    }

    /// Returns a unit of the nominal instrument with its noise [scaled](Self::scale_noise). The factor must be finite
    /// and at least 0.
    pub(crate) fn noisy_unit(unit_seed: u64, factor: f64) -> Result<Self, SimulationError> {
        let is_factor = factor.is_finite() && factor >= 0.0;
        ensure!(is_factor, "noise scaled by {factor}, where a factor of 0 or more is wanted");
        let mut unit = Self::nominal().unit(unit_seed);
        unit.scale_noise(factor);
        Ok(unit)
    }

    /// Scales random noise; quantisation, drift, creep and hysteresis stay.
    pub fn scale_noise(&mut self, factor: f64) {
        let SensorNoise { read, shot, emitter } = &mut self.noise;
        *read *= factor;
        *shot *= factor * factor;
        *emitter *= factor;
        for noise in &mut self.reference.noise {
            *noise *= factor;
        }
    }
}
