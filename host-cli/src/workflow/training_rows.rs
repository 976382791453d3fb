//! Training logs as rows that can be passed over as often as a solver asks.
//!
//! Parsing is the dearest part of a fit, so the rows of short logs are kept from the first pass on,
//! counts as what they are, integers of 16 bits. Longer logs are read anew on every pass: memory
//! does not grow with them.

use std::sync::atomic::{AtomicBool, Ordering};

use super::WorkflowError;
use crate::block::Block;
use crate::calibration::FitError;
use crate::calibration::solver::{Blocks, Pass};
use crate::log_file::{Log, ReadOptions, ReadSummary, Wanted};
use crate::pipeline::{self, Pieces};

/// The bytes that kept rows may take: some 100,000 rows of eight channels.
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
        if let (Some(kept), Some(known)) = (&mut self.kept, known) {
            pipeline::run(
                &mut KeptBlocks(&mut kept[log]),
                self.read.thread_count(),
                |piece| piece.with_block(&map),
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
        for log in 0..self.logs.len() {
            let mut blocks = Vec::new();
            let map = |block: &mut Block| {
                let partial = pass.reduce(block)?;
                let kept = is_kept.load(Ordering::Relaxed).then(|| KeptBlock::new(block));
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

/// The readings and the wrench of some rows.
#[derive(Debug)]
struct KeptBlock {
    readings: Vec<Column>,
    /// All but the readings.
    block: Block,
}

/// The readings of one channel.
#[derive(Debug)]
enum Column {
    /// All of them are such numbers.
    Counts(Vec<u16>),
    Other(Vec<f64>),
}

impl KeptBlock {
    /// Takes the wrench out of `block`.
    fn new(block: &mut Block) -> Self {
        let readings = block.readings.iter().map(|column| Column::new(column)).collect();
        let mut wrench = std::mem::take(&mut block.wrench);
        // There was room for more rows than there are.
        wrench.iter_mut().for_each(Vec::shrink_to_fit);
        Self { readings, block: Block { rows: block.rows, wrench, ..Block::default() } }
    }

    fn bytes(&self) -> usize {
        let readings = |column: &Column| match column {
            Column::Counts(counts) => size_of_val(&counts[..]),
            Column::Other(readings) => size_of_val(&readings[..]),
        };
        let wrench = self.block.wrench.iter().map(|column| column.capacity() * size_of::<f64>());
        self.readings.iter().map(readings).chain(wrench).sum()
    }
}

impl Column {
    fn new(readings: &[f64]) -> Self {
        // Where a count is added to 2⁵², it stands in the lowest bits: a cast would take longer.
        const TO_LOWEST_BITS: f64 = (1_u64 << 52) as f64;
        let count = |&s: &f64| (s + TO_LOWEST_BITS).to_bits() as u16;
        let counts: Vec<u16> = readings.iter().map(count).collect();
        let is_exact = |(&s, &count): (&f64, &u16)| s == f64::from(count);
        // Without a way out of the loop: it is all or nothing, and nearly always all.
        let all = readings.iter().zip(&counts).map(is_exact).fold(true, |all, is| all & is);
        if all { Column::Counts(counts) } else { Column::Other(readings.to_vec()) }
    }
}

/// Blocks that are handed out one by one.
struct KeptBlocks<'a>(&'a mut [KeptBlock]);

/// One of them, and room for its readings.
#[derive(Default)]
struct KeptPiece<'a> {
    kept: Option<&'a mut KeptBlock>,
    readings: Vec<Vec<f64>>,
}

impl<'a> Pieces for KeptBlocks<'a> {
    type Piece = KeptPiece<'a>;
    type Error = std::convert::Infallible;

    fn ended(&self) -> bool {
        self.0.is_empty()
    }

    fn next(&mut self, piece: &mut KeptPiece<'a>) -> Result<bool, Self::Error> {
        piece.kept = self.0.split_off_first_mut();
        Ok(piece.kept.is_some())
    }
}

impl KeptPiece<'_> {
    /// What `map` makes of the rows as they were read.
    fn with_block<T>(&mut self, map: impl Fn(&Block) -> T) -> T {
        let Some(kept) = &mut self.kept else { return map(&Block::default()) };
        self.readings.resize_with(kept.readings.len(), Vec::new);
        for (column, kept) in self.readings.iter_mut().zip(&kept.readings) {
            column.clear();
            match kept {
                Column::Counts(counts) => column.extend(counts.iter().map(|&s| f64::from(s))),
                Column::Other(readings) => column.extend_from_slice(readings),
            }
        }
        std::mem::swap(&mut kept.block.readings, &mut self.readings);
        let value = map(&kept.block);
        std::mem::swap(&mut kept.block.readings, &mut self.readings);
        value
    }
}
