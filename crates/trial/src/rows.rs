//! The part of a log that a trial is evaluated on.

use shell_data::telemetry::Telemetry;

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
