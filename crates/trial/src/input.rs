use serde::Serialize;

use super::profile::Profile;
use calibration::Calibration;
use forces::{ForceOptions, ForcePipeline};
use shell_data::telemetry::Telemetry;
use shell_data::wrench::PerAxis;

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trial {
    pub file: String,
    pub condition: String,
    /// Entry, s on the log's clock.
    pub t_enter_s: f64,
    pub t_exit_s: f64,
    /// Mean velocity, m/s. If `None`, it is the length of the channel divided by the time in the
    /// channel.
    pub velocity_m_s: Option<f64>,
    /// Mass, kg; `None` for the profile's.
    pub mass_kg: Option<f64>,
    /// Length of the channel, m; `None` for the profile's.
    pub channel_length_m: Option<f64>,
    pub notes: Option<String>,
}

impl Trial {
    pub fn from_window(file: String, (t_enter_s, t_exit_s): (f64, f64)) -> Self {
        Self { file, t_enter_s, t_exit_s, ..Self::default() }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LogTimes {
    pub first_s: f64,
    pub last_s: f64,
    pub period_s: f64,
}

/// Rows of a log, column by column: the rows in the window, and the rows around it that the low-pass
/// [needs](forces::PipelineSetup::needed_s).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrialRows {
    pub times_s: Vec<f64>,
    /// Readings of each channel, counts; no columns if the log has none.
    pub readings: Vec<Vec<f64>>,
    /// True if readings differ from the previous row.
    pub fresh: Vec<bool>,
    pub telemetry: Vec<(Telemetry, Vec<f64>)>,
}

impl TrialRows {
    pub fn telemetry(&self, wanted: Telemetry) -> Option<&[f64]> {
        self.telemetry.iter().find(|(kind, _)| *kind == wanted).map(|(_, column)| &**column)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TrialOptions {
    #[serde(flatten)]
    pub forces: ForceOptions,
    pub trace: TraceExtent,
    pub full_scale: f64,
    /// Share of the variance of the training loads that is unexplained, 1 − R². It is taken as the
    /// relative error on any load; this error does not average out.
    #[serde(skip)]
    pub unexplained: Option<PerAxis<f64>>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum TraceExtent {
    Nothing,
    Window,
    Log,
}

impl Default for TrialOptions {
    /// The default [`ForceOptions`], and a 12-bit converter.
    fn default() -> Self {
        Self {
            forces: ForceOptions::default(),
            trace: TraceExtent::Nothing,
            full_scale: 4095.0,
            unexplained: None,
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub struct Instrument<'a> {
    pub profile: &'a Profile,
    /// `None` for trials without forces.
    pub calibration: Option<&'a Calibration>,
}

#[derive(Clone, Copy, Debug)]
pub struct TrialInput<'a> {
    pub trial: &'a Trial,
    pub instrument: Instrument<'a>,
    pub times: &'a LogTimes,
    pub rows: &'a TrialRows,
    /// Pipeline with the frames of the tare, if there is a tare; `None` for trials without forces.
    pub pipeline: Option<&'a ForcePipeline>,
    pub options: &'a TrialOptions,
}
