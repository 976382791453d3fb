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

/// The bytes that kept rows may take as small integers, and again as other numbers: some 100,000 rows
/// of eight channels, or 300,000 where the wrench is that of a digital sensor.
const KEPT_BYTES: usize = 8 << 20;

/// Test logs are read together with the training logs if all of them are at most this long, so that
/// their rows are likely to be kept: one pass of all cores in place of two.
const TOGETHER_BYTES: u64 = 3 * KEPT_BYTES as u64;

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
}

/// Memory for the rows of such logs.
pub(super) fn store(train: &[Log], test: &[Log]) -> Store {
    let bytes: u64 = train.iter().chain(test).map(Log::bytes).sum();
    // Rows take a quarter of their text or so.
    Store::new(KEPT_BYTES, bytes / 4)
}

impl<'a> LogRows<'a> {
    /// The rows of some logs. Progress counts the bytes of all logs in each pass that reads them.
    pub(super) fn new(
        train: &'a [Log],
        test: &'a [Log],
        used: UsedRows<'a>,
        read: ReadOptions<'a>,
        room: Room<'a>,
    ) -> Self {
        let logs: Vec<&Log> = train.iter().chain(test).collect();
        let stamps = logs.iter().map(|log| stamp(log.path())).collect();
        let (summaries, kept) = (Vec::new(), Vec::new());
        Self { logs, train: train.len(), used, read, stamps, summaries, kept, room }
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
        let is_short = self.logs.iter().map(|log| log.bytes()).sum::<u64>() <= TOGETHER_BYTES;
        let logs = if is_short { self.logs.len() } else { self.train };
        let (steps, is_kept) = (Steps::new(), AtomicBool::new(true));
        let init = || PassWorker::new(pass);
        let map = |worker: &mut PassWorker<'_, P>, log: usize, block: &mut Block| {
            let partial = (log < self.train).then(|| worker.reduce(block)).transpose()?.flatten();
            let is_kept = is_kept.load(Ordering::Relaxed);
            let kept = is_kept.then(|| KeptBlock::new(block, &steps, &self.room)).flatten();
            Ok((partial, kept))
        };
        let (mut all, mut kept, mut other_bytes) = (pass.empty(), Vec::new(), 0);
        kept.resize_with(logs, Vec::new);
        let fold = |log: usize, (partial, block): (Option<P::Partial>, Option<KeptBlock<'a>>)| {
            if let Some(partial) = partial {
                pass.merge(&mut all, partial);
            }
            other_bytes += block.as_ref().map_or(0, KeptBlock::other_bytes);
            let Some(block) = block.filter(|_| other_bytes <= KEPT_BYTES) else {
                is_kept.store(false, Ordering::Relaxed);
                kept.truncate(if log < self.train { 0 } else { self.train });
                return;
            };
            if let Some(kept) = kept.get_mut(log) {
                kept.push(block);
            }
        };
        let (summaries, workers) = self.read_logs(0..logs, &self.read, init, map, fold)?;
        (self.summaries, self.kept) = (summaries, kept);
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
