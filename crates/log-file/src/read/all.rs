//! Reading all rows of one or more logs in parallel: block by block, or into memory.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use crate::error::{LogError, RowProblem};
use crate::format::choice::{Comparison, ConditionTally};
use crate::format::columns::Wanted;
use crate::log::Log;
use crate::parse::plan::{BlockBuffer, ReadPlan};
use crate::stream::bytes::ReadMeter;
use crate::stream::piece::{LogPiece, LogPieces};
use crate::stream::pipeline::{self, Pieces};
use shell_data::ReadSummary;
use shell_data::block::Block;
use shell_data::dataset::{Dataset, LogRows};

#[derive(Clone, Copy, Default)]
pub struct ReadOptions<'a> {
    /// Number of threads for parsing; 0 for one per core.
    pub threads: usize,
    pub skip_bad_rows: bool,
    /// Largest accepted share of invalid rows if they are skipped; `None` accepts any.
    pub largest_bad_share: Option<f64>,
    pub checksum: bool,
    /// True if an excluded group need not occur in these logs.
    pub may_exclude_nothing: bool,
    /// Called on the caller's thread with the number of bytes read of the file on disk.
    pub progress: Option<&'a (dyn Fn(u64) + Sync)>,
}

impl ReadOptions<'_> {
    /// Largest share of invalid rows that is skipped by default.
    pub const FEW_BAD_ROWS: f64 = 0.1;

    pub fn thread_count(&self) -> usize {
        match self.threads {
            0 => std::thread::available_parallelism().map_or(1, usize::from),
            threads => threads,
        }
    }
}

impl Log {
    /// Streams the whole log once: `map` gets its blocks on worker threads, `fold` gets the results on the caller's
    /// thread, in file order. `map` may take columns of a block; the memory of the others is reused.
    ///
    /// # Errors
    /// [`LogError`] if wanted columns are missing, the file cannot be read, has no rows, or has an invalid row
    /// (unless skipped); and errors of `fold`, which stop the reading. The first error in file order is returned.
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
    /// Like [`Log::read`].
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

/// Number of bytes up to which a single thread reads: a second one would start too late to help.
const READ_ALONE: u64 = 256 << 10;

/// Returns the number of threads for reading some logs, or for work on their rows.
pub fn threads_for(logs: &[&Log], options: &ReadOptions<'_>) -> usize {
    let is_plain = logs.iter().all(|log| log.source.is_plain());
    let bytes: u64 = logs.iter().map(|log| log.bytes()).sum();
    match options.threads {
        0 if is_plain && bytes <= READ_ALONE => 1,
        _ => options.thread_count(),
    }
}

/// Streams the wanted columns of all `logs` once, like [`Log::read`]. `init` makes a state for each worker thread,
/// which `map` receives. `map` and `fold` also receive the index of the log. Returns a summary of each log, and the
/// states in no particular order.
///
/// # Errors
/// Like [`Log::read`], the first error in the order of logs and rows.
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
    let (checksum, meter, checksums) = (options.checksum, ReadMeter::default(), Vec::new());
    let mut pieces = PiecesOfLogs {
        logs,
        plans: &plans,
        threads,
        checksum,
        current: 0,
        pieces: None,
        meter,
        checksums,
    };
    let bytes_read = Arc::clone(&pieces.meter.bytes);
    let mut found = vec![ReadSummary::default(); logs.len()];
    let mut skipped_rows = vec![SkippedRows::default(); logs.len()];
    let mut tallies: Vec<Vec<ConditionTally>> = vec![Vec::new(); logs.len()];
    let mut checked = 0;
    let workers = pipeline::run(
        &mut pieces,
        threads,
        || (BlockBuffer::default(), init()),
        |(buffer, state), (log, piece)| {
            let filled = buffer.fill(&plans[*log], piece, options.skip_bad_rows);
            let parsed = filled.map(|()| {
                let summary = ReadSummary {
                    rows: buffer.block.rows as u64,
                    repeated_rows: buffer.block.repeated_rows() as u64,
                    skipped_rows: buffer.parsed.skipped,
                    repeated_heads: buffer.parsed.repeated_heads,
                    checksum: None,
                };
                let value = (summary.rows > 0).then(|| map(state, *log, &mut buffer.block));
                let skipped_for = std::mem::take(&mut buffer.parsed.skipped_for);
                let tallies = std::mem::take(&mut buffer.parsed.tallies);
                (summary, value, buffer.first_skipped(piece), skipped_for, tallies)
            });
            (*log, parsed)
        },
        |(log, parsed)| {
            let bad_row = |(line, problem)| E::from(logs[log].source.error_at(line, problem));
            let (of_chunk, value, skipped, why, of_conditions) = parsed.map_err(bad_row)?;
            tallies[log].resize_with(of_conditions.len(), ConditionTally::default);
            tallies[log].iter_mut().zip(of_conditions).for_each(|(all, of)| all.add(of));
            let (first, all) = &mut skipped_rows[log];
            *first = first.take().or(skipped);
            why.into_iter().for_each(|(class, rows)| *all.entry(class).or_default() += rows);
            check_rows(&logs[checked..log], &found[checked..log], &tallies[checked..log])?;
            checked = log;
            let summary = &mut found[log];
            summary.rows += of_chunk.rows;
            summary.repeated_rows += of_chunk.repeated_rows;
            summary.skipped_rows += of_chunk.skipped_rows;
            summary.repeated_heads += of_chunk.repeated_heads;
            if let Some(progress) = options.progress {
                progress(bytes_read.load(Ordering::Relaxed));
            }
            value.map_or(Ok(()), |value| fold(log, value))
        },
    )?;
    check_rows(&logs[checked..], &found[checked..], &tallies[checked..])?;
    if !options.may_exclude_nothing {
        check_exclusions(logs, &tallies)?;
    }
    if let Some(share) = options.largest_bad_share {
        check_skipped(logs, &found, skipped_rows, share)?;
    }
    for (summary, checksum) in found.iter_mut().zip(pieces.checksums) {
        summary.checksum = checksum;
    }
    Ok((found, workers.into_iter().map(|(_, state)| state).collect()))
}

