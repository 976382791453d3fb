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

/// Hint for a log without rows in a time window.
pub(super) const TIMES: &str = "`shellcal info` tells the times of a log";

/// Error of a task over logs.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WorkflowError {
    /// A log cannot be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The rows do not determine a calibration, or no rows remain.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// Partial fits cannot be merged.
    #[error(transparent)]
    Merge(MergeError),
    /// No logs were given.
    #[error("no logs were given")]
    NoLogs,
    /// A calibration cannot be updated, or the loads do not suit an update.
    #[error(transparent)]
    Recalibration(#[from] RecalibrationError),
    /// The log at `path` does not give the requested forces.
    #[error("`{path}`: {error}")]
    Forces { path: String, error: ForceError },
    /// Standard errors were requested explicitly, but the calibration has none.
    #[error("the calibration carries no covariance, from which standard errors and intervals come")]
    NoCovariance,
    /// An interval was requested that the calibration's groups cannot determine.
    #[error(transparent)]
    NoIntervals(#[from] NoIntervals),
    /// The result cannot be written.
    #[error("cannot write the result")]
    Output(#[from] io::Error),
    /// A result file cannot be written.
    #[error(transparent)]
    File(#[from] OutputError),
    /// Settings do not define a valid synthetic trial.
    #[error(transparent)]
    Settings(#[from] SimulationError),
    /// The poses do not determine the payload.
    #[error(transparent)]
    Payload(#[from] PayloadError),
    /// Two logs, given as the files of the reference and of the board, have no match or no clear match.
    #[error("cannot align `{}` with `{}`", board.display(), reference.display())]
    Align { reference: PathBuf, board: PathBuf, source: AlignError },
    /// A trial cannot be evaluated on its log.
    #[error(transparent)]
    Trial(#[from] TrialError),
    /// The window of a trial was to be detected, but could not be.
    #[error("no window found")]
    Window(#[from] NoWindow),
    /// The window was to be detected from forces, but the log has none.
    #[error("no window found: there are no forces to find it in")]
    NoForces,
    /// The window was to be detected from forces, which need a calibration.
    #[error("without a calibration there is no drag to find the window in")]
    NoCalibration,
    /// A log, a table or an option does not suit the task: errors that callers need not tell apart. `hint`
    /// is the next step, if known.
    #[error("{message}")]
    Refused { message: String, hint: Option<String> },
}

impl WorkflowError {
    /// A refusal with its message and, if known, the next step.
    pub(super) fn refused<'a>(message: impl ToString, hint: impl Into<Option<&'a str>>) -> Self {
        Self::Refused { message: message.to_string(), hint: hint.into().map(str::to_owned) }
    }

    /// True if two logs were read and compared, but their match cannot be trusted.
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
                "leave out `--interval`, and `se` of `--columns`; `shellcal fit` puts a covariance into the calibration unless there are fewer than twice as many groups as features, or `--covariance none`"
            }
            _ => return None,
        };
        Some(text.to_owned())
    }
}

impl From<MergeError> for WorkflowError {
    /// Inexact sums are an error of the fit, which has its own hint.
    fn from(error: MergeError) -> Self {
        match error {
            MergeError::NotExact(error) => FitError::NotExact(error).into(),
            error => WorkflowError::Merge(error),
        }
    }
}
