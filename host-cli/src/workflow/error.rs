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

pub(super) const TIMES: &str = "`shellcal info` tells the times of a log";

#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WorkflowError {
    #[error(transparent)]
    Log(#[from] LogError),
    #[error(transparent)]
    Fit(#[from] FitError),
    #[error(transparent)]
    Merge(MergeError),
    #[error("no logs were given")]
    NoLogs,
    /// A calibration that cannot be updated, or loads that are unsuitable for an update.
    #[error(transparent)]
    Recalibration(#[from] RecalibrationError),
    #[error("`{path}`: {error}")]
    Forces { path: String, error: ForceError },
    /// Standard errors were explicitly requested, but are not available.
    #[error("the calibration has no covariance, which standard errors and intervals need")]
    NoCovariance,
    /// An interval was requested that the calibration's groups cannot support.
    #[error(transparent)]
    NoIntervals(#[from] NoIntervals),
    #[error("cannot write the result")]
    Output(#[from] io::Error),
    #[error(transparent)]
    File(#[from] OutputError),
    #[error(transparent)]
    Settings(#[from] SimulationError),
    #[error(transparent)]
    Payload(#[from] PayloadError),
    #[error("cannot align `{}` with `{}`", board.display(), reference.display())]
    Align { reference: PathBuf, board: PathBuf, source: AlignError },
    #[error(transparent)]
    Trial(#[from] TrialError),
    #[error("no window found")]
    Window(#[from] NoWindow),
    #[error("no window found: there are no forces to find it in")]
    NoForces,
    #[error("without a calibration there is no drag to find the window in")]
    NoCalibration,
    /// A log, a table or an option is unsuitable for the request. Callers have no need to tell these errors
    /// apart. `hint` is the next step, if one is known.
    #[error("{message}")]
    Refused { message: String, hint: Option<String> },
}

impl WorkflowError {
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
            Self::Window(_) | Self::NoForces => {
                "give the times with `--enter` and `--exit`, or in the manifest"
            }
            Self::NoCalibration => {
                "name one with `--calibration`, or give the times with `--enter` and `--exit`, or in the manifest"
            }
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
