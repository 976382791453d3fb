//! Reading logs into memory.

use super::all::read_each;
use super::request::{ReadOptions, Wanted};
use crate::error::LogError;
use crate::log::Log;
use shell_data::block::Block;
use shell_data::dataset::{BlockLines, Dataset, LogRows, ReadSummary};

/// Reads all rows of some logs into memory, of each log what is wanted of it: time, readings, wrench and
/// groups. [`sample_logs`] takes a sample of them.
///
/// # Errors
/// As [`Log::read`], the first error in the order of logs and rows.
pub fn read_dataset(
    logs: &[(&Log, Wanted)],
    options: &ReadOptions<'_>,
) -> Result<Dataset, LogError> {
    let rows = |(log, wanted): &(&Log, Wanted)| LogRows {
        name: log.path().to_path_buf(),
        axes: log.axes(),
        channels: log.channels(),
        has_groups: wanted.groups,
        is_sampled_at_start: log.is_compressed(),
        sample: Block::default(),
        summary: ReadSummary::default(),
        lines: BlockLines::default(),
        blocks: Vec::new(),
    };
    let mut data = Dataset { logs: logs.iter().map(rows).collect() };
    // A copy takes what it needs and no more; the block stays, as memory for the next.
    let copy = |(): &mut (), _, block: &mut Block| Block {
        rows: block.rows,
        offset: block.offset,
        time_s: block.time_s.clone(),
        readings: block.readings.clone(),
        wrench: block.wrench.clone(),
        groups: block.groups.clone(),
        readings_before: block.readings_before.clone(),
        ..Block::default()
    };
    let keep = |log: usize, block: Block| {
        data.logs[log].blocks.push(block.into());
        Ok::<_, LogError>(())
    };
    let (found, _) = read_each(logs, options, || (), copy, keep)?;
    data.logs.iter_mut().zip(found).for_each(|(log, found)| (log.summary, log.lines) = found);
    Ok(data)
}

/// Reads the same of some logs, and takes a sample of each.
///
/// # Errors
/// As [`read_dataset`].
pub fn read_logs(
    logs: &[Log],
    wanted: &Wanted,
    options: &ReadOptions<'_>,
) -> Result<Dataset, LogError> {
    let asked: Vec<(&Log, Wanted)> = logs.iter().map(|log| (log, wanted.clone())).collect();
    let mut data = read_dataset(&asked, options)?;
    sample_logs(&mut data, logs, wanted)?;
    Ok(data)
}

/// Takes a sample of each log of a data set, of what is wanted of it but for its groups.
///
/// # Errors
/// As [`Log::sample`].
pub fn sample_logs<'a>(
    data: &mut Dataset,
    logs: impl IntoIterator<Item = &'a Log>,
    wanted: &Wanted,
) -> Result<(), LogError> {
    let wanted = Wanted { groups: false, ..wanted.clone() };
    for (rows, log) in data.logs.iter_mut().zip(logs) {
        rows.sample = log.sample(&wanted)?;
    }
    Ok(())
}
