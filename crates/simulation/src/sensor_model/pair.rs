//! One session on two clocks: the reference's recording and the board's log, from two machines.
//!
//! ```text
//! t_reference = (1 + skew) · t_board + offset
//! ```
//!
//! The load is a function of reference time. The board's clock shows 0 at its first frame.

use super::recording::check_timing;
use super::{
    LoadScript, RecordingKind, ReferenceSensor, SensorModel, SensorParameters, SimulatedFrame,
};
use crate::SimulationError;
use shell_data::random::{Purpose, RandomStream};
use shell_data::wrench::PerAxis;

const SPRINGS_HZ: f64 = 1000.0;

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct PairSettings {
    pub seed: u64,
    pub unit_seed: u64,
    pub loaded: bool,
    pub duration_s: f64,
    /// The reference starts this long before the board and stops as long after it; may be negative.
    pub margin_s: f64,
    pub reference_rate_hz: f64,
    /// On the board's own clock.
    pub board_rate_hz: f64,
    /// Reading of the reference's clock when the board's shows 0.
    pub offset_s: f64,
    /// Rate of the reference's clock relative to the board's, minus one.
    pub skew: f64,
    pub loss: f64,
    pub noise_scale: f64,
}

#[derive(Clone, Debug)]
pub struct Pair {
    settings: PairSettings,
    sensor: SensorModel,
    reference: ReferenceSensor,
    load: LoadScript,
}

impl Pair {
    /// # Errors
    /// [`SimulationError`] if a rate is not above 0, a time is not finite, the noise is negative,
    /// or the loss is not a share.
    pub fn new(settings: PairSettings) -> Result<Self, SimulationError> {
        let PairSettings { board_rate_hz, skew, loss, .. } = settings;
        check_timing(settings.reference_rate_hz, settings.offset_s)?;
        for time_s in [settings.offset_s, settings.duration_s, settings.margin_s] {
            check_timing(board_rate_hz, time_s)?;
        }
        // With a larger skew, steps of one clock would be years of the other.
        let are_alike = skew.abs() <= 0.1;
        ensure!(
            are_alike,
            "clocks that differ by {skew} of themselves, where 0.1 at most can be modelled"
        );
        let is_share = (0.0..1.0).contains(&loss);
        ensure!(
            is_share,
            "a share of {loss} of the frames lost, where 0 to 1 (excluded) is wanted"
        );
        let unit = SensorParameters::noisy_unit(settings.unit_seed, settings.noise_scale)?;
        let kind = if settings.loaded { RecordingKind::Training } else { RecordingKind::Zero };
        Ok(Self {
            settings,
            sensor: SensorModel::new(&unit, settings.seed)?,
            reference: ReferenceSensor::new(&unit.reference, settings.seed),
            load: LoadScript::new(kind, settings.seed),
        })
    }

    fn load_time_s(&self, reference_time_s: f64) -> f64 {
        reference_time_s - self.settings.offset_s + self.settings.margin_s.max(0.0)
    }

    /// Returns times on the reference's clock, s, and wrenches, N and N·m.
    pub fn reference(&self) -> impl Iterator<Item = (f64, PerAxis<f64>)> {
        let PairSettings { duration_s, margin_s, reference_rate_hz, offset_s, skew, .. } =
            self.settings;
        let length_s = duration_s * (1.0 + skew) + 2.0 * margin_s;
        let mut pair = self.clone();
        (0..count(length_s, reference_rate_hz)).map(move |k| {
            let time_s = offset_s - margin_s + k as f64 / reference_rate_hz;
            let load_s = pair.load_time_s(time_s).max(0.0);
            (time_s, pair.reference.sample(&pair.load.wrench_at(load_s)))
        })
    }

    pub fn board(&self) -> impl Iterator<Item = (f64, SimulatedFrame)> {
        let PairSettings { seed, duration_s, board_rate_hz, offset_s, skew, loss, .. } =
            self.settings;
        let mut losses = RandomStream::new(seed, Purpose::Losses, 0);
        let parts = (SPRINGS_HZ / board_rate_hz).ceil().clamp(1.0, 1e3) as u64;
        let mut pair = self.clone();
        (0..count(duration_s, board_rate_hz)).filter_map(move |k| {
            let time_s = k as f64 / board_rate_hz;
            let load_s = pair.load_time_s(time_s * (1.0 + skew) + offset_s).max(0.0);
            // The springs follow the load between two frames.
            for part in 1..parts {
                let before_s = load_s - (parts - part) as f64 / (parts as f64 * board_rate_hz);
                if before_s > 0.0 {
                    pair.sensor.sample(before_s, &pair.load.wrench_at(before_s));
                }
            }
            let frame = pair.sensor.sample(load_s, &pair.load.wrench_at(load_s));
            (losses.uniform() >= loss).then_some((time_s, frame))
        })
    }
}

fn count(length_s: f64, rate_hz: f64) -> u64 {
    (length_s * rate_hz).round().max(0.0) as u64
}
