//! Which rows of a log are used, for all jobs alike.

use calibration::Calibration;
use log_file::{Log, LogError, ReadOptions, ReadSummary, Wanted};
use shell_data::block::Block;

/// Which rows of a log are used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum RowFilter {
    /// Every row.
    All,
    /// Rows whose readings differ from those of the row before: each frame once, where a log runs
    /// faster than its sensor.
    Fresh,
}

/// A stretch of time, both ends included, in s on the log's own clock.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct TimeWindow {
    /// First instant.
    pub start_s: f64,
    /// Last instant.
    pub end_s: f64,
}

impl RowFilter {
    /// Leaves in `block` the rows that are used.
    pub fn select(self, block: &mut Block) {
        if self == RowFilter::Fresh {
            *block = block.kept(&block.fresh_rows());
        }
    }
}

/// For every row of a block, whether it is a frame: where repeats of the row before are stale, by the
/// kind of log or because only fresh rows are used, a repeat is not used.
pub(super) fn fresh_rows(log: &Log, used: RowFilter, block: &Block) -> Vec<bool> {
    match log.repeats_are_stale() || used == RowFilter::Fresh {
        true => block.fresh_rows(),
        false => vec![true; block.rows],
    }
}

impl TimeWindow {
    /// Whether an instant lies within.
    pub fn contains(&self, time_s: f64) -> bool {
        self.start_s <= time_s && time_s <= self.end_s
    }
}

/// Reads a log as [`Log::read`] does, for a calibration: where that has memory terms, `work` gets the blocks with
/// these, in order; otherwise on any thread.
///
/// # Errors
/// As [`Log::read`]; `wanted` has to have the time if the calibration needs it.
pub(super) fn read_with_memory<T: Send, E: From<LogError>>(
    log: &Log,
    (wanted, read): (&Wanted, &ReadOptions<'_>),
    calibration: &Calibration,
    work: impl Fn(&mut Block) -> T + Sync,
    mut fold: impl FnMut(T) -> Result<(), E>,
) -> Result<ReadSummary, E> {
    let Some(mut memory) = calibration.start_memory() else {
        return log.read(wanted, read, work, fold);
    };
    log.read(wanted, read, std::mem::take, |mut block| {
        memory.extend(&mut block).expect("times, which were wanted");
        fold(work(&mut block))
    })
}

/// Why a reading of a log ends before its end: an error, or `None` where enough is known.
pub(super) type Stop = Option<LogError>;

/// Passes on the error of a reading, which may have ended before the end of the log.
pub(super) fn passed<T>(read: Result<T, Stop>) -> Result<(), LogError> {
    read.map_or_else(|stop| stop.map_or(Ok(()), Err), |_| Ok(()))
}
