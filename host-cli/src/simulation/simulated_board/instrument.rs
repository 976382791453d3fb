//! The sensor model as the front end of a board: conversions, dark and lit.

use std::fmt;

use firmware::{Clock, FrontEnd};

use super::PacedClock;
use crate::simulation::sensor_model::{Exposure, LoadScript, LoadTable, SensorModel};
use shell_data::wrench::PerAxis;

/// Light from outside as a fraction of the full scale: what a lit room leaves under the shell. The
/// firmware subtracts it.
const AMBIENT: f64 = 0.03;

/// What is done to the shell, over the board's time.
#[derive(Clone, Debug)]
pub enum Load {
    /// Nothing for so many seconds, in which a zero can be taken; then hands.
    Hands {
        /// Time without a load, s.
        rest_s: f64,
        /// Their poses.
        script: LoadScript,
    },
    /// What somebody has written down.
    Table(LoadTable),
}

impl Load {
    /// Five seconds of rest and then the poses of a test recording.
    pub fn hands(seed: u64) -> Self {
        Self::Hands { rest_s: 5.0, script: LoadScript::test(seed) }
    }

    /// The wrench (N and N·m) at a time since the start.
    pub fn wrench_at(&mut self, time_s: f64) -> PerAxis<f64> {
        match self {
            Self::Hands { rest_s, .. } if time_s < *rest_s => PerAxis::default(),
            Self::Hands { rest_s, script } => script.wrench_at(time_s - *rest_s),
            Self::Table(table) => table.wrench_at(time_s),
        }
    }
}

/// Eight photointerrupters of the sensor model.
pub struct Instrument {
    sensor: SensorModel,
    load: Load,
    clock: PacedClock,
    lit: Option<usize>,
    exposures: [Exposure; 8],
}

impl fmt::Debug for Instrument {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Instrument").field("load", &self.load).finish_non_exhaustive()
    }
}

impl Instrument {
    /// An instrument under a load, whose conversions take time on `clock`.
    pub fn new(sensor: SensorModel, load: Load, clock: PacedClock) -> Self {
        let exposures = [Exposure { light: 0.0, dark: 0.0 }; 8];
        Self { sensor, load, clock, lit: None, exposures }
    }
}

impl FrontEnd for Instrument {
    /// As on the SkinProc board.
    const CONVERSION_NS: u32 = 3_250;

    fn light(&mut self, channel: Option<usize>) {
        self.lit = channel;
    }

    async fn convert(&mut self, channel: usize, codes: &mut [u16]) {
        let now_us = self.clock.now_us();
        // A frame is one moment to the model: that of its first conversion.
        if channel == 0 && self.lit.is_none() {
            let time_s = now_us as f64 / 1e6;
            let wrench = self.load.wrench_at(time_s);
            self.exposures = self.sensor.expose(time_s, &wrench);
        }
        let Exposure { light, dark } = self.exposures[channel];
        let seen = if self.lit == Some(channel) { AMBIENT + light + dark } else { AMBIENT };
        codes.fill_with(|| self.sensor.conversion(seen));
        let burst_ns = codes.len() as u64 * u64::from(Self::CONVERSION_NS);
        self.clock.wait_until_us(now_us + burst_ns.div_ceil(1000)).await;
    }
}
