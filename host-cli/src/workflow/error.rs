//! Errors of tasks over logs.

use std::io;
use std::path::PathBuf;

use alignment::AlignError;
use calibration::FitError;
use calibration::recalibration::RecalibrationError;
use calibration::uncertainty::NoIntervals;
use calibration_file::MergeError;
use forces::ForceError;
use forces::payload::PayloadError;
use log_file::LogError;
use output_file::OutputError;
use shell_data::hint::Hint;
use simulation::SimulationError;
use trial::{NoWindow, TrialError};

/// Hint for a log without rows in a time range.
pub(super) const TIMES: &str = "`shellcal info` tells the times of a log";

/// The reason why a task over logs failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WorkflowError {
    /// A log cannot be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The rows do not determine a calibration, or nothing that was asked of them.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// Partial fits cannot be merged.
    #[error(transparent)]
    Merge(MergeError),
    /// No logs were given.
    #[error("no logs were given")]
    NoLogs,
    /// A calibration that cannot be updated, or loads that do not serve for it.
    #[error(transparent)]
    Recalibration(#[from] RecalibrationError),
    /// The log at `path` does not give forces with the requested options.
    #[error("`{path}`: {error}")]
    Forces { path: String, error: ForceError },
    /// Standard errors were explicitly requested, but are not available.
    #[error("the calibration has no covariance, which standard errors and intervals need")]
    NoCovariance,
    /// An interval was requested that the calibration's groups cannot support.
    #[error(transparent)]
    NoIntervals(#[from] NoIntervals),
    /// The result cannot be written.
    #[error("cannot write the result")]
    Output(#[from] io::Error),
    /// An output file cannot be written.
    #[error(transparent)]
    File(#[from] OutputError),
    /// Settings that do not define a synthetic trial.
    #[error(transparent)]
    Settings(#[from] SimulationError),
    /// The poses do not determine the payload of a sensor.
    #[error(transparent)]
    Payload(#[from] PayloadError),
    /// A log of the reference and one of the board do not match, or not clearly.
    #[error("cannot align `{}` with `{}`", board.display(), reference.display())]
    Align { reference: PathBuf, board: PathBuf, source: AlignError },
    /// A trial cannot be evaluated on its log.
    #[error(transparent)]
    Trial(#[from] TrialError),
    /// The window of a trial was to be found, but cannot be.
    #[error("no window found")]
    Window(#[from] NoWindow),
    /// The window was to be found in forces, but the log gives none.
    #[error("no window found: there are no forces to find it in")]
    NoForces,
    /// The window was to be detected from forces, which need a calibration.
    #[error("without a calibration there is no drag to find the window in")]
    NoCalibration,
    /// A log, a table or an option does not serve the request. Callers have no need to tell these errors
    /// apart. `hint` is the next step, if one is known.
    #[error("{message}")]
    Refused { message: String, hint: Option<String> },
}

impl WorkflowError {
    /// An error with this message, and the next step if one is known.
    pub(super) fn refused<'a>(message: impl ToString, hint: impl Into<Option<&'a str>>) -> Self {
        Self::Refused { message: message.to_string(), hint: hint.into().map(str::to_owned) }
    }

    /// True if two logs could be read and compared, but their match is not trustworthy.
    pub fn is_refusal(&self) -> bool {
        matches!(self, Self::Align { source, .. } if source.is_refusal())
    }
}

impl Hint for WorkflowError {
    fn hint(&self) -> Option<String> {
        let text = match self {
            Self::Log(error) => return error.hint(),
            Self::Fit(error) => return error.hint(),
            Self::Merge(error) => return error.hint(),
            Self::File(error) => return error.hint(),
            Self::Payload(error) => return error.hint(),
            Self::Align { source, .. } => return source.hint(),
            Self::Trial(error) => return error.hint(),
            Self::Refused { hint, .. } => return hint.clone(),
            Self::Recalibration(RecalibrationError::NoErrors) => {
                "an imported matrix says nothing of its errors: fit anew, without `--from`"
            }
            Self::Forces { error, .. } => match error {
                ForceError::TareFrames { .. } => "take fewer frames with `--tare`, or `--no-tare`",
                ForceError::TareTime { .. } => TIMES,
                ForceError::NoRate(_) => {
                    "say how many rows there are in a second with `--rate`, or leave the filter out with `--no-lowpass`"
                }
                ForceError::Filter(error) => return error.hint(),
            },
            Self::NoIntervals(NoIntervals::IndependentRows) => {
                "fit again without `--model` or with groups (`--group`), or ask for standard errors alone"
            }
            Self::NoCovariance => {
                "leave out `--interval` and `se` of `--columns`, or fit with twice as many groups as \
                 features"
            }
            _ => return None,
        };
        Some(text.to_owned())
    }
}

impl From<MergeError> for WorkflowError {
    /// Converts the error; sums that are not exact become an error of the fit, which has a hint for them.
    fn from(error: MergeError) -> Self {
        match error {
            MergeError::NotExact(error) => FitError::NotExact(error).into(),
            error => WorkflowError::Merge(error),
        }
    }
}
