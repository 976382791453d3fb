//! How trials are evaluated.

use serde::Serialize;

use shell_data::wrench::PerAxis;

/// How trials are evaluated.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TrialOptions {
    /// What is taken as unloaded.
    pub tare: TareRule,
    /// The low-pass over the forces; `None` for none.
    pub low_pass: Option<LowPass>,
    /// Rows in a second, where the filter is not to take the log's word for it, Hz.
    pub rate_hz: Option<f64>,
    /// What a row stands for.
    pub rule: Rule,
    /// What is kept to draw or to write.
    pub trace: TraceExtent,
    /// The highest reading that the converter can give, counts.
    pub full_scale: f64,
    /// The share of the training loads' variance that the calibration leaves unexplained, 1 − R²,
    /// where it is known: what it gets wrong of any load, whatever the number of frames.
    #[serde(skip)]
    pub unexplained: Option<PerAxis<f64>>,
}

/// What is taken as unloaded; its mean wrench is subtracted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum TareRule {
    /// The calibration's own zero.
    Untared,
    /// The first frames of the log: each frame once under [`Rule::Time`], rows under [`Rule::Rows`].
    First(usize),
    /// The frames from one time to another, s on the log's clock.
    Between(f64, f64),
}

/// A Butterworth low-pass.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LowPass {
    /// Where a causal filter attenuates to 1/√2, and one without delay to 1/2, Hz.
    pub cutoff_hz: f64,
    /// Number of poles.
    pub order: usize,
    /// Forward and backward, without delay.
    pub zero_phase: bool,
}

/// What a row stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Rule {
    /// The moment that its clock shows. Missing rows are held for the filter; means and integrals are
    /// over time, straight between rows.
    Time,
    /// A sample, as the lab's notebooks took it: the filter steps once a row, means are over rows, and
    /// energy is the sum of each row's power times the time since the row before.
    Rows,
}

/// What is kept of a trial beside its results.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum TraceExtent {
    /// Nothing.
    Nothing,
    /// The window.
    Window,
    /// The whole log.
    Log,
}

impl Default for TrialOptions {
    /// The first 50 frames as tare, and the lab's 4th-order low-pass at 10 Hz, without its delay.
    fn default() -> Self {
        Self {
            tare: TareRule::First(50),
            low_pass: Some(LowPass { cutoff_hz: 10.0, order: 4, zero_phase: true }),
            rate_hz: None,
            rule: Rule::Time,
            trace: TraceExtent::Nothing,
            full_scale: 4095.0,
            unexplained: None,
        }
    }
}
