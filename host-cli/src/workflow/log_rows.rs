//! The rows of training and test logs, to be passed over as often as a fit asks.
//!
//! Parsing is the dearest part of a fit, so the rows of short logs are kept from the first pass on.
//! Longer logs are read again on every pass: memory does not grow with them.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use super::WorkflowError;
use super::batch::{Stamp, stamp};
use super::kept_rows::{KeptBlock, Room, Steps, Store};
use super::selection::UsedRows;
use calibration::FitError;
use calibration::solver::{Blocks, Pass, PassWorker};
use log_file::pipeline::{self, Pieces};
use log_file::{self, Log, ReadOptions, ReadSummary, Wanted};
use shell_data::block::Block;

/// The memory that kept rows may take: some four million rows of eight channels with the wrench in all
/// digits, or nine million where it is that of a digital sensor.
pub(super) const MEMORY: u64 = 256_000_000;

/// Rows take this share of their text, more or less: half where numbers have all digits, a quarter where
/// they are short.
const SHARE_OF_TEXT: u64 = 3;

/// The rows of logs for training and for tests.
pub(super) struct LogRows<'a> {
    /// The training logs, then the test logs.
    logs: Vec<&'a Log>,
    train: usize,
    /// Which rows are used.
    used: UsedRows<'a>,
    read: ReadOptions<'a>,
    /// What their files are before they are read.
    stamps: Vec<Stamp>,
    /// What the first of the logs were, as far as they have been read.
    summaries: Vec<ReadSummary>,
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
    /// The rows of some logs. Progress counts the bytes of all logs in each pass that reads them.
    pub(super) fn new(
        train: &'a [Log],
        test: &'a [Log],
        used: UsedRows<'a>,
        read: ReadOptions<'a>,
        room: Room<'a>,
        memory: u64,
    ) -> Self {
        let logs: Vec<&Log> = train.iter().chain(test).collect();
        let stamps = logs.iter().map(|log| stamp(log.path())).collect();
        Self {
            logs,
            train: train.len(),
            used,
            read,
            stamps,
            summaries: Vec::new(),
            kept: Vec::new(),
            room,
            memory,
            wanted_memory: None,
        }
    }

    /// What the rows would take in memory that have been read again, about.
    pub(super) fn wanted_memory(&self) -> Option<u64> {
        self.wanted_memory
    }

    /// The training logs, then the test logs.
    pub(super) fn logs(&self) -> &[&'a Log] {
        &self.logs
    }

    /// How many of them are training logs.
    pub(super) fn train(&self) -> usize {
        self.train
    }

    /// Passes over the rows of all logs: `map` gets blocks and the log that they are from on any
    /// thread, `fold` gets the results of `map`, in order. Returns summaries of the logs.
    pub(super) fn each_block<T: Send>(
        &mut self,
        map: impl Fn(usize, &Block) -> Result<T, FitError> + Sync,
        fold: impl FnMut(usize, T),
    ) -> Result<&[ReadSummary], WorkflowError> {
        self.pass_over(self.logs.len(), || (), |(), log, block| map(log, block), fold)?;
        Ok(&self.summaries)
    }

    /// Passes over the rows of the first `logs` logs. Returns the states of the workers, made by
    /// `init`.
    fn pass_over<S: Send, T: Send>(
        &mut self,
        logs: usize,
        init: impl Fn() -> S + Sync,
        map: impl Fn(&mut S, usize, &Block) -> Result<T, FitError> + Sync,
        mut fold: impl FnMut(usize, T),
    ) -> Result<Vec<S>, WorkflowError> {
        let kept = self.kept.len().min(logs);
        let mut states = self.pass_over_kept(kept, &init, &map, &mut fold)?;
        // The checksums of logs that were read before are known.
        let known = self.summaries.len().clamp(kept, logs);
        let map = |state: &mut S, log: usize, block: &mut Block| map(state, log, block);
        if kept < known {
            let read = ReadOptions { checksum: false, ..self.read };
            states.extend(self.read_logs(kept..known, &read, &init, map, &mut fold)?.1);
            self.check_unchanged(kept..known)?;
        }
        if known < logs {
            let read = self.read;
            let (summaries, new) = self.read_logs(known..logs, &read, init, map, &mut fold)?;
            self.summaries.extend(summaries);
            states.extend(new);
        }
        Ok(states)
    }

    /// Whether some logs that were read again are still what they were.
    fn check_unchanged(&self, logs: Range<usize>) -> Result<(), WorkflowError> {
        let has_changed = |&log: &usize| stamp(self.logs[log].path()) != self.stamps[log];
        match logs.into_iter().find(has_changed) {
            Some(log) => Err(WorkflowError::Changed { path: self.logs[log].path().to_path_buf() }),
            None => Ok(()),
        }
    }

    fn pass_over_kept<S: Send, T: Send>(
        &self,
        logs: usize,
        init: &(impl Fn() -> S + Sync),
        map: &(impl Fn(&mut S, usize, &Block) -> Result<T, FitError> + Sync),
        fold: &mut impl FnMut(usize, T),
    ) -> Result<Vec<S>, WorkflowError> {
        let blocks = self.kept[..logs].iter().enumerate();
        let blocks: Vec<_> =
            blocks.flat_map(|(log, blocks)| blocks.iter().map(move |block| (log, block))).collect();
        pipeline::run(
            &mut KeptBlocks(blocks.into_iter()),
            log_file::threads_for(&self.logs[..logs], &self.read),
            || (Block::default(), init()),
            |(block, state), kept| {
                let (log, kept) = kept.expect("a piece that was handed out");
                kept.restore(block, self.logs[log].channels());
                Ok((log, map(state, log, block)?))
            },
            |never| match never {},
            |result: Result<_, FitError>| {
                let (log, value) = result?;
                fold(log, value);
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
        let text = |logs: &[&Log]| logs.iter().map(|log| log.bytes()).sum::<u64>();
        // One pass of all cores in place of two, where the rows of the tests are likely to be kept.
        let is_short = text(&self.logs) / SHARE_OF_TEXT <= self.memory;
        let logs = if is_short { self.logs.len() } else { self.train };
        let (steps, is_kept) = (Steps::new(), AtomicBool::new(true));
        let before: Vec<u64> = (0..logs).map(|log| text(&self.logs[..log])).collect();
        let (all_text, memory) = (text(&self.logs[..logs]), self.memory);
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
                wanted_memory =
                    Some(if expected > 0 { expected } else { all_text / SHARE_OF_TEXT });
                kept.truncate(if log < self.train { 0 } else { self.train });
            }
            if let (Some(block), Some(kept)) =
                (block.filter(|_| is_kept.load(Ordering::Relaxed)), kept.get_mut(log))
            {
                kept_bytes += block.bytes();
                kept.push(block);
            }
        };
        let (summaries, workers) = self.read_logs(0..logs, &self.read, init, map, fold)?;
        (self.summaries, self.kept, self.wanted_memory) = (summaries, kept, wanted_memory);
        PassWorker::merge(workers, &mut all);
        Ok(all)
    }
}

