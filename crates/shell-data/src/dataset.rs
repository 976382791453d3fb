//! All rows of one or more logs, or of arrays, in memory.
//!
//! Rows stay in the blocks in which they were read, and derived data sets share these blocks. If rows are left out,
//! only their blocks are copied. Block boundaries depend only on the file or the arrays, not on threads.

use std::collections::HashMap;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

use crate::block::{Block, RowLines, kept_runs};
use crate::fingerprint::Fingerprint;
use crate::wrench::Axes;

/// Number of rows per block of arrays.
pub const BLOCK_ROWS: usize = 4096;

/// Number of rows in a sample, and number of parts of the recording from which they are taken.
const SAMPLE_ROWS: usize = 1024;
const SAMPLE_PARTS: usize = 16;

/// Labels in row order, each with the number of its rows.
pub type LabelRuns = Vec<(String, usize)>;

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ReadSummary {
    pub rows: u64,
    /// Rows whose readings equal those of the previous row; 0 if they were not requested.
    pub repeated_rows: u64,
    /// Invalid rows that were left out, including an incomplete last row.
    pub skipped_rows: u64,
    /// Lines that repeat the head of the log, as in concatenated logs.
    pub repeated_heads: u64,
    /// Checksum of the file on disk, if requested.
    pub checksum: Option<String>,
}

/// Readings and wrench in memory, by log.
#[derive(Clone, Debug, Default)]
pub struct Dataset {
    pub logs: Vec<LogRows>,
}

#[derive(Clone, Debug, Default)]
pub struct LogRows {
    /// Name in messages, usually the path.
    pub name: PathBuf,
    /// Axes of the wrench; the others are zero.
    pub axes: Axes,
    pub channels: usize,
    pub has_groups: bool,
    /// True if the sample has only rows from the log's start.
    pub is_sampled_at_start: bool,
    /// Rows from all parts of the log.
    pub sample: Block,
    pub summary: ReadSummary,
    /// Line numbers of rows, by the offset of their block.
    pub lines: HashMap<u64, RowLines>,
    pub blocks: Vec<LabelledBlock>,
}

/// Rows with labels that may differ from those in the log.
#[derive(Clone, Debug, Default)]
pub struct LabelledBlock {
    /// The rows; [`Block::groups`] is ignored.
    pub rows: Arc<Block>,
    pub labels: Arc<LabelRuns>,
}

impl From<Block> for LabelledBlock {
    fn from(mut block: Block) -> Self {
        let labels = Arc::new(std::mem::take(&mut block.groups));
        Self { rows: Arc::new(block), labels }
    }
}

/// A set of rows: for each log and block offset, the indices of rows in the block as read.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RowSet(HashMap<(usize, u64), Vec<usize>>);

impl FromIterator<(usize, u64, usize)> for RowSet {
    fn from_iter<I: IntoIterator<Item = (usize, u64, usize)>>(rows: I) -> Self {
        let mut all = Self::default();
        for (log, offset, row) in rows {
            all.0.entry((log, offset)).or_default().push(row);
        }
        all
    }
}

impl RowSet {
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub fn contains(&self, log: usize, offset: u64, row: usize) -> bool {
        self.0.get(&(log, offset)).is_some_and(|rows| rows.contains(&row))
    }
}

impl Dataset {
    pub fn fingerprint(&self) -> Fingerprint {
        let mut fingerprint = Fingerprint::default();
        self.blocks().for_each(|(_, block)| fingerprint.merge(Fingerprint::new(&block.rows)));
        fingerprint
    }

    /// Makes a data set from blocks of [`BLOCK_ROWS`] rows, except the last: readings, six wrench columns, and
    /// optionally labels and weights.
    pub fn from_blocks(name: impl Into<PathBuf>, axes: Axes, mut blocks: Vec<Block>) -> Self {
        let mut start = 0;
        for block in &mut blocks {
            block.offset = start;
            start += block.rows as u64;
        }
        let has_groups = blocks.iter().any(|block| !block.groups.is_empty());
        let log = LogRows {
            name: name.into(),
            axes,
            channels: blocks.first().map_or(0, |block| block.channels().len()),
            has_groups,
            sample: sample(blocks.iter()),
            summary: ReadSummary { rows: start, ..ReadSummary::default() },
            blocks: blocks.into_iter().map(LabelledBlock::from).collect(),
            ..LogRows::default()
        };
        Self { logs: vec![log] }
    }

    /// Returns the number of channels of the first log.
    pub fn channels(&self) -> usize {
        self.logs.first().map_or(0, |log| log.channels)
    }

    /// Returns the number of terms per channel.
    pub fn memory_terms(&self) -> usize {
        let columns = self.blocks().next().map_or(0, |(_, block)| block.rows.memory_columns);
        columns / self.channels().max(1)
    }

    pub fn rows(&self) -> u64 {
        self.logs.iter().map(LogRows::rows).sum()
    }

    /// Returns the blocks that have rows, each with the index of its log.
    pub fn blocks(&self) -> impl Iterator<Item = (usize, &LabelledBlock)> {
        let numbered = self.logs.iter().enumerate();
        let all = numbered.flat_map(|(at, log)| log.blocks.iter().map(move |block| (at, block)));
        all.filter(|(_, block)| block.rows.rows > 0)
    }

    /// Moves the rows out. Other data, such as line numbers, are in both data sets.
    #[must_use]
    pub fn take_rows(&mut self) -> Self {
        let take = |log: &mut LogRows| {
            let blocks = std::mem::take(&mut log.blocks);
            LogRows { blocks, ..log.clone() }
        };
        Self { logs: self.logs.iter_mut().map(take).collect() }
    }

