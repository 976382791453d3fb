//! Whole tasks over logs: reading joined to the core, without printing and without files written.

pub mod align;
pub mod batch;
pub mod bench;
pub mod certificate;
pub mod check;
pub mod convert;
pub mod drift;
pub mod figures;
pub mod fit;
pub mod fit_report;
pub mod gates;
pub mod hung_loads;
pub mod live;
pub mod merge;
pub mod noise;
pub mod outliers;
pub mod partial;
pub mod payload;
pub mod plan;
pub mod recalibration;
pub mod remark;
pub mod report;
pub mod selection;
pub mod simulate;
pub mod synthetic_trials;
pub mod trial;

use shell_data::hint::{Hint, OTHER_CHANNELS};
use std::path::PathBuf;

use calibration::FitError;
use calibration_file::MergeError;
use log_file::{Log, LogError, Wanted};
use shell_data::wrench::Axes;

/// Why a task over logs could not be done.
#[derive(Debug, thiserror::Error)]
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
}

impl Hint for WorkflowError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::Log(error) => error.hint(),
            Self::Fit(error) => error.hint(),
            Self::Channels(error) => error.hint(),
            Self::Merge(error) => error.hint(),
            Self::Axes { .. } | Self::NoLogs => None,
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

/// The axes of the wrench that a fit to `train` is of, which all of them have; of the others in `test`,
/// which have these, too, no more are used.
///
/// # Errors
/// [`WorkflowError::Axes`] if the training logs have different ones, [`LogError::At`] if a log
/// has none or a test log lacks some.
pub fn agree_on_axes(train: &[Log], test: &mut [Log]) -> Result<Axes, WorkflowError> {
    let first = train.first().ok_or(WorkflowError::NoLogs)?;
    let expected = first.axes();
    for log in train {
        log.require(&Wanted { readings: true, wrench: true, ..Wanted::default() })?;
        let found = log.axes();
        if found != expected {
            return Err(WorkflowError::Axes { path: log.path().into(), expected, found });
        }
    }
    test.iter_mut().try_for_each(|log| log.keep_axes(expected))?;
    Ok(expected)
}

/// The first of `logs`, if all, and `others` beside them, have what is wanted and as many channels as it.
fn check_logs<'a>(
    logs: &'a [Log],
    others: &[Log],
    wanted: &Wanted,
) -> Result<&'a Log, WorkflowError> {
    let first = logs.first().ok_or(WorkflowError::NoLogs)?;
    for log in logs.iter().chain(others) {
        log.require(wanted)?;
        check_channels(log, first.channels())?;
    }
    Ok(first)
}

/// Checks that a log has so many channels.
///
/// # Errors
/// [`ChannelMismatch`].
pub fn check_channels(log: &Log, expected: usize) -> Result<(), ChannelMismatch> {
    let found = log.channels();
    if found == expected {
        return Ok(());
    }
    Err(ChannelMismatch { path: log.path().to_path_buf(), expected, found })
}