impl Blocks for LogRows<'_> {
    type Error = WorkflowError;

    fn sample(&self) -> Option<Block> {
        let wanted = Wanted { readings: true, wrench: true, ..Wanted::default() };
        self.logs.first()?.sample(&wanted).ok()
    }

    fn pass<P: Pass>(&mut self, pass: &P) -> Result<P::Partial, WorkflowError> {
        if self.summaries.is_empty() {
            return self.first_pass(pass);
        }
        let mut all = pass.empty();
        let reduce = |worker: &mut PassWorker<'_, P>, _, block: &Block| worker.reduce(block);
        let merge = |_, partial| {
            if let Some(partial) = partial {
                pass.merge(&mut all, partial);
            }
        };
        let workers = self.pass_over(self.train, || PassWorker::new(pass), reduce, merge)?;
        PassWorker::merge(workers, &mut all);
        Ok(all)
    }
}

/// Blocks that are handed out one by one, each with its log.
struct KeptBlocks<'a>(std::vec::IntoIter<(usize, &'a KeptBlock<'a>)>);

impl<'a> Pieces for KeptBlocks<'a> {
    type Piece = Option<(usize, &'a KeptBlock<'a>)>;
    type Error = std::convert::Infallible;

    fn ended(&self) -> bool {
        self.0.len() == 0
    }

    fn next(&mut self, piece: &mut Self::Piece) -> Result<bool, Self::Error> {
        *piece = self.0.next();
        Ok(piece.is_some())
    }
}
