//! What a report is made from.

use serde::Serialize;

use super::outliers::OutlierTable;
use calibration::quality::AxisQuality;
use calibration::validation::cross_validation::CrossValidation;
use shell_data::wrench::{Axes, PerAxis};
use trial::{ConditionRow, PhaseProfile, TrialResult};

/// Traces of so many trials are drawn at most: a report is to stay readable, and below 10 MB.
pub(crate) const MOST_TRACES: usize = 100;

/// What a report is about, and where it comes from.
#[derive(Clone, Copy, Debug)]
pub struct Heading<'a> {
    /// What it is about.
    pub title: &'a str,
    /// Program and version.
    pub made_by: &'a str,
    /// When, in UTC, RFC 3339.
    pub date: &'a str,
    /// The command line that makes it again.
    pub command: &'a str,
}

impl Heading<'_> {
    /// Who made it, and when.
    pub(crate) fn made(&self) -> String {
        format!("{}, {}.", self.made_by, self.date)
    }
}

/// What a report says. Times are in s on each log's clock, all else in SI units.
#[derive(Clone, Debug)]
pub struct Report<'a> {
    /// What it is about, and where it comes from.
    pub heading: Heading<'a>,
    /// The results, in the manifest's order, with a thinned trace of the log where one is to be drawn.
    pub trials: &'a [TrialResult],
    /// Trials that could not be evaluated: file, and why.
    pub failed: &'a [(String, String)],
    /// The statistics by condition, in the order in which conditions are to be shown.
    pub conditions: &'a [ConditionRow],
    /// Drag and lift over a stride, by condition.
    pub phases: &'a [(String, PhaseProfile)],
    /// How trials were evaluated: name and value.
    pub settings: &'a [(String, String)],
    /// What converted the readings; `None` for logs without sensors.
    pub calibration: Option<CalibrationFacts<'a>>,
    /// Length of the robot, m, if known: for the shading of entering and leaving.
    pub robot_length_m: Option<f64>,
    /// Length of the channel, m.
    pub channel_length_m: f64,
    /// What went in.
    pub inputs: &'a [Input],
    /// Rows in the windows with a reading that cannot be trusted; `None` without forces.
    pub doubtful: Option<OutlierTable>,
    /// Warnings that are not of one trial.
    pub warnings: &'a [String],
}

/// A calibration, and what is known of how it was made.
#[derive(Clone, Debug)]
pub struct CalibrationFacts<'a> {
    /// Name and value of what identifies it, in order.
    pub facts: Vec<(&'static str, String)>,
    /// The axes of the wrench that it gives.
    pub axes: Axes,
    /// Its errors on the training data, if known.
    pub train: Option<&'a PerAxis<AxisQuality>>,
    /// Its errors on groups that were held out, if known.
    pub cross_validation: Option<&'a CrossValidation>,
    /// Its errors on test data, if known.
    pub test: Option<&'a PerAxis<AxisQuality>>,
    /// What it was made from.
    pub sources: Vec<CalibrationSource>,
}

/// A log that a calibration was made from.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibrationSource {
    /// What it was used for: "fit", "test".
    pub role: &'static str,
    /// The file.
    pub path: String,
    /// Rows of it.
    pub rows: u64,
    /// Its checksum, if known.
    pub checksum: Option<String>,
}

/// A file that went in.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Input {
    /// What it was used as: "log", "manifest", "calibration", "profile".
    pub role: String,
    /// The file as it was named.
    pub path: String,
    /// Its size.
    pub bytes: u64,
    /// As `log_file::checksum` gives it.
    pub checksum: String,
}
