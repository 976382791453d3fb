//! A log on which trials are evaluated.

use log_file::{Log, LogError, ReadOptions};
use shell_data::hint::Hint;
use trial::{Instrument, NoWindow, TrialError, TrialOptions};

/// A log, and how trials on it are evaluated.
#[derive(Clone, Copy)]
pub struct TrialJob<'a> {
    /// The log.
    pub log: &'a Log,
    /// Robot and calibration.
    pub instrument: Instrument<'a>,
    /// How trials are evaluated.
    pub options: TrialOptions,
    /// How the log is read.
    pub read: ReadOptions<'a>,
}

/// A trial that could not be evaluated on its log.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrialLogError {
    /// The log cannot be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The trial cannot be evaluated on it.
    #[error(transparent)]
    Trial(#[from] TrialError),
    /// The window was to be found, and cannot be.
    #[error("no window found")]
    Window(#[from] NoWindow),
    /// The window was to be found in forces, and the log gives none.
    #[error("no window found: there are no forces to find it in")]
    NoForces,
    /// The window was to be found in forces, which need a calibration.
    #[error("without a calibration there is no drag to find the window in")]
    NoCalibration,
}

impl Hint for TrialLogError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::Log(error) => error.hint(),
            Self::Trial(error) => error.hint(),
            _ => None,
        }
    }
}
