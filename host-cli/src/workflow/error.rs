//! Why a task over logs could not be done.

use std::path::PathBuf;

use super::convert::ConvertError;
use calibration::FitError;
use calibration::fit::HoldMismatch;
use calibration::recalibration::RecalibrationError;
use calibration_file::MergeError;
use forces::drift::FEWEST_RESTS;
use log_file::LogError;
use shell_data::hint::{Hint, OTHER_CHANNELS};
use shell_data::wrench::Axes;

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
    /// A log has another number of channels than the calibration, or than the first log.
    #[error(transparent)]
    Channels(#[from] ChannelMismatch),
    /// Two training logs have different axes of the wrench.
    #[error("`{}` has the axes {found} of the wrench, the logs before it have {expected}", path.display())]
    Axes {
        /// The log.
        path: PathBuf,
        /// Axes of the first log.
        expected: Axes,
        /// Axes of the log.
        found: Axes,
    },
    /// Partial fits that cannot be merged.
    #[error(transparent)]
    Merge(MergeError),
    /// There was nothing to work on.
    #[error("no logs were given")]
    NoLogs,
    /// There is no group column, and loads cannot be told by still readings.
    #[error(transparent)]
    Holds(#[from] HoldMismatch),
    /// No row has the label of a load.
    #[error(
        "no row has the label of a load: the first label is `{found}`, the first load `{load}`"
    )]
    NoLabels {
        /// A label of the logs.
        found: String,
        /// One of the table.
        load: String,
    },
    /// Every load has the mass 0.
    #[error("no weight hangs in any line of the table")]
    NoWeight,
    /// The calibration has no intervals. In a box, as two large errors make one that is larger.
    #[error(transparent)]
    Convert(#[from] Box<ConvertError>),
    /// A calibration that cannot be brought up to date, or loads that do not serve for it.
    #[error(transparent)]
    Recalibration(#[from] RecalibrationError),
    /// Too few frames to scatter.
    #[error("`{path}` has `{found}` frames to tell the noise from, at least 2 are needed")]
    TooFewFrames {
        /// The log.
        path: String,
        /// Frames found.
        found: u64,
    },
    /// Too few rests to tell a drift.
    #[error(
        "`{path}` has `{found}` stretches at rest, {FEWEST_RESTS} at least are needed to tell a drift"
    )]
    TooFewRests {
        /// The log.
        path: String,
        /// Stretches found.
        found: usize,
    },
    /// A temperature that is no number.
    #[error("`{path}`: `{text}` in column `{column}` is no temperature")]
    Temperature {
        /// The log.
        path: String,
        /// The column.
        column: String,
        /// What stands there.
        text: String,
    },
}

impl Hint for WorkflowError {
    fn hint(&self) -> Option<String> {
        let text = match self {
            Self::Log(error) => return error.hint(),
            Self::Fit(error) => return error.hint(),
            Self::Channels(error) => return error.hint(),
            Self::Merge(error) => return error.hint(),
            Self::Convert(error) => return error.hint(),
            Self::Holds(_) => {
                "give the log a group column with the labels of the table, as `live --plan` writes it"
            }
            Self::NoLabels { .. } => "name the log's column of labels with `--group`",
            Self::Recalibration(RecalibrationError::NoErrors) => {
                "an imported matrix says nothing of its errors: fit anew, without `--from`"
            }
            Self::TooFewFrames { .. } => "`shellcal info` tells the times of a log",
            Self::TooFewRests { .. } => {
                "begin with the sensor at rest and unloaded, and let it rest for a second or more now and then"
            }
            Self::Temperature { .. } => "name the column of temperature with `--temperature`",
            Self::Axes { .. } | Self::NoLogs | Self::NoWeight | Self::Recalibration(_) => {
                return None;
            }
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

/// A log of another number of channels than the calibration, or than the first log.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{}` has `{found}` sensor channels, expected `{expected}`", path.display())]
pub struct ChannelMismatch {
    /// The log.
    pub path: PathBuf,
    /// Channels of the calibration or of the first log.
    pub expected: usize,
    /// Channels of the log.
    pub found: usize,
}

impl Hint for ChannelMismatch {
    fn hint(&self) -> Option<String> {
        Some(OTHER_CHANNELS.to_owned())
    }
}
