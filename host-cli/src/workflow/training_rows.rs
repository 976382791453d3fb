//! Training logs as rows that can be passed over as often as a solver asks.
//!
//! Parsing is the dearest part of a fit, so the rows of short logs are kept from the first pass on,
//! counts and wrenches of a digital sensor as what they are, integers of 16 bits. Longer logs are
//! read anew on every pass: memory does not grow with them.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

use super::WorkflowError;
use crate::block::Block;
use crate::calibration::FitError;
use crate::calibration::solver::{Blocks, Pass};
use crate::log_file::{Log, ReadOptions, ReadSummary, Wanted};
use crate::pipeline::{self, Pieces};
use crate::step::{Step, Words};

/// The bytes that kept rows may take: some 100,000 rows of eight channels, or 300,000 where the
/// wrench is that of a digital sensor.
const KEPT_BYTES: usize = 8 << 20;

/// The rows of training logs.
pub(super) struct TrainingRows<'a> {
    logs: &'a [Log],
    /// Use only rows whose readings differ from those of the row before.
    fresh: bool,
    read: ReadOptions<'a>,
    /// What each log was, once a pass has gone over all of them.
    summaries: Vec<ReadSummary>,
    /// The rows of each log, if they are few.
    kept: Option<Vec<Vec<KeptBlock>>>,
}

impl<'a> TrainingRows<'a> {
    /// The rows of `logs`. Progress counts the bytes of all logs, in each pass that reads them.
    pub(super) fn new(logs: &'a [Log], fresh: bool, read: ReadOptions<'a>) -> Self {
        Self { logs, fresh, read, summaries: Vec::new(), kept: None }
    }

    /// Passes over the rows of one log: `map` gets its blocks on any thread, `fold` gets what
    /// `map` makes of them, in order. Returns what the log was.
    pub(super) fn each_block<T: Send>(
        &mut self,
        log: usize,
        map: impl Fn(&Block) -> Result<T, FitError> + Sync,
        mut fold: impl FnMut(T),
    ) -> Result<ReadSummary, WorkflowError> {
        let known = self.summaries.get(log);
        if let (Some(kept), Some(known)) = (&self.kept, known) {
            let channels = self.logs[log].channels();
            pipeline::run(
                &mut KeptBlocks(&kept[log]),
                self.read.thread_count(),
                |piece| map(piece.block(channels)),
                |never| match never {},
                |value| -> Result<(), WorkflowError> {
                    fold(value?);
                    Ok(())
                },
            )?;
            return Ok(known.clone());
        }
        let read = ReadOptions { checksum: self.read.checksum && known.is_none(), ..self.read };
        let summary = self.read_log(log, &read, |block| map(block), fold)?;
        Ok(known.cloned().unwrap_or(summary))
    }

    fn read_log<T: Send>(
        &self,
        log: usize,
        read: &ReadOptions<'_>,
        map: impl Fn(&mut Block) -> Result<T, FitError> + Sync,
        mut fold: impl FnMut(T),
    ) -> Result<ReadSummary, WorkflowError> {
        let wanted = Wanted { readings: true, wrench: true, ..Wanted::default() };
        let bytes_before = self.logs[..log].iter().map(Log::bytes).sum::<u64>();
        let report = |bytes: u64| {
            if let Some(progress) = self.read.progress {
                progress(bytes_before + bytes);
            }
        };
        let read = ReadOptions { progress: Some(&report), ..*read };
        let map = |block: &mut Block| {
            if self.fresh {
                let fresh = block.fresh_rows();
                block.retain_rows(&fresh);
            }
            map(block)
        };
        self.logs[log].read(&wanted, &read, map, |value| -> Result<(), WorkflowError> {
            fold(value?);
            Ok(())
        })
    }

