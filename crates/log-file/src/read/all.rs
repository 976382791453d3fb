//! Reading all rows of one log or several, in parallel.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use super::request::{ReadOptions, Wanted};
use crate::error::LogError;
use crate::log::Log;
use crate::parse::plan::{BlockBuffer, ReadPlan};
use crate::stream::log_chunks::{LogChunk, LogChunks};
use crate::stream::pipeline;
use shell_data::ReadSummary;
use shell_data::block::Block;

impl Log {
    /// Streams the whole log once: `map` gets its blocks on worker threads, `fold` gets the results
    /// of `map` on the caller's thread, in file order. `map` may take the columns of a block; what
    /// it leaves is memory for the next block.
    ///
    /// # Errors
    /// [`LogError`] if wanted columns are missing, the file cannot be read, has no rows, or has a
    /// bad row (unless those are skipped); and the errors of `fold`, which end the reading. The
    /// first error in file order is returned, for any number of threads.
    pub fn read<T: Send, E: From<LogError>>(
        &self,
        wanted: &Wanted,
        options: &ReadOptions<'_>,
        map: impl Fn(&mut Block) -> T + Sync,
        mut fold: impl FnMut(T) -> Result<(), E>,
    ) -> Result<ReadSummary, E> {
        let map = |(): &mut (), _, block: &mut Block| map(block);
        let fold = |_, value| fold(value);
        let (mut summaries, _) = read_all(&[(self, wanted.clone())], options, || (), map, fold)?;
        Ok(summaries.pop().expect("one summary per log"))
    }

    /// Reads all rows into one block.
    ///
    /// # Errors
    /// As [`Log::read`].
    pub fn read_whole(
        &self,
        wanted: &Wanted,
        options: &ReadOptions<'_>,
    ) -> Result<(Block, ReadSummary), LogError> {
        let mut whole = Block::default();
        let summary = self.read(wanted, options, std::mem::take, |block| {
            whole.join(block);
            Ok::<_, LogError>(())
        })?;
        Ok((whole, summary))
    }
}

/// The most text that is read by one thread: another would be ready when it is done.
const READ_ALONE: u64 = 256 << 10;

/// The number of threads that read some logs, or work on the rows of such logs.
pub fn threads_for(logs: &[&Log], options: &ReadOptions<'_>) -> usize {
    let is_plain = logs.iter().all(|log| log.source.is_plain());
    let bytes: u64 = logs.iter().map(|log| log.bytes()).sum();
    match options.threads {
        0 if is_plain && bytes <= READ_ALONE => 1,
        _ => options.thread_count(),
    }
}

/// Streams all of `logs` once, of each what is wanted, as [`Log::read`] does one of them, with a state for every
/// worker thread, made by `init` and passed to `map`: `map` and `fold` also get the index of the log that a block is
/// from. Returns a summary of each log and the states, these in no particular order.
///
/// # Errors
/// As [`Log::read`], the first error in the order of logs and rows.
pub fn read_all<S: Send, T: Send, E: From<LogError>>(
    logs: &[(&Log, Wanted)],
    options: &ReadOptions<'_>,
    init: impl Fn() -> S + Sync,
    map: impl Fn(&mut S, usize, &mut Block) -> T + Sync,
    mut fold: impl FnMut(usize, T) -> Result<(), E>,
) -> Result<(Vec<ReadSummary>, Vec<S>), E> {
    let plan = |(log, wanted): &(&Log, Wanted)| {
        log.require(wanted)?;
        Ok::<_, LogError>(ReadPlan::new(&log.layout, wanted))
    };
    let plans: Vec<ReadPlan> = logs.iter().map(plan).collect::<Result<_, _>>()?;
    let logs: Vec<&Log> = logs.iter().map(|(log, _)| *log).collect();
    let logs = &logs[..];
    let threads = threads_for(logs, options);
    let mut chunks = LogChunks::new(logs, options.checksum, threads);
    let bytes_read = Arc::clone(&chunks.meter.bytes);
    let mut found = vec![ReadSummary::default(); logs.len()];
    // How many logs have been read and have rows.
    let mut checked = 0;
    let workers = pipeline::run(
        &mut chunks,
        threads,
        || (BlockBuffer::default(), init()),
        |(buffer, state), LogChunk { log, chunk }| {
            let filled = buffer.fill(&plans[*log], chunk, options.skip_bad_rows);
            let parsed = filled.map(|()| {
                let summary = ReadSummary {
                    rows: buffer.block.rows as u64,
                    repeated_rows: buffer.block.repeated_rows() as u64,
                    skipped_rows: buffer.parsed.skipped,
                    checksum: None,
                };
                let value = (summary.rows > 0).then(|| map(state, *log, &mut buffer.block));
                (summary, value)
            });
            (*log, parsed)
        },
        E::from,
        |(log, parsed)| {
            let bad_row = |(line, problem)| E::from(logs[log].source.error_at(line, problem));
            let (of_chunk, value) = parsed.map_err(bad_row)?;
            check_rows(&logs[checked..log], &found[checked..log])?;
            checked = log;
            let summary = &mut found[log];
            summary.rows += of_chunk.rows;
            summary.repeated_rows += of_chunk.repeated_rows;
            summary.skipped_rows += of_chunk.skipped_rows;
            if let Some(progress) = options.progress {
                progress(bytes_read.load(Ordering::Relaxed));
            }
            value.map_or(Ok(()), |value| fold(log, value))
        },
    )?;
    check_rows(&logs[checked..], &found[checked..])?;
    for (summary, checksum) in found.iter_mut().zip(chunks.checksums) {
        summary.checksum = checksum;
    }
    Ok((found, workers.into_iter().map(|(_, state)| state).collect()))
}

/// Checks that each of some logs that have been read has rows.
fn check_rows(logs: &[&Log], found: &[ReadSummary]) -> Result<(), LogError> {
    let is_empty = |summary: &ReadSummary| summary.rows == 0 && summary.skipped_rows == 0;
    match logs.iter().zip(found).find(|(_, found)| is_empty(found)) {
        Some((log, _)) => Err(LogError::NoRows(log.path().to_owned())),
        None => Ok(()),
    }
}
