//! The rows of training and test logs, to be passed over as often as a fit asks.
//!
//! Parsing is the dearest part of a fit, so the rows of short logs are kept from the first pass on.
//! Longer logs are read again on every pass: memory does not grow with them. What can be said of rows
//! without a calibration is gathered on the way when they are read for the first time.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use super::WorkflowError;
use super::kept_rows::{KeptBlock, Room, Steps, Store};
use super::log_facts::{Gathering, LogFacts};
use super::selection::UsedRows;
use calibration::FitError;
use calibration::solver::{Blocks, Pass, PassWorker};
use log_file::pipeline::{self, Pieces};
use log_file::{self, Log, ReadOptions, ReadSummary, Wanted};
use shell_data::block::Block;

/// The memory that kept rows may take: half a million rows of eight channels with the wrench in all
/// digits, or more than a million where it is that of a digital sensor. A fit takes less than 64 MB with it.
pub const MEMORY: u64 = 40_000_000;

/// Rows take this share of their text, more or less: half where numbers have all digits, a quarter where
/// they are short.
const SHARE_OF_TEXT: u64 = 3;

/// Text is about so many times as long as its file where that is compressed.
const COMPRESSION: u64 = 4;

/// Logs of less text than this, in bytes, are read without a sample first: most of their text would be read
/// twice.
const SHORT: u64 = 256 << 10;

/// How long the text of logs is, about.
fn text_bytes<'a>(logs: impl IntoIterator<Item = &'a Log>) -> u64 {
    let text = |log: &Log| match log.is_compressed() || log.table_kind().is_some() {
        true => COMPRESSION * log.bytes(),
        false => log.bytes(),
    };
    logs.into_iter().map(text).sum()
}

/// The memory that the rows of logs will take, about, as far as their sizes tell.
fn expected_memory<'a>(logs: impl IntoIterator<Item = &'a Log>) -> u64 {
    text_bytes(logs) / SHARE_OF_TEXT
}

/// Whether the rows of some logs may take more memory than they may, so that something else has to be kept
/// of them.
pub(super) fn may_exceed(logs: &[Log], memory: u64) -> bool {
    2 * expected_memory(logs) > memory
}

/// The rows of logs for training and for tests.
pub(super) struct LogRows<'a> {
    /// The training logs, then the test logs.
    logs: Vec<&'a Log>,
    train: usize,
    /// Which rows are used.
    used: UsedRows<'a>,
    read: ReadOptions<'a>,
    gathering: Gathering,
    /// What has been gathered of the first of the logs, those that have been read.
    facts: LogFacts,
    /// The rows of the first of the logs, as far as they are kept.
    kept: Vec<Vec<KeptBlock<'a>>>,
    room: Room<'a>,
    /// The memory that rows may take.
    memory: u64,
    /// What all rows would take, where they have not been kept.
    wanted_memory: Option<u64>,
}

/// Memory for the rows of such logs, so many bytes at most.
pub(super) fn store(train: &[Log], test: &[Log], memory: u64) -> Store {
    let logs = || train.iter().chain(test);
    let bytes: u64 = logs().map(Log::bytes).sum();
    // A number and what ends it are two bytes at least, and eight at most when they are kept.
    let most = match logs().any(|log| log.is_compressed() || log.table_kind().is_some()) {
        true => memory,
        false => memory.min(4 * bytes),
    };
    Store::new(most, bytes / SHARE_OF_TEXT)
}

