//! The sensor model as the front end of a board: dark and lit conversions.

use std::sync::{Arc, Mutex};

use firmware::{Clock, FrontEnd};
use shared_proto::{COUNTS_PER_LSB, Vitals};

use super::PacedClock;
use crate::sensor_model::{Exposure, LoadScript, LoadTable, RecordingKind, SensorModel};
use shell_data::lock::lock;
use shell_data::wrench::PerAxis;

/// Light under the shell in a lit room, as a fraction of full scale; the firmware subtracts it.
const AMBIENT: f64 = 0.03;

const ROOM_C: f64 = 23.0;

/// Supply and reference of an STM32L432 (DS11451, "Embedded internal voltage reference"), V.
const SUPPLY_V: f64 = 3.3;
const REFERENCE_V: f64 = 1.212;

const REST_S: f64 = 5.0;

#[derive(Clone, Debug)]
pub enum Load {
    /// No load for five seconds, in which a zero can be taken; then hands.
    Hands(LoadScript),
    Table(LoadTable),
    /// A load set at run time, N and N·m.
    Commanded(Arc<Mutex<PerAxis<f64>>>),
}

impl Load {
    /// Five seconds without load and then the poses of a test recording.
    pub fn hands(seed: u64) -> Self {
        Self::Hands(LoadScript::new(RecordingKind::Test, seed))
    }

    /// Returns the wrench at a time, N and N·m.
    pub fn wrench_at(&mut self, time_s: f64) -> PerAxis<f64> {
        match self {
            Self::Hands(_) if time_s < REST_S => PerAxis::default(),
            Self::Hands(script) => script.wrench_at(time_s - REST_S),
            Self::Table(table) => table.wrench_at(time_s),
            Self::Commanded(wrench) => *lock(wrench),
        }
    }
}

#[derive(Debug)]
pub struct SimulatedInstrument {
    sensor: SensorModel,
    load: Load,
    clock: PacedClock,
    lit: Option<usize>,
}

impl SimulatedInstrument {
    pub fn new(sensor: SensorModel, load: Load, clock: PacedClock) -> Self {
        Self { sensor, load, clock, lit: None }
    }
}

/// Duration of a conversion, as on the SkinProc board.
pub(super) const CONVERSION_NS: u32 = 3_250;

impl FrontEnd for SimulatedInstrument {
    fn light(&mut self, channel: Option<usize>) {
        self.lit = channel;
    }

    async fn sum(&mut self, settling_us: u16, channel: usize, conversions: u8) -> u32 {
        self.clock.wait_until_us(self.clock.now_us() + u64::from(settling_us)).await;
        let now_us = self.clock.now_us();
        let burst_us = (u64::from(conversions) * u64::from(CONVERSION_NS)).div_ceil(1000);
        let seen = match self.lit {
            // A burst counts as one instant, its middle, although the load changes.
            Some(lit) => {
                let time_s = (now_us as f64 + burst_us as f64 / 2.0) / 1e6;
                let wrench = self.load.wrench_at(time_s);
                let Exposure { light, dark } = self.sensor.expose(time_s, &wrench)[channel];
                // The emitter of another channel does not reach this one.
                if lit == channel { AMBIENT + light + dark } else { AMBIENT }
            }
            None => AMBIENT,
        };
        let sum = (0..conversions).map(|_| u32::from(self.sensor.conversion(seen))).sum();
        self.clock.wait_until_us(now_us + burst_us).await;
        sum
    }

    async fn vitals(&mut self) -> Vitals {
        let warmth_k = self.sensor.warmth_k(self.clock.now_us() as f64 / 1e6);
        let counts = REFERENCE_V / SUPPLY_V * f64::from(1 << 12) * f64::from(COUNTS_PER_LSB);
        Vitals {
            temperature_cdeg: Some(((ROOM_C + warmth_k) * 100.0).round() as i16),
            supply_mv: Some((SUPPLY_V * 1000.0) as u16),
            reference: Some(counts.round() as u16),
        }
    }
}
