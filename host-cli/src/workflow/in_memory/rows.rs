//! Rows in memory as blocks that threads work on.

use std::ops::Range;

use crate::workflow::WorkflowError;
use calibration::solver::{Blocks, Pass, PassWorker};
use log_file::ReadOptions;
use log_file::pipeline::{self, Pieces};
use shell_data::block::Block;

/// Rows that are worked on at a time.
pub const BLOCK_ROWS: usize = 4096;

/// Rows that a sample has.
const SAMPLE_ROWS: usize = 1024;

/// Rows of readings and wrench in memory.
pub trait RowSource: Sync {
    /// Their number.
    fn rows(&self) -> usize;

    /// Number of channels.
    fn channels(&self) -> usize;

    /// Whether rows have labels of groups.
    fn has_groups(&self) -> bool;

    /// Whether rows count more or less than one another.
    fn has_weights(&self) -> bool {
        false
    }

    /// Puts some rows into a block: readings, wrench and, where there are any, labels and weights.
    fn fill(&self, rows: Range<usize>, block: &mut Block);

    /// Whether the caller wants no more of it.
    fn is_stopped(&self) -> bool {
        false
    }

    /// Told how many more rows a pass has dealt with.
    fn note_progress(&self, _rows: usize) {}
}

/// The rows of a source, as solvers pass over them.
pub(super) struct InMemory<'a> {
    pub(super) source: &'a dyn RowSource,
    pub(super) threads: usize,
}

/// Where the next block begins.
struct BlockRanges<'a> {
    next: usize,
    source: &'a dyn RowSource,
}

/// The caller wants no more.
struct Stopped;

impl Pieces for BlockRanges<'_> {
    type Piece = Block;
    type Error = Stopped;

    fn ended(&self) -> bool {
        self.next >= self.source.rows()
    }

    fn next(&mut self, block: &mut Block) -> Result<bool, Stopped> {
        if self.source.is_stopped() {
            return Err(Stopped);
        }
        // The piece is filled by the thread that gets it: this says which rows.
        block.rows = self.next;
        let is_there = !self.ended();
        self.next += BLOCK_ROWS;
        Ok(is_there)
    }
}

impl InMemory<'_> {
    /// Passes every block to `work`, on any thread, and what comes of it to `fold`, in order. Returns the
    /// states of the threads.
    pub(super) fn each_block<S: Send, T: Send>(
        &self,
        init: impl Fn() -> S + Sync,
        work: impl Fn(&mut S, &mut Block) -> T + Sync,
        fold: impl FnMut(T) -> Result<(), WorkflowError>,
    ) -> Result<Vec<S>, WorkflowError> {
        let source = self.source;
        let threads = ReadOptions { threads: self.threads, ..ReadOptions::default() };
        let work = |state: &mut S, block: &mut Block| {
            let rows = block.rows..source.rows().min(block.rows + BLOCK_ROWS);
            let count = rows.len();
            source.fill(rows, block);
            let done = work(state, block);
            source.note_progress(count);
            done
        };
        let mut ranges = BlockRanges { next: 0, source };
        let stopped = |Stopped| WorkflowError::Interrupted;
        pipeline::run(&mut ranges, threads.thread_count(), init, work, stopped, fold)
    }
}

impl Blocks for InMemory<'_> {
    type Error = WorkflowError;

    fn sample(&self) -> Option<Block> {
        (self.source.rows() > 0).then(|| rows_sample(self.source))
    }

    fn pass<P: Pass>(&mut self, pass: &P) -> Result<P::Partial, WorkflowError> {
        let mut all = pass.empty();
        let reduce = |worker: &mut PassWorker<'_, P>, block: &mut Block| worker.reduce(block);
        let workers = self.each_block(
            || PassWorker::new(pass),
            reduce,
            |partial| {
                if let Some(partial) = partial? {
                    pass.merge(&mut all, partial);
                }
                Ok(())
            },
        )?;
        PassWorker::merge(workers, &mut all);
        Ok(all)
    }
}

/// Rows from all over the source.
pub(super) fn rows_sample(source: &dyn RowSource) -> Block {
    let rows = source.rows();
    if rows <= SAMPLE_ROWS {
        let mut block = Block::default();
        source.fill(0..rows, &mut block);
        return block;
    }
    let (mut sample, mut part) = (Block::default(), Block::default());
    const PARTS: usize = 16;
    for i in 0..PARTS {
        let start = (rows - SAMPLE_ROWS / PARTS) * i / (PARTS - 1);
        source.fill(start..start + SAMPLE_ROWS / PARTS, &mut part);
        sample.rows += part.rows;
        for (all, part) in
            [(&mut sample.readings, &mut part.readings), (&mut sample.wrench, &mut part.wrench)]
        {
            all.resize_with(part.len(), Vec::new);
            all.iter_mut().zip(part).for_each(|(all, part)| all.append(part));
        }
    }
    sample
}
