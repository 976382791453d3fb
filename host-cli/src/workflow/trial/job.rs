//! A log on which trials are evaluated.

use log_file::{Log, ReadOptions};
use trial::{Instrument, TrialOptions};

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