impl<'a> LogRows<'a> {
    /// The rows of some logs, of the first of which `facts` are known. Progress counts the bytes of all logs
    /// in each pass that reads them.
    pub(super) fn new(
        [train, test]: [&'a [Log]; 2],
        (gathering, mut facts): (Gathering, LogFacts),
        used: UsedRows<'a>,
        read: ReadOptions<'a>,
        room: Room<'a>,
        memory: u64,
    ) -> Self {
        let logs: Vec<&Log> = train.iter().chain(test).collect();
        facts.expect(logs[facts.known()..].iter().copied());
        Self {
            logs,
            train: train.len(),
            used,
            read,
            gathering,
            facts,
            kept: Vec::new(),
            room,
            memory,
            wanted_memory: None,
        }
    }

    /// What the rows would take in memory, about, after a pass: where the training logs take more than they
    /// may.
    pub(super) fn beyond_memory(&self) -> Option<u64> {
        let expected = || {
            let expected = expected_memory(self.logs[..self.train].iter().copied());
            Some(expected).filter(|&expected| expected > self.memory)
        };
        match self.keeps_training() {
            true => None,
            false => self.wanted_memory.or_else(expected),
        }
    }

    /// Whether the rows of the training logs are kept.
    pub(super) fn keeps_training(&self) -> bool {
        self.kept.len() >= self.train
    }

    /// What has been gathered of the logs that have been read.
    pub(super) fn facts(&self) -> &LogFacts {
        &self.facts
    }

    /// The training logs, then the test logs.
    pub(super) fn logs(&self) -> &[&'a Log] {
        &self.logs
    }

    /// How many of them are training logs.
    pub(super) fn train(&self) -> usize {
        self.train
    }

    /// Passes over the rows of some logs, block by block. `map` runs on any thread: it gets the state of that
    /// thread, made by `init`, the number of the log, and the block. `fold` gets the results of `map` in the
    /// order of the rows. Returns the states.
    pub(super) fn pass_over<S: Send, T: Send>(
        &mut self,
        logs: Range<usize>,
        init: impl Fn() -> S + Sync,
        map: impl Fn(&mut S, usize, &Block) -> Result<T, FitError> + Sync,
        mut fold: impl FnMut(usize, T),
    ) -> Result<Vec<S>, WorkflowError> {
        let kept = self.kept.len().clamp(logs.start, logs.end);
        let mut states = self.pass_over_kept(logs.start..kept, &init, &map, &mut fold)?;
        let known = self.facts.known().clamp(kept, logs.end);
        if kept < known {
            // The checksums of logs that were read before are known.
            let read = ReadOptions { checksum: false, ..self.read };
            let map = |state: &mut S, log: usize, block: &mut Block| map(state, log, block);
            states.extend(self.read_logs(kept..known, &read, &init, map, &mut fold)?.1);
            self.check_unchanged(kept..known)?;
        }
        if known < logs.end {
            let map = |state: &mut S, log: usize, block: &mut Block| map(state, log, block);
            let (facts, new) = self.read_new(known..logs.end, init, map, fold)?;
            self.facts = facts;
            states.extend(new);
        }
        Ok(states)
    }

    /// Reads logs for the first time, those after all that have been read. Returns the facts of all, and the
    /// states of the workers. Where it fails, the facts are still those of before: another solver may try.
    fn read_new<S: Send, T: Send>(
        &self,
        logs: Range<usize>,
        init: impl Fn() -> S + Sync,
        map: impl Fn(&mut S, usize, &mut Block) -> Result<T, FitError> + Sync,
        mut fold: impl FnMut(usize, T),
    ) -> Result<(LogFacts, Vec<S>), WorkflowError> {
        let (gathering, mut facts) = (self.gathering, self.facts.clone());
        let map = |state: &mut S, log: usize, block: &mut Block| {
            let of_block = gathering.of(log, block);
            Ok((of_block, map(state, log, block)?))
        };
        let add = |log: usize, (of_block, value)| {
            facts.add(&gathering, log, of_block);
            fold(log, value);
        };
        let (summaries, states) = self.read_logs(logs, &self.read, init, map, add)?;
        facts.finish(summaries);
        Ok((facts, states))
    }

    /// Whether some logs that were read again are still what they were.
    fn check_unchanged(&self, logs: Range<usize>) -> Result<(), WorkflowError> {
        let has_changed = |&log: &usize| !self.facts.is_unchanged(log, self.logs[log]);
        match logs.into_iter().find(has_changed) {
            Some(log) => Err(WorkflowError::Changed { path: self.logs[log].path().to_path_buf() }),
            None => Ok(()),
        }
    }

    fn pass_over_kept<S: Send, T: Send>(
        &self,
        logs: Range<usize>,
        init: &(impl Fn() -> S + Sync),
        map: &(impl Fn(&mut S, usize, &Block) -> Result<T, FitError> + Sync),
        fold: &mut impl FnMut(usize, T),
    ) -> Result<Vec<S>, WorkflowError> {
        if logs.is_empty() {
            return Ok(Vec::new());
        }
        let blocks = logs.clone().zip(&self.kept[logs.clone()]);
        let blocks: Vec<_> =
            blocks.flat_map(|(log, blocks)| blocks.iter().map(move |block| (log, block))).collect();
        pipeline::run(
            &mut KeptBlocks(blocks.chunks(BLOCKS_AT_ONCE)),
            log_file::threads_for(&self.logs[logs], &self.read),
            || (Block::default(), init()),
            |(block, state), kept| {
                let map = |&(log, kept): &(usize, &KeptBlock<'_>)| {
                    kept.restore(block, self.logs[log].channels());
                    Ok((log, map(state, log, block)?))
                };
                kept.iter().map(map).collect()
            },
            |never| match never {},
            |results: Result<Vec<_>, FitError>| {
                results?.into_iter().for_each(|(log, value)| fold(log, value));
                Ok(())
            },
        )
        .map(|workers| workers.into_iter().map(|(_, state)| state).collect())
    }

    fn read_logs<S: Send, T: Send>(
        &self,
        logs: Range<usize>,
        read: &ReadOptions<'_>,
        init: impl Fn() -> S + Sync,
        map: impl Fn(&mut S, usize, &mut Block) -> Result<T, FitError> + Sync,
        mut fold: impl FnMut(usize, T),
    ) -> Result<(Vec<ReadSummary>, Vec<S>), WorkflowError> {
        let wanted = Wanted { readings: true, wrench: true, ..Wanted::default() };
        let first = logs.start;
        let bytes_before = self.logs[..first].iter().map(|log| log.bytes()).sum::<u64>();
        let report = |bytes: u64| {
            if let Some(progress) = self.read.progress {
                progress(bytes_before + bytes);
            }
        };
        let read = ReadOptions { progress: Some(&report), ..*read };
        let map = |state: &mut S, log: usize, block: &mut Block| {
            self.used.select(first + log, block);
            map(state, first + log, block)
        };
        log_file::read_all(&self.logs[logs], &wanted, &read, init, map, |log, value| {
            fold(first + log, value?);
            Ok::<_, WorkflowError>(())
        })
    }

    /// The first pass over the training logs: reads them, and the test logs if all are short, and
    /// keeps their rows if they are few.
    fn first_pass<P: Pass>(&mut self, pass: &P) -> Result<P::Partial, WorkflowError> {
        // One pass of all cores in place of two, where the rows of the tests are likely to be kept.
        let is_short = expected_memory(self.logs.iter().copied()) <= self.memory;
        let logs = if is_short { self.logs.len() } else { self.train };
        let (steps, is_kept) = (Steps::new(), AtomicBool::new(true));
        let text = |logs: &[&Log]| text_bytes(logs.iter().copied());
        let before: Vec<u64> = (0..logs).map(|log| text(&self.logs[..log])).collect();
        let (all_text, memory) = (text(&self.logs[..logs]), self.memory);
        let rough = expected_memory(self.logs[..logs].iter().copied());
        let init = || PassWorker::new(pass);
        let map = |worker: &mut PassWorker<'_, P>, log: usize, block: &mut Block| {
            let partial = (log < self.train).then(|| worker.reduce(block)).transpose()?.flatten();
            let is_kept = is_kept.load(Ordering::Relaxed);
            let kept = is_kept.then(|| KeptBlock::new(block, &steps, &self.room)).flatten();
            Ok((partial, (kept, block.place)))
        };
        let (mut all, mut kept, mut kept_bytes) = (pass.empty(), Vec::new(), 0_u64);
        kept.resize_with(logs, Vec::new);
        let mut wanted_memory = None;
        type Mapped<'a, P> = (Option<P>, (Option<KeptBlock<'a>>, u64));
        let fold = |log: usize, (partial, (block, place)): Mapped<'a, P::Partial>| {
            if let Some(partial) = partial {
                pass.merge(&mut all, partial);
            }
            // What all would take, by what those before this block have: known in time, the memory
            // is not touched in vain.
            let text = before[log] + place;
            let expected = (u128::from(kept_bytes) * u128::from(all_text))
                .checked_div(u128::from(text))
                .map_or(0, |bytes| u64::try_from(bytes).unwrap_or(u64::MAX));
            if is_kept.load(Ordering::Relaxed) && (block.is_none() || expected > memory) {
                is_kept.store(false, Ordering::Relaxed);
                wanted_memory = Some(if expected > 0 { expected } else { rough }.max(memory));
                kept.truncate(if log < self.train { 0 } else { self.train });
            }
            if let (Some(block), Some(kept)) =
                (block.filter(|_| is_kept.load(Ordering::Relaxed)), kept.get_mut(log))
            {
                kept_bytes += block.bytes();
                kept.push(block);
            }
        };
        let (facts, workers) = self.read_new(0..logs, init, map, fold)?;
        (self.facts, self.kept, self.wanted_memory) = (facts, kept, wanted_memory);
        PassWorker::merge(workers, &mut all);
        Ok(all)
    }
}

