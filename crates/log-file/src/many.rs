//! Reading logs one after another as one stream of pieces, so that no core waits at the end of one.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use super::chunk::{Chunk, Chunker, Room};
use super::plan::Plan;
use super::rows::RowError;
use super::source::Stream;
use super::{Log, LogError, ReadOptions, ReadSummary, Wanted};
use crate::pipeline::{self, Pieces};
use shell_data::block::Block;

/// Streams all of `logs` once, as [`Log::read`] does with one: `map` and `fold` are told which log
/// a block is from. Returns what each log was.
///
/// # Errors
/// As [`Log::read`], the first error in the order of logs and rows.
pub fn read_all<T: Send, E: From<LogError>>(
    logs: &[&Log],
    wanted: &Wanted,
    options: &ReadOptions<'_>,
    map: impl Fn(usize, &mut Block) -> T + Sync,
    mut fold: impl FnMut(usize, T) -> Result<(), E>,
) -> Result<Vec<ReadSummary>, E> {
    for log in logs {
        log.require(wanted)?;
    }
    let plans: Vec<Plan> = logs.iter().map(|log| Plan::new(&log.layout, wanted)).collect();
    let mut relay = Relay::new(logs, options.checksum);
    let bytes_done = Arc::clone(&relay.bytes_done);
    let mut summaries = vec![ReadSummary::default(); logs.len()];
    let mut checked = 0;
    let mut check = |summaries: &[ReadSummary], before: usize| -> Result<(), E> {
        for log in checked..before {
            if summaries[log].rows == 0 && summaries[log].skipped_rows == 0 {
                return Err(LogError::NoRows { path: logs[log].source.path.clone() }.into());
            }
        }
        checked = checked.max(before);
        Ok(())
    };
    pipeline::run(
        &mut relay,
        options.thread_count(),
        |Leg { log, chunk }| {
            let (log, plan) = (*log, &plans[*log]);
            let Room { mut parsed, mut block } = std::mem::take(&mut chunk.room);
            plan.parse(chunk.lines(), options.skip_bad_rows, &mut parsed)
                .map_err(|error| RowFailure { log, offset: chunk.offset, error })?;
            plan.fill(&mut block, &mut parsed, &chunk.context);
            let (rows, skipped) = (block.rows, parsed.skipped);
            let repeated = block.repeated_rows();
            let value = (rows > 0).then(|| map(log, &mut block));
            chunk.room = Room { parsed, block };
            Ok((log, rows, repeated, skipped, value))
        },
        E::from,
        |result| {
            let (log, rows, repeated, skipped, value) =
                result.map_err(|RowFailure { log, offset, error }| {
                    E::from(logs[log].row_error(offset, error))
                })?;
            check(&summaries, log)?;
            let summary = &mut summaries[log];
            summary.rows += rows as u64;
            summary.repeated_rows += repeated as u64;
            summary.skipped_rows += skipped;
            if let Some(progress) = options.progress {
                progress(bytes_done.load(Ordering::Relaxed));
            }
            value.map_or(Ok(()), |value| fold(log, value))
        },
    )?;
    check(&summaries, logs.len())?;
    for (summary, checksum) in summaries.iter_mut().zip(relay.checksums) {
        summary.checksum = checksum;
    }
    Ok(summaries)
}

/// A row that is wrong, in the piece that starts at `offset` of a log.
struct RowFailure {
    log: usize,
    offset: u64,
    error: RowError,
}

/// The pieces of one log after the other.
struct Relay<'a> {
    logs: &'a [&'a Log],
    checksum: bool,
    /// The log that is read, or is to be read next.
    now: usize,
    chunker: Option<Chunker<Stream>>,
    bytes_done: Arc<AtomicU64>,
    /// Of the logs that have been read.
    checksums: Vec<Option<String>>,
}

/// A piece of one of the logs.
#[derive(Default)]
struct Leg {
    log: usize,
    chunk: Chunk,
}

impl<'a> Relay<'a> {
    fn new(logs: &'a [&'a Log], checksum: bool) -> Self {
        let (bytes_done, checksums) = (Arc::default(), Vec::new());
        Self { logs, checksum, now: 0, chunker: None, bytes_done, checksums }
    }
}

impl Pieces for Relay<'_> {
    type Piece = Leg;
    type Error = LogError;

    fn ended(&self) -> bool {
        self.now >= self.logs.len()
    }

    fn next(&mut self, leg: &mut Leg) -> Result<bool, Self::Error> {
        while let Some(log) = self.logs.get(self.now) {
            leg.log = self.now;
            let chunker = match &mut self.chunker {
                Some(chunker) => chunker,
                none => {
                    let stream = log.source.open_counting(self.checksum, &self.bytes_done)?;
                    none.insert(Chunker::new(stream, log.layout.rows_start, log.chunk_bytes))
                }
            };
            let any = chunker.next(&mut leg.chunk).map_err(|error| log.chunk_error(error))?;
            if chunker.ended() {
                self.checksums.push(chunker.stream().checksum());
                self.chunker = None;
                self.now += 1;
            }
            if any {
                return Ok(true);
            }
        }
        Ok(false)
    }
}