fn check_rows(
    logs: &[&Log],
    found: &[ReadSummary],
    tallies: &[Vec<ConditionTally>],
) -> Result<(), LogError> {
    let is_empty = |summary: &ReadSummary| summary.rows == 0 && summary.skipped_rows == 0;
    let Some(at) = found.iter().position(is_empty) else { return Ok(()) };
    let (log, path) = (logs[at], logs[at].path().to_owned());
    // The error names the condition that removes most rows.
    let pairs = log.layout.conditions.iter().zip(&tallies[at]);
    match pairs.max_by_key(|(_, tally)| tally.removed) {
        Some((condition, tally)) => {
            let column = log.layout.columns[condition.column].name.clone();
            Err(LogError::NoneChosen { path, column, found: tally.values.clone() })
        }
        None => Err(LogError::NoRows(path)),
    }
}

/// Refuses an exclusion (a condition with `!=`, such as an excluded group) that removes no row of any log.
fn check_exclusions(logs: &[&Log], tallies: &[Vec<ConditionTally>]) -> Result<(), LogError> {
    let Some((log, of_first)) = logs.first().zip(tallies.first()) else { return Ok(()) };
    for (at, condition) in log.layout.conditions.iter().enumerate() {
        let of_logs = || tallies.iter().filter_map(|of_log| of_log.get(at));
        if condition.comparison == Comparison::Unequal
            && of_logs().count() == logs.len()
            && of_logs().all(|tally| tally.removed == 0)
        {
            return Err(LogError::NoneExcluded {
                path: log.path().to_owned(),
                column: log.layout.columns[condition.column].name.clone(),
                value: condition.value.clone(),
                found: of_first[at].values.clone(),
            });
        }
    }
    Ok(())
}

/// The line and error of the first skipped row, and numbers of skipped rows by their common feature.
type SkippedRows = (Option<(u64, RowProblem)>, BTreeMap<String, u64>);

/// Checks that at most `share` of each log's rows was skipped. A single skipped row is always accepted.
fn check_skipped(
    logs: &[&Log],
    found: &[ReadSummary],
    skipped_rows: Vec<SkippedRows>,
    share: f64,
) -> Result<(), LogError> {
    for ((log, summary), (first, classes)) in logs.iter().zip(found).zip(skipped_rows) {
        let (skipped, rows) = (summary.skipped_rows, summary.rows + summary.skipped_rows);
        if let Some((line, problem)) = first
            && skipped > 1
            && skipped as f64 > share * rows as f64
        {
            let position = log.source.position(line);
            let path = log.path().to_owned();
            let class = classes.into_iter().max_by_key(|(_, rows)| *rows);
            let class = class.map_or_else(String::new, |(class, of)| match of >= skipped {
                true => format!("all {class}"),
                false => format!("{of} {class}"),
            });
            let problem = Box::new(problem);
            return Err(LogError::ManyBadRows { path, skipped, rows, class, position, problem });
        }
    }
    Ok(())
}

/// The pieces of several logs as one sequence, so that no thread waits at the end of a log.
struct PiecesOfLogs<'a> {
    logs: &'a [&'a Log],
    plans: &'a [ReadPlan],
    threads: usize,
    checksum: bool,
    current: usize,
    pieces: Option<LogPieces<'a>>,
    meter: ReadMeter,
    /// Checksums of the logs that have been read.
    checksums: Vec<Option<String>>,
}

