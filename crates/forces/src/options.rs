use std::fmt;

use serde::Serialize;

pub const DEFAULT_TARE_FRAMES: usize = 50;

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ForceOptions {
    pub tare: TareRule,
    pub low_pass: Option<LowPass>,
    /// Leaves forces unfiltered, instead of failing, if the rate does not suit a default low-pass.
    #[serde(skip)]
    pub low_pass_is_optional: bool,
    /// Slots of the low-pass's grid per second, Hz, instead of the rate of the log's rows.
    pub rate_hz: Option<f64>,
    pub rule: RowRule,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum TareRule {
    /// No tare: the calibration's own zero.
    #[default]
    Untared,
    /// The first fresh frames of the log ([`RowRule::Rows`]: its first rows).
    First(usize),
    /// The fresh frames between two times, s on the log's clock.
    Between(f64, f64),
    /// All stationary intervals, interpolated linearly. If `causal`, as during recording, the last
    /// complete interval's zero is held.
    Rests { causal: bool },
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LowPass {
    /// Frequency at which the gain is 1/√2 (causal) or 1/2 (zero-phase), Hz.
    pub cutoff_hz: f64,
    pub order: usize,
    pub zero_phase: bool,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum RowRule {
    /// A row is a frame at the time on its clock. In place of missing rows, the filter holds the last value. Means and
    /// integrals are over time, linear between rows.
    #[default]
    Time,
    /// A row is one sample, as in the lab's notebooks: a frame and a step of the filter. Means are over rows. Energy
    /// sums each row's power times the time since the previous row.
    Rows,
}

impl Default for ForceOptions {
    /// The lab's tare and its 4th-order low-pass at 10 Hz, without delay.
    fn default() -> Self {
        Self {
            tare: TareRule::First(DEFAULT_TARE_FRAMES),
            low_pass: Some(LowPass::default()),
            low_pass_is_optional: true,
            rate_hz: None,
            rule: RowRule::Time,
        }
    }
}

impl Default for LowPass {
    fn default() -> Self {
        Self { cutoff_hz: 10.0, order: 4, zero_phase: true }
    }
}

impl ForceOptions {
    /// Options without tare and low-pass: forces relative to the calibration's own zero, unfiltered.
    pub const RAW: Self = Self {
        tare: TareRule::Untared,
        low_pass: None,
        low_pass_is_optional: false,
        rate_hz: None,
        rule: RowRule::Time,
    };

    /// Returns these options with a causal low-pass and tare, as for recording, or with both free of delay.
    pub fn with_delay(mut self, causal: bool) -> Self {
        if let Some(low_pass) = &mut self.low_pass {
            low_pass.zero_phase = !causal;
        }
        if let TareRule::Rests { causal: held } = &mut self.tare {
            *held = causal;
        }
        self
    }
}

impl TareRule {
    pub fn follows_rests(self) -> bool {
        matches!(self, Self::Rests { .. })
    }
}

impl fmt::Display for TareRule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Untared => f.write_str("none"),
            Self::First(frames) => write!(f, "mean of the first {frames} frames"),
            Self::Between(from_s, to_s) => write!(f, "mean from {from_s} s to {to_s} s"),
            Self::Rests { causal: false } => f.write_str("linear between stationary intervals"),
            Self::Rests { causal: true } => f.write_str("that of the last stationary interval"),
        }
    }
}

impl fmt::Display for LowPass {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let phase = if self.zero_phase { "zero-phase" } else { "causal" };
        write!(f, "{} Hz, order {}, {phase}", self.cutoff_hz, self.order)
    }
}
