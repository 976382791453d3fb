//! A recording session: one instrument and one reference sensor under one sequence of loads.

use shell_data::wrench::PerAxis;

use super::{
    LoadScript, ModelError, ReferenceSensor, SensorModel, SensorParameters, SimulatedFrame,
};

/// What is done to the shell during a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RecordingKind {
    /// Loads to calibrate on.
    Training,
    /// Other loads, to test a calibration on.
    Test,
    /// Nothing touches the shell.
    Zero,
}

/// How a recording is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RecordingSettings {
    /// What is done to the shell.
    pub kind: RecordingKind,
    /// Samples per second.
    pub rate_hz: f64,
    /// Time of the first row, s.
    pub start_time_s: f64,
    /// Names the recording: its loads, noise, light, warmth and mounting.
    pub seed: u64,
    /// Names the instrument.
    pub unit_seed: u64,
    /// Factor on all random noise.
    pub noise_scale: f64,
    /// Resolution of the converter, bits.
    pub adc_bits: u32,
    /// Springs without creep and hysteresis.
    pub elastic: bool,
}

impl RecordingSettings {
    /// What is made of that kind where nothing else is asked for.
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

/// One row of a recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorSample {
    /// Time, s.
    pub time_s: f64,
    /// The instrument's frame.
    pub frame: SimulatedFrame,
    /// The reference sensor's reading, N and N·m.
    pub wrench: PerAxis<f64>,
    /// Number of the pose.
    pub pose: u64,
}

/// An endless recording, row by row.
#[derive(Clone, Debug)]
pub struct SensorRecording {
    settings: RecordingSettings,
    load: LoadScript,
    sensor: SensorModel,
    reference: ReferenceSensor,
    row: u64,
}

impl SensorRecording {
    /// Sets everything up for the first row.
    ///
    /// Recordings of different kinds differ in everything but the instrument, also where their
    /// seeds are the same.
    ///
    /// # Errors
    /// [`ModelError`] if the rate is not above 0, a time is not finite or the converter cannot be
    /// modelled.
    pub fn new(settings: RecordingSettings) -> Result<Self, ModelError> {
        let RecordingSettings { kind, rate_hz, start_time_s, seed, .. } = settings;
        if !(rate_hz.is_finite() && rate_hz > 0.0 && start_time_s.is_finite()) {
            return Err(ModelError::Timing { rate_hz, start_time_s });
        }
        let mut unit = SensorParameters::noisy_unit(settings.unit_seed, settings.noise_scale)?;
        unit.adc_bits = settings.adc_bits;
        if settings.elastic {
            unit.make_elastic();
        }
        let (load, session) = match kind {
            RecordingKind::Training => (LoadScript::training(seed), 0),
            RecordingKind::Test => (LoadScript::test(seed), 1),
            RecordingKind::Zero => (LoadScript::zero(), 2),
        };
        // The two highest bits of a seed are free in practice: they make room for the kind.
        let session_seed = seed.rotate_left(2) ^ session;
        Ok(Self {
            settings,
            load,
            sensor: SensorModel::new(&unit, session_seed)?,
            reference: ReferenceSensor::new(&unit.reference, session_seed),
            row: 0,
        })
    }
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
