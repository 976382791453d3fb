//! Selection of the rows of a log, for all tasks alike.

use calibration::Calibration;
use log_file::{Log, LogError, ReadOptions, ReadSummary, Wanted};
use shell_data::block::Block;

/// The rows of a log that are used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum RowFilter {
    All,
    /// Rows whose readings differ from those of the previous row: each frame once if a log runs faster than
    /// its sensor.
    Fresh,
}

/// Time window in s on the log's own clock, both ends included.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct TimeWindow {
    pub start_s: f64,
    pub end_s: f64,
}

impl RowFilter {
    pub fn select(self, block: &mut Block) {
        if self == RowFilter::Fresh {
            *block = block.kept(&block.fresh_rows());
        }
    }
}

/// For every row of a block: true if it is a frame. Duplicates of the previous row are not used if they are
/// stale by the kind of log, or if only fresh rows are used.
pub(super) fn fresh_rows(log: &Log, used: RowFilter, block: &Block) -> Vec<bool> {
    match log.repeats_are_stale() || used == RowFilter::Fresh {
        true => block.fresh_rows(),
        false => vec![true; block.rows],
    }
}

impl TimeWindow {
    pub fn contains(&self, time_s: f64) -> bool {
        self.start_s <= time_s && time_s <= self.end_s
    }
}

/// Reads a log as [`Log::read`] does, and adds the memory terms of a calibration, if it has any, to the blocks that
/// `work` gets. `numbers_rows` replaces times by row numbers from 0. In both cases `work` gets the blocks in order,
/// otherwise on any thread. `wanted` must include the time if the calibration needs it.
pub(super) fn read_with_memory<T: Send, E: From<LogError>>(
    log: &Log,
    (wanted, read): (&Wanted, &ReadOptions<'_>),
    (calibration, numbers_rows): (&Calibration, bool),
    work: impl Fn(&mut Block) -> T + Sync,
    mut fold: impl FnMut(T) -> Result<(), E>,
) -> Result<ReadSummary, E> {
    let mut memory = calibration.start_memory();
    if memory.is_none() && !numbers_rows {
        return log.read(wanted, read, work, fold);
    }
    let mut rows = 0;
    log.read(wanted, read, std::mem::take, |mut block| {
        if let Some(memory) = &mut memory {
            memory.extend(&mut block).expect("times, which were wanted");
        }
        if numbers_rows {
            block.time_s = (rows..rows + block.rows).map(|row| row as f64).collect();
            rows += block.rows;
        }
        fold(work(&mut block))
    })
}

/// Reason to stop reading before the end of a log: an error, or `None` if enough is known.
pub(super) type Stop = Option<LogError>;

/// The error of a read, if it has one; a read may stop early without an error.
pub(super) fn passed<T>(read: Result<T, Stop>) -> Result<(), LogError> {
    read.map_or_else(|stop| stop.map_or(Ok(()), Err), |_| Ok(()))
}
