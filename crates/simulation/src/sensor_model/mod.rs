//! A physical model of the instrument: from a wrench on the shell to eight readings.
//!
//! ```text
//! wrench ─ springs ─► displacement ─ geometry ─► eight gaps ─ response ─► light ─► counts
//!          creep,      of the plate   rays meet    GP2S60       gain, drift,   noise, ADC
//!          hysteresis                 reflectors                ambient
//! ```
//!
//! Only the springs of a [`SensorModel`] have a memory. [`LoadScript`] provides the wrench,
//! [`ReferenceSensor`] a reference sensor's measurement of it, and [`SensorRecording`] combines
//! them row by row.
//!
//! Results depend only on parameters and seeds, to the last bit on every machine: random numbers
//! come from ChaCha, elementary functions from `libm`, sums have a fixed order.
//!
//! Not modelled: the mass of the plate (no hand excites its resonance above 100 Hz), light from one
//! channel in another (one emitter is lit at a time), and, except on the simulated board, the time
//! between conversions.

mod geometry;
mod load;
mod pair;
mod parameters;
mod recording;
mod response;
mod springs;

pub use geometry::Reflector;
pub use load::{LoadScript, LoadTable, RecordingKind};
pub use pair::{Pair, PairSettings};
pub use parameters::{Reference, SensorChannel, SensorNoise, SensorParameters, Surroundings};
pub use recording::{RecordingSettings, ReferenceSensor, SensorRecording, SensorSample};
use springs::compliance;
pub use springs::{Displacement, Spring, stiffness};

use crate::SimulationError;
use geometry::RigidMotion;
use shell_data::random::{Purpose, RandomStream};
use springs::{CREEP, HYSTERESIS, Suspension};

use shell_data::wrench::PerAxis;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SimulatedFrame {
    /// Counts, with ambient light subtracted.
    pub readings: [u16; 8],
    /// Bit i is set if reading i is at an end of the converter's range.
    pub saturated: u8,
}

/// The light on one photointerrupter, as fractions of the full scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    pub light: f64,
    /// Residual of the subtraction of ambient light.
    pub dark: f64,
}

/// Largest load, N or N·m: the instrument does not survive more.
pub const LIMIT: f64 = 1e6;

#[derive(Clone, Debug)]
pub struct SensorModel {
    unit: SensorParameters,
    normals: [[f64; 3]; 8],
    suspension: Suspension,
    start_k: f64,
    ambient: [f64; 8],
    full_scale: f64,
    random: RandomStream,
}

impl SensorModel {
    /// Creates the instrument `unit` ([`SensorParameters::unit`]) for the recording `seed`.
    ///
    /// # Errors
    /// [`SimulationError`] if the plate is loose or the converter cannot be modelled.
    pub fn new(unit: &SensorParameters, seed: u64) -> Result<Self, SimulationError> {
        let (bits, is_known) = (unit.adc_bits, (8..=16).contains(&unit.adc_bits));
        ensure!(is_known, "a converter of {bits} bits, where 8 to 16 can be modelled");
        let loose =
            || SimulationError("the springs do not hold the plate in all six directions".into());
        let compliance = compliance(&stiffness(&unit.springs)).ok_or_else(loose)?;
        let (creep, hysteresis) = if unit.elastic { (0.0, 0.0) } else { (CREEP, HYSTERESIS) };
        let mut session = RandomStream::new(seed, Purpose::Session, 0);
        Ok(Self {
            unit: unit.clone(),
            normals: unit.channels.map(|channel| channel.reflector.normal()),
            suspension: Suspension::new(compliance, creep, hysteresis),
            start_k: unit.surroundings.start_k * session.normal(),
            ambient: std::array::from_fn(|_| unit.surroundings.ambient * session.normal()),
            full_scale: f64::from(1_u32 << unit.adc_bits),
            random: RandomStream::new(seed, Purpose::Readings, 0),
        })
    }

    /// Returns the frame at `time_s` since the start, in ascending order, under a `wrench` (N and
    /// N·m, shell frame) that has held since the previous frame. A load that is not finite, or
    /// above [`LIMIT`], saturates all channels of the frame at zero.
    pub fn sample(&mut self, time_s: f64, wrench: &PerAxis<f64>) -> SimulatedFrame {
        if !is_bearable(time_s, wrench) {
            return SimulatedFrame { readings: [0; 8], saturated: 0xFF };
        }
        let mut frame = SimulatedFrame { readings: [0; 8], saturated: 0 };
        for (i, Exposure { light, dark }) in self.expose(time_s, wrench).into_iter().enumerate() {
            let count = self.convert(light, dark);
            frame.readings[i] = count as u16;
            frame.saturated |= u8::from(!(count > 0.0 && count < self.full_scale - 1.0)) << i;
        }
        frame
    }

    /// Returns the light of a [`sample`](Self::sample) before its conversion; zero for a load that is not finite, or
    /// above [`LIMIT`].
    pub(crate) fn expose(&mut self, time_s: f64, wrench: &PerAxis<f64>) -> [Exposure; 8] {
        if !is_bearable(time_s, wrench) {
            return [Exposure { light: 0.0, dark: 0.0 }; 8];
        }
        let motion = RigidMotion::new(&self.suspension.displacement(time_s, wrench));
        let warmth_k = self.warmth_k(time_s);
        std::array::from_fn(|i| {
            let channel = &self.unit.channels[i];
            let gap_m = motion.gap_m(&channel.reflector, &self.normals[i]);
            let gain = channel.gain * (1.0 + channel.gain_drift_per_k * warmth_k);
            let light = gain * response::current_at(gap_m);
            let dark = self.ambient[i] + channel.offset_drift_per_k * warmth_k;
            Exposure { light, dark }
        })
    }

    /// Temperature relative to the design's, K.
    pub fn warmth_k(&self, time_s: f64) -> f64 {
        let Surroundings { warm_up_k, warm_up_s, .. } = self.unit.surroundings;
        self.start_k - warm_up_k * libm::expm1(-time_s.max(0.0) / warm_up_s)
    }

    /// Converts light, a fraction of the full scale, with noise and the converter's resolution.
    pub fn conversion(&mut self, light: f64) -> u16 {
        self.convert(light, 0.0) as u16
    }

    fn convert(&mut self, light: f64, dark: f64) -> f64 {
        let SensorNoise { read, shot, emitter } = self.unit.noise;
        let variance = read * read + shot * light + (emitter * light) * (emitter * light);
        let signal = light + dark + variance.sqrt() * self.random.normal();
        (signal * self.full_scale).round().clamp(0.0, self.full_scale - 1.0)
    }
}

fn is_bearable(time_s: f64, wrench: &PerAxis<f64>) -> bool {
    time_s.is_finite() && wrench.iter().all(|w| w.abs() <= LIMIT)
}
