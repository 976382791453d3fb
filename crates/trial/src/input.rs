//! What a trial is evaluated on, and how.

use serde::Serialize;

use super::profile::Profile;
use calibration::Calibration;
use forces::{ForceOptions, ForcePipeline};
use shell_data::telemetry::Telemetry;
use shell_data::wrench::PerAxis;

/// What is to be evaluated.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trial {
    /// The log, as the manifest names it.
    pub file: String,
    /// The condition.
    pub condition: String,
    /// When the robot enters the channel, s on the log's clock.
    pub t_enter_s: f64,
    /// When it leaves, s.
    pub t_exit_s: f64,
    /// Mean velocity, m/s; `None` for the channel's length over the time in it.
    pub velocity_m_s: Option<f64>,
    /// Mass, kg; `None` for the profile's.
    pub mass_kg: Option<f64>,
    /// Length of the channel, m; `None` for the profile's.
    pub channel_length_m: Option<f64>,
    /// What the manifest says of it.
    pub notes: Option<String>,
}

impl Trial {
    /// The trial of a log between two times, of which nothing else is said.
    pub fn from_window(file: String, (t_enter_s, t_exit_s): (f64, f64)) -> Self {
        Self { file, t_enter_s, t_exit_s, ..Self::default() }
    }
}

/// The times of the rows of a whole log.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LogTimes {
    /// Time of the first row, s.
    pub first_s: f64,
    /// Time of the last row, s.
    pub last_s: f64,
    /// The usual time from row to row, s.
    pub period_s: f64,
}

/// The rows of a log that a trial needs, column by column: the window, and around it what the
/// low-pass [needs](forces::PipelineSetup::needed_s).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrialRows {
    /// Time of each row, s, ascending.
    pub times_s: Vec<f64>,
    /// Readings of each channel, counts; without columns if the log has none.
    pub readings: Vec<Vec<f64>>,
    /// Whether a row's readings differ from those of the row before.
    pub fresh: Vec<bool>,
    /// The columns of telemetry that the log has, in counts.
    pub telemetry: Vec<(Telemetry, Vec<f64>)>,
}

impl TrialRows {
    /// A column of telemetry, in counts.
    pub fn telemetry(&self, wanted: Telemetry) -> Option<&[f64]> {
        self.telemetry.iter().find(|(kind, _)| *kind == wanted).map(|(_, column)| &**column)
    }
}

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

/// What trials are evaluated with.
#[derive(Clone, Copy, Debug)]
pub struct Instrument<'a> {
    /// The robot.
    pub profile: &'a Profile,
    /// The calibration of its shell; without one there are no forces.
    pub calibration: Option<&'a Calibration>,
}

/// A trial, and all that its results are computed from.
#[derive(Clone, Copy, Debug)]
pub struct TrialInput<'a> {
    /// What is evaluated.
    pub trial: &'a Trial,
    /// What it is evaluated with.
    pub instrument: Instrument<'a>,
    /// The times of its log.
    pub times: &'a LogTimes,
    /// The rows around its window.
    pub rows: &'a TrialRows,
    /// From its readings to forces, with the frames of the tare if there is one; `None` where there are no forces.
    pub pipeline: Option<&'a ForcePipeline>,
    /// How it is evaluated.
    pub options: &'a TrialOptions,
}