impl Blocks for LogRows<'_> {
    type Error = WorkflowError;

    fn sample(&self) -> Option<Block> {
        let wanted = Wanted { readings: true, wrench: true, ..Wanted::default() };
        if text_bytes(self.logs.iter().copied()) < SHORT {
            return None;
        }
        self.logs.first()?.sample(&wanted).ok()
    }

    fn pass<P: Pass>(&mut self, pass: &P) -> Result<P::Partial, WorkflowError> {
        if self.facts.known() == 0 {
            return self.first_pass(pass);
        }
        let mut all = pass.empty();
        let reduce = |worker: &mut PassWorker<'_, P>, _, block: &Block| worker.reduce(block);
        let merge = |_, partial| {
            if let Some(partial) = partial {
                pass.merge(&mut all, partial);
            }
        };
        let workers = self.pass_over(0..self.train, || PassWorker::new(pass), reduce, merge)?;
        PassWorker::merge(workers, &mut all);
        Ok(all)
    }
}

/// How many blocks are handed out at once: a block is restored and evaluated in the time that it takes to
/// wake a thread that waits for the next.
const BLOCKS_AT_ONCE: usize = 8;

/// Blocks that are handed out some at a time, each with its log.
struct KeptBlocks<'b, 'a>(std::slice::Chunks<'b, (usize, &'a KeptBlock<'a>)>);

impl<'b, 'a> Pieces for KeptBlocks<'b, 'a> {
    type Piece = &'b [(usize, &'a KeptBlock<'a>)];
    type Error = std::convert::Infallible;

    fn ended(&self) -> bool {
        self.0.len() == 0
    }

    fn next(&mut self, piece: &mut Self::Piece) -> Result<bool, Self::Error> {
        *piece = self.0.next().unwrap_or_default();
        Ok(!piece.is_empty())
    }
}
