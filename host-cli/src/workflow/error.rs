//! Why a task over logs could not be done.

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

/// What to do where a log has no rows in a stretch of time.
pub(super) const TIMES: &str = "`shellcal info` tells the times of a log";

/// Why a task over logs could not be done.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WorkflowError {
    /// A log cannot be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The rows do not determine a calibration, or nothing of what was asked of them.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// Partial fits that cannot be merged.
    #[error(transparent)]
    Merge(MergeError),
    /// There was nothing to work on.
    #[error("no logs were given")]
    NoLogs,
    /// A calibration that cannot be brought up to date, or loads that do not serve for it.
    #[error(transparent)]
    Recalibration(#[from] RecalibrationError),
    /// The log at `path` gives no forces as asked.
    #[error("`{path}`: {error}")]
    Forces { path: String, error: ForceError },
    /// Standard errors were asked for by name, and cannot be given.
    #[error("the calibration carries no covariance, from which standard errors and intervals come")]
    NoCovariance,
    /// An interval was asked for that the calibration's groups cannot tell.
    #[error(transparent)]
    NoIntervals(#[from] NoIntervals),
    /// The result cannot be written.
    #[error("cannot write the result")]
    Output(#[from] io::Error),
    /// A file of it cannot be written.
    #[error(transparent)]
    File(#[from] OutputError),
    /// Settings that make no synthetic trial.
    #[error(transparent)]
    Settings(#[from] SimulationError),
    /// The poses do not tell what a sensor carries.
    #[error(transparent)]
    Payload(#[from] PayloadError),
    /// Two logs, the files of the reference and of the board, do not match, or not clearly.
    #[error("cannot align `{}` with `{}`", board.display(), reference.display())]
    Align { reference: PathBuf, board: PathBuf, source: AlignError },
    /// A trial cannot be evaluated on its log.
    #[error(transparent)]
    Trial(#[from] TrialError),
    /// The window of a trial was to be found, and cannot be.
    #[error("no window found")]
    Window(#[from] NoWindow),
    /// The window was to be found in forces, and the log gives none.
    #[error("no window found: there are no forces to find it in")]
    NoForces,
    /// The window was to be found in forces, which need a calibration.
    #[error("without a calibration there is no drag to find the window in")]
    NoCalibration,
    /// A log, a table or an option does not serve for what was asked: what nobody has to tell from other errors.
    /// `hint` is the next step, where one is known.
    #[error("{message}")]
    Refused { message: String, hint: Option<String> },
}

impl WorkflowError {
    /// What is wrong, with the next step where one is known.
    pub(super) fn refused<'a>(message: impl ToString, hint: impl Into<Option<&'a str>>) -> Self {
        Self::Refused { message: message.to_string(), hint: hint.into().map(str::to_owned) }
    }

    /// Whether two logs could be read and compared, but their match is not to be trusted.
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
    /// Sums that are not exact are an error of the fit, which has a hint of its own.
    fn from(error: MergeError) -> Self {
        match error {
            MergeError::NotExact(error) => FitError::NotExact(error).into(),
            error => WorkflowError::Merge(error),
        }
    }
}
