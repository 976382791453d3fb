//! Reading all rows of one log or several, in parallel.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use super::locate::line_count;
use super::request::{ReadOptions, Wanted};
use crate::error::LogError;
use crate::log::Log;
use crate::parse::plan::{BlockBuffer, ReadPlan};
use crate::parse::rows::RowError;
use crate::stream::chunk::Chunk;
use crate::stream::log_chunks::{LogChunk, LogChunks};
use crate::stream::pipeline;
use shell_data::block::Block;
use shell_data::{BlockLines, ReadSummary};

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
        let (mut summaries, _) = read_all(&[self], wanted, options, || (), map, fold)?;
        Ok(summaries.pop().expect("one summary per log"))
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

/// Streams all of `logs` once, as [`Log::read`] does one of them, with a state for every worker thread, made by
/// `init` and passed to `map`: `map` and `fold` also get the index of the log that a block is from. Returns a
/// summary of each log and the states, these in no particular order.
///
/// # Errors
/// As [`Log::read`], the first error in the order of logs and rows.
pub fn read_all<S: Send, T: Send, E: From<LogError>>(
    logs: &[&Log],
    wanted: &Wanted,
    options: &ReadOptions<'_>,
    init: impl Fn() -> S + Sync,
    map: impl Fn(&mut S, usize, &mut Block) -> T + Sync,
    fold: impl FnMut(usize, T) -> Result<(), E>,
) -> Result<(Vec<ReadSummary>, Vec<S>), E> {
    let logs: Vec<(&Log, Wanted)> = logs.iter().map(|&log| (log, wanted.clone())).collect();
    let (found, states) = read_each(&logs, options, init, map, fold)?;
    Ok((found.into_iter().map(|(summary, _)| summary).collect(), states))
}

/// What reading a log finds out about it.
type SummaryAndLines = (ReadSummary, BlockLines);

/// The same where other columns are wanted of each log; also returns the lines of its rows.
pub(crate) fn read_each<S: Send, T: Send, E: From<LogError>>(
    logs: &[(&Log, Wanted)],
    options: &ReadOptions<'_>,
    init: impl Fn() -> S + Sync,
    map: impl Fn(&mut S, usize, &mut Block) -> T + Sync,
    mut fold: impl FnMut(usize, T) -> Result<(), E>,
) -> Result<(Vec<SummaryAndLines>, Vec<S>), E> {
    let plan = |(log, wanted): &(&Log, Wanted)| {
        log.require(wanted)?;
        Ok::<_, LogError>(ReadPlan::new(&log.layout, wanted))
    };
    let plans: Vec<ReadPlan> = logs.iter().map(plan).collect::<Result<_, _>>()?;
    let logs: Vec<&Log> = logs.iter().map(|(log, _)| *log).collect();
    let logs = &logs[..];
    let threads = threads_for(logs, options);
    let mut chunks = LogChunks::new(logs, options.checksum, threads);
    let bytes_read = Arc::clone(&chunks.bytes_read);
    let mut summaries = Summaries::new(logs);
    let workers = pipeline::run(
        &mut chunks,
        threads,
        || (BlockBuffer::default(), init()),
        |(buffer, state), LogChunk { log, chunk }| {
            let log = *log;
            buffer.fill(&plans[log], chunk, options.skip_bad_rows).map_err(|error| BadRow {
                log,
                offset: chunk.offset,
                error,
            })?;
            let counts = ChunkCounts::new(log, chunk, buffer);
            let value = (counts.rows > 0).then(|| map(state, log, &mut buffer.block));
            Ok((counts, value))
        },
        E::from,
        |result| {
            let (counts, value) = result.map_err(|BadRow { log, offset, error }| {
                E::from(logs[log].row_error(offset, error))
            })?;
            summaries.add(&counts)?;
            if let Some(progress) = options.progress {
                progress(bytes_read.load(Ordering::Relaxed));
            }
            value.map_or(Ok(()), |value| fold(counts.log, value))
        },
    )?;
    let summaries = summaries.finish(chunks.checksums)?;
    Ok((summaries, workers.into_iter().map(|(_, state)| state).collect()))
}

/// How many rows a chunk has, and lines.
struct ChunkCounts {
    log: usize,
    offset: u64,
    lines: u64,
    rows: usize,
    repeated: usize,
    skipped: u64,
}

impl ChunkCounts {
    fn new(log: usize, chunk: &Chunk, buffer: &BlockBuffer) -> Self {
        Self {
            log,
            offset: chunk.offset,
            lines: line_count(chunk.lines()),
            rows: buffer.block.rows,
            repeated: buffer.block.repeated_rows(),
            skipped: buffer.parsed.skipped,
        }
    }
}

/// A bad row, in the chunk that starts at `offset` of a log.
struct BadRow {
    log: usize,
    offset: u64,
    error: RowError,
}

/// The summaries of logs that are read one after another.
struct Summaries<'a> {
    logs: &'a [&'a Log],
    summaries: Vec<SummaryAndLines>,
    /// The number of logs that have been read and have rows.
    checked: usize,
}

impl<'a> Summaries<'a> {
    fn new(logs: &'a [&'a Log]) -> Self {
        Self { logs, summaries: vec![SummaryAndLines::default(); logs.len()], checked: 0 }
    }

    /// Adds a chunk, after all chunks before it.
    fn add(&mut self, chunk: &ChunkCounts) -> Result<(), LogError> {
        self.check_before(chunk.log)?;
        let (summary, lines) = &mut self.summaries[chunk.log];
        summary.rows += chunk.rows as u64;
        summary.repeated_rows += chunk.repeated as u64;
        summary.skipped_rows += chunk.skipped;
        lines.add(chunk.offset, chunk.rows, chunk.lines);
        Ok(())
    }

    /// Checks that the logs before `end` have rows, once each.
    fn check_before(&mut self, end: usize) -> Result<(), LogError> {
        for log in self.checked..end {
            let (summary, _) = &self.summaries[log];
            if summary.rows == 0 && summary.skipped_rows == 0 {
                return Err(LogError::NoRows { path: self.logs[log].path().to_owned() });
            }
        }
        self.checked = self.checked.max(end);
        Ok(())
    }

    fn finish(mut self, checksums: Vec<Option<String>>) -> Result<Vec<SummaryAndLines>, LogError> {
        self.check_before(self.logs.len())?;
        for ((summary, _), checksum) in self.summaries.iter_mut().zip(checksums) {
            summary.checksum = checksum;
        }
        Ok(self.summaries)
    }
}
