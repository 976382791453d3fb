//! Whole tasks over logs: reading joined to the core, without printing and without files written.

pub mod align;
pub mod convert;
pub mod eval;
pub mod fit;
pub mod noise;
pub mod sampling;
pub mod selection;

use std::path::PathBuf;

use crate::calibration::FitError;
use crate::log_file::{Log, LogError};

/// Why a task over logs could not be done.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WorkflowError {
    /// A log cannot be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The rows do not determine a calibration.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// A log has another number of channels than the calibration, or than the first log.
    #[error("`{}` has `{found}` channels, expected `{expected}`", path.display())]
    Channels {
        /// The log.
        path: PathBuf,
        /// Channels of the calibration or the first log.
        expected: usize,
        /// Channels of the log.
        found: usize,
    },
    /// There was nothing to work on.
    #[error("no logs were given")]
    NoLogs,
}

fn check_channels(log: &Log, expected: usize) -> Result<(), WorkflowError> {
    let found = log.channels();
    if found == expected {
        return Ok(());
    }
    Err(WorkflowError::Channels { path: log.path().to_path_buf(), expected, found })
}