    pub fn has_weights(&self) -> bool {
        self.blocks().any(|(_, block)| !block.rows.weights.is_empty())
    }

    #[must_use]
    pub fn without_memory(&self) -> Self {
        let mut data = self.clone();
        for log in &mut data.logs {
            log.sample.drop_memory();
            for block in log.blocks.iter_mut().filter(|block| block.rows.memory_columns > 0) {
                let mut rows = Block::clone(&block.rows);
                rows.drop_memory();
                block.rows = Arc::new(rows);
            }
        }
        data
    }

    /// Returns the rows that are not in `excluded` and, if `fresh`, differ from the previous row in readings.
    #[must_use]
    pub fn select(&self, fresh: bool, excluded: &RowSet) -> Self {
        if !fresh && excluded.is_empty() {
            return self.clone();
        }
        let mut selected = self.clone();
        for (at, log) in selected.logs.iter_mut().enumerate() {
            log.blocks.iter_mut().for_each(|block| block.select(at, fresh, excluded));
        }
        selected
    }
}

impl LogRows {
    pub fn rows(&self) -> u64 {
        self.blocks.iter().map(|block| block.rows.rows as u64).sum()
    }
}

impl LabelledBlock {
    fn select(&mut self, log: usize, fresh: bool, excluded: &RowSet) {
        let excluded = excluded.0.get(&(log, self.rows.offset));
        if !fresh && excluded.is_none() {
            return;
        }
        let mut keep = match fresh {
            true => self.rows.fresh_rows(),
            false => vec![true; self.rows.rows],
        };
        excluded.into_iter().flatten().for_each(|&row| keep[row] = false);
        if keep.iter().all(|keep| *keep) {
            return;
        }
        *self = self.kept(&keep);
    }

    /// Returns the rows for which `keep` is true.
    ///
    /// # Panics
    /// Like [`Block::kept`].
    #[must_use]
    pub fn kept(&self, keep: &[bool]) -> Self {
        let labels = Arc::new(kept_runs(&self.labels, keep));
        Self { rows: Arc::new(self.rows.kept(keep)), labels }
    }
}

/// Takes a sample of rows spread over `blocks`, or all rows if there are few.
pub fn sample<'a>(blocks: impl Iterator<Item = &'a Block> + Clone) -> Block {
    let rows: usize = blocks.clone().map(|block| block.rows).sum();
    let mut sample = Block::default();
    if rows <= SAMPLE_ROWS {
        blocks.for_each(|block| sample.append(block, 0..block.rows));
        return sample;
    }
    let part = SAMPLE_ROWS / SAMPLE_PARTS;
    for i in 0..SAMPLE_PARTS {
        let first = (rows - part) * i / (SAMPLE_PARTS - 1);
        let mut start = 0;
        for block in blocks.clone() {
            let within = |row: usize| row.clamp(start, start + block.rows) - start;
            let some = within(first)..within(first + part);
            if !some.is_empty() {
                sample.append(block, some);
            }
            start += block.rows;
        }
    }
    sample
}

impl Block {
    /// Appends the readings and wrench of some rows of another block.
    pub fn append(&mut self, other: &Block, rows: Range<usize>) {
        let columns = [(&mut self.readings, &other.readings), (&mut self.wrench, &other.wrench)];
        for (to, from) in columns {
            to.resize_with(from.len(), Vec::new);
            to.iter_mut().zip(from).for_each(|(to, from)| {
                to.extend_from_slice(&from[rows.clone()]);
            });
        }
        self.memory_columns = other.memory_columns;
        self.rows += rows.len();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dataset(rows: usize) -> Dataset {
        let block = |start: usize| {
            let rows = start..rows.min(start + BLOCK_ROWS);
            let column: Vec<f64> = rows.clone().map(|row| (row / 2) as f64).collect();
            let readings_before = start.checked_sub(1).map(|row| vec![(row / 2) as f64]);
            Block {
                rows: rows.len(),
                readings: vec![column.clone()],
                wrench: vec![column; 6],
                groups: vec![((start / BLOCK_ROWS).to_string(), rows.len())],
                readings_before,
                ..Block::default()
            }
        };
        let blocks = (0..rows).step_by(BLOCK_ROWS).map(block).collect();
        Dataset::from_blocks("rows", Axes::ALL, blocks)
    }

    #[test]
    fn removed_rows_are_missing_in_every_column_and_other_blocks_are_shared() {
        let all = dataset(10_000);
        let left_out = RowSet::from_iter([(0, BLOCK_ROWS as u64, 3), (0, BLOCK_ROWS as u64, 5)]);
        let some = all.select(false, &left_out);
        assert_eq!(some.rows(), 9_998);
        let [first, second, _] = &some.logs[0].blocks[..] else { panic!("three blocks") };
        assert!(Arc::ptr_eq(&first.rows, &all.logs[0].blocks[0].rows));
        assert_eq!(second.rows.readings[0][..4], [2048.0, 2048.0, 2049.0, 2050.0]);
        assert_eq!(second.labels[..], [("1".to_owned(), BLOCK_ROWS - 2)]);
        // Every second row repeats the previous one, across block boundaries as well.
        assert_eq!(all.select(true, &RowSet::default()).rows(), 5_000);
    }

    #[test]
    fn a_sample_covers_all_parts_and_few_rows_completely() {
        let sample = |rows: usize| dataset(rows).logs[0].sample.clone();
        assert_eq!(sample(700).rows, 700);
        let of_many = sample(10_000);
        assert_eq!((of_many.rows, of_many.wrench[5].len()), (SAMPLE_ROWS, SAMPLE_ROWS));
        assert_eq!(of_many.readings[0][0], 0.0);
        assert_eq!(of_many.readings[0][SAMPLE_ROWS - 1], 4999.0);
    }
}