    /// The first pass: reads the logs and keeps their rows if they are few.
    fn first_pass<P: Pass>(&mut self, pass: &P) -> Result<P::Partial, WorkflowError> {
        let (mut summaries, mut kept) = (Vec::new(), Vec::new());
        let (mut bytes, is_kept) = (0, AtomicBool::new(true));
        let mut all = pass.empty();
        let steps = Steps::new();
        for log in 0..self.logs.len() {
            let mut blocks = Vec::new();
            let map = |block: &mut Block| {
                let partial = pass.reduce(block)?;
                let kept = is_kept.load(Ordering::Relaxed).then(|| KeptBlock::new(block, &steps));
                Ok((partial, kept))
            };
            let summary = self.read_log(log, &self.read, map, |(partial, block)| {
                pass.merge(&mut all, partial);
                bytes += block.as_ref().map_or(0, KeptBlock::bytes);
                if bytes <= KEPT_BYTES {
                    blocks.extend(block);
                } else {
                    is_kept.store(false, Ordering::Relaxed);
                    blocks.clear();
                    kept.clear();
                }
            })?;
            summaries.push(summary);
            kept.push(blocks);
        }
        self.summaries = summaries;
        self.kept = is_kept.into_inner().then_some(kept);
        Ok(all)
    }
}

impl Blocks for TrainingRows<'_> {
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
        for log in 0..self.logs.len() {
            self.each_block(
                log,
                |block| pass.reduce(block),
                |partial| {
                    pass.merge(&mut all, partial);
                },
            )?;
        }
        Ok(all)
    }
}

/// The readings and the wrench of some rows, in little memory.
#[derive(Debug)]
struct KeptBlock {
    rows: usize,
    /// The readings, then the wrench.
    columns: Vec<Column>,
    /// Those columns that are small integers, one after another.
    words: Vec<u16>,
    others: Vec<f64>,
}

/// How the numbers of one column are kept.
#[derive(Clone, Copy, Debug)]
enum Column {
    /// As multiples of a step.
    Words(Words),
    /// As they are.
    Other,
}

/// What the numbers of each column are multiples of: in the first block, and then mostly in all.
type Steps = OnceLock<Vec<Option<Step>>>;

impl KeptBlock {
    fn new(block: &Block, steps: &Steps) -> Self {
        let columns = || block.readings.iter().chain(&block.wrench);
        let steps = steps.get_or_init(|| columns().map(|column| Step::of(column)).collect());
        let mut kept = Self {
            rows: block.rows,
            columns: Vec::with_capacity(steps.len()),
            words: Vec::with_capacity(steps.len() * block.rows),
            others: Vec::new(),
        };
        for (column, step) in columns().zip(steps) {
            let words = step.and_then(|step| step.count(column, &mut kept.words));
            if words.is_none() {
                kept.others.extend_from_slice(column);
            }
            kept.columns.push(words.map_or(Column::Other, Column::Words));
        }
        kept.words.shrink_to_fit();
        kept
    }

    fn bytes(&self) -> usize {
        size_of_val(&self.words[..]) + size_of_val(&self.others[..])
    }

    /// Writes the rows as they were read.
    fn restore(&self, block: &mut Block, channels: usize) {
        block.rows = self.rows;
        block.readings.resize_with(channels, Vec::new);
        block.wrench.resize_with(self.columns.len() - channels, Vec::new);
        let (mut words, mut others) = (&self.words[..], &self.others[..]);
        let columns = block.readings.iter_mut().chain(&mut block.wrench);
        for (kept, column) in self.columns.iter().zip(columns) {
            column.clear();
            match kept {
                Column::Words(how) => {
                    let words = words.split_off(..self.rows).expect("as many as there are rows");
                    how.values(words, column);
                }
                Column::Other => {
                    let numbers = others.split_off(..self.rows).expect("likewise");
                    column.extend_from_slice(numbers);
                }
            }
        }
    }
}

/// Blocks that are handed out one by one.
struct KeptBlocks<'a>(&'a [KeptBlock]);

/// One of them, and room for its rows.
#[derive(Default)]
struct KeptPiece<'a> {
    kept: Option<&'a KeptBlock>,
    block: Block,
}

impl<'a> Pieces for KeptBlocks<'a> {
    type Piece = KeptPiece<'a>;
    type Error = std::convert::Infallible;

    fn ended(&self) -> bool {
        self.0.is_empty()
    }

    fn next(&mut self, piece: &mut KeptPiece<'a>) -> Result<bool, Self::Error> {
        piece.kept = self.0.split_off_first();
        Ok(piece.kept.is_some())
    }
}

impl KeptPiece<'_> {
    /// The rows as they were read, of so many channels.
    fn block(&mut self, channels: usize) -> &Block {
        if let Some(kept) = self.kept {
            kept.restore(&mut self.block, channels);
        }
        &self.block
    }
}
