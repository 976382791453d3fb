//! How trials are evaluated.

use serde::Serialize;

use forces::ForceOptions;
use shell_data::wrench::PerAxis;

/// How trials are evaluated.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TrialOptions {
    /// How readings become forces.
    #[serde(flatten)]
    pub forces: ForceOptions,
    /// What is kept to draw or to write.
    pub trace: TraceExtent,
    /// The highest reading that the converter can give, counts.
    pub full_scale: f64,
    /// The share of the training loads' variance that the calibration leaves unexplained, 1 − R²,
    /// where it is known: what it gets wrong of any load, whatever the number of frames.
    #[serde(skip)]
    pub unexplained: Option<PerAxis<f64>>,
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
    /// The usual [`ForceOptions`], and a 12-bit converter.
    fn default() -> Self {
        Self {
            forces: ForceOptions::default(),
            trace: TraceExtent::Nothing,
            full_scale: 4095.0,
            unexplained: None,
        }
    }
}