impl Pieces for PiecesOfLogs<'_> {
    type Piece = (usize, LogPiece);
    type Error = LogError;

    fn ended(&self) -> bool {
        self.current >= self.logs.len()
    }

    fn next(&mut self, (number, piece): &mut (usize, LogPiece)) -> Result<bool, Self::Error> {
        while let Some(log) = self.logs.get(self.current) {
            *number = self.current;
            let pieces = match &mut self.pieces {
                Some(pieces) => pieces,
                none => {
                    self.meter.begin(self.checksum);
                    let wanted = self.plans[self.current].wanted_columns();
                    none.insert(log.pieces(&wanted, log.chunk_bytes, self.threads, &self.meter)?)
                }
            };
            let any = pieces.next(log, piece)?;
            if pieces.ended() {
                self.checksums.push(self.meter.checksum());
                self.pieces = None;
                self.current += 1;
            }
            if any {
                return Ok(true);
            }
        }
        Ok(false)
    }
}

/// Reads all rows into memory, with the wanted columns of each log: time, readings, wrench and groups.
/// [`sample_logs`] adds samples.
///
/// # Errors
/// Like [`Log::read`], the first error in the order of logs and rows.
pub fn read_dataset(
    logs: &[(&Log, Wanted)],
    options: &ReadOptions<'_>,
) -> Result<Dataset, LogError> {
    let rows = |(log, wanted): &(&Log, Wanted)| LogRows {
        name: log.path().to_path_buf(),
        axes: log.axes(),
        channels: log.channels(),
        has_groups: wanted.groups,
        is_sampled_at_start: log.compression().is_some(),
        ..LogRows::default()
    };
    let mut data = Dataset { logs: logs.iter().map(rows).collect() };
    // A clone has just the capacity it needs; the block's memory is reused.
    let copy = |(): &mut (), _, block: &mut Block| block.clone();
    let keep = |log: usize, mut block: Block| {
        data.logs[log].lines.insert(block.offset, std::mem::take(&mut block.lines));
        data.logs[log].blocks.push(block.into());
        Ok::<_, LogError>(())
    };
    let (summaries, _) = read_all(logs, options, || (), copy, keep)?;
    data.logs.iter_mut().zip(summaries).for_each(|(log, summary)| log.summary = summary);
    Ok(data)
}

/// Reads the same columns of some logs, and takes a sample of each.
///
/// # Errors
/// Like [`read_dataset`].
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

/// Takes a sample of each log in a data set, with its wanted columns except groups.
///
/// # Errors
/// Like [`Log::sample`].
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::mapping::Mapping;

    fn check_lines(between: [&str; 2]) {
        let mut text = "time,s0,s1\n".to_owned();
        let (mut line, mut lines_of_times) = (1, Vec::new());
        for row in 0..4000_u32 {
            let between = match row % 7 {
                0 => between[0],
                3 => between[1],
                _ => "",
            };
            text += between;
            line += u64::from(!between.is_empty()) + 1;
            lines_of_times.push(line);
            text += &format!("{row},{},{}\n", row % 100, row % 90);
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        // The last line has no line end.
        std::fs::write(&path, text.trim_end()).unwrap();
        let mut log = Log::open(&path, &Mapping::default()).unwrap();
        log.chunk_bytes = 4096;
        let wanted = Wanted { time: true, readings: true, ..Wanted::default() };
        let options = ReadOptions { skip_bad_rows: true, ..ReadOptions::default() };
        let (mut rows, mut expected) = (Vec::new(), Vec::new());
        let of_block = |block: &mut Block| {
            let lines = (0..block.rows).map(|row| block.lines.line(row)).collect::<Vec<_>>();
            (block.offset, block.time_s.clone(), lines)
        };
        log.read(&wanted, &options, of_block, |(offset, times, lines)| {
            for (row, (time, line)) in times.into_iter().zip(lines).enumerate() {
                rows.push((offset, row));
                expected.push(lines_of_times[time as usize]);
                assert_eq!(expected.last(), Some(&line));
            }
            Ok::<_, LogError>(())
        })
        .unwrap();
        assert_eq!(rows.len(), 4000);
        let data = read_dataset(&[(&log, wanted)], &options).unwrap();
        let of_blocks = &data.logs[0].lines;
        let lines = rows.iter().map(|(offset, row)| of_blocks[offset].line(*row));
        assert_eq!(lines.collect::<Vec<_>>(), expected);
    }

    #[test]
    fn rows_are_found_at_their_lines_whatever_is_between_them() {
        check_lines(["\n", "oops,1,2\n"]);
        check_lines(["# talk\n", " \t\n"]);
        check_lines(["", "1,\"2,3\n"]);
        check_lines(["", ""]);
    }
}
