//! How readings become forces.

use std::fmt;

use serde::Serialize;

/// Frames of the usual tare, the lab's.
pub const DEFAULT_TARE_FRAMES: usize = 50;

/// How readings become forces.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ForceOptions {
    /// Which frames are unloaded.
    pub tare: TareRule,
    /// The low-pass over the forces; `None` for none.
    pub low_pass: Option<LowPass>,
    /// Leave the forces unfiltered where the rate of the log is too low for the low-pass or not known,
    /// instead of failing: for a low-pass that nobody asked for.
    #[serde(skip)]
    pub low_pass_is_optional: bool,
    /// Slots of the low-pass per second, in place of the log's own rate, Hz.
    pub rate_hz: Option<f64>,
    /// What a row stands for.
    pub rule: RowRule,
}

/// Which frames are unloaded; their mean wrench is subtracted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum TareRule {
    /// None: the calibration's own zero.
    #[default]
    Untared,
    /// The first fresh frames of the log ([`RowRule::Rows`]: its first rows).
    First(usize),
    /// The fresh frames from one time to another, s on the log's clock.
    Between(f64, f64),
    /// All stretches at rest: the zero runs straight from one to the next. Where it is `causal`, that of the last
    /// stretch that has ended is held, as it must be while a log is recorded.
    Rests { causal: bool },
}

/// A Butterworth low-pass.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LowPass {
    /// Where a causal filter attenuates to 1/√2, and a zero-phase one to 1/2, Hz.
    pub cutoff_hz: f64,
    /// Number of poles.
    pub order: usize,
    /// Forward and backward, without delay.
    pub zero_phase: bool,
}

/// What a row stands for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum RowRule {
    /// The moment that its clock shows. Missing rows are held for the filter; means and integrals are
    /// over time, straight between rows.
    #[default]
    Time,
    /// A sample, as the lab's notebooks took it: every row is a frame, the filter steps once a row,
    /// means are over rows, and energy is the sum of each row's power times the time since the row
    /// before.
    Rows,
}

impl Default for ForceOptions {
    /// The first 50 fresh frames as tare, and the lab's 4th-order low-pass at 10 Hz, without its delay.
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
    /// 4th order at 10 Hz, zero-phase.
    fn default() -> Self {
        Self { cutoff_hz: 10.0, order: 4, zero_phase: true }
    }
}

impl ForceOptions {
    /// The calibration's own zero, unfiltered.
    pub const RAW: Self = Self {
        tare: TareRule::Untared,
        low_pass: None,
        low_pass_is_optional: false,
        rate_hz: None,
        rule: RowRule::Time,
    };

    /// The same with low-pass and zero `causal`, as they must be while a log is recorded, or else without delay.
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
    /// Whether the zero follows the stationary intervals.
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
            Self::Rests { causal: false } => f.write_str("straight between stretches at rest"),
            Self::Rests { causal: true } => f.write_str("that of the last stretch at rest"),
        }
    }
}

impl fmt::Display for LowPass {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let phase = if self.zero_phase { "zero-phase" } else { "causal" };
        write!(f, "{} Hz, order {}, {phase}", self.cutoff_hz, self.order)
    }
}
