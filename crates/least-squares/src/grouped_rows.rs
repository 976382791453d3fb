//! Rows by group, as references into the blocks that were read: a copy would double the memory.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;

use crate::passes::{Rows, Workers};
use crate::random_split::{RandomSplit, assign};
use shell_data::block::Block;
use shell_data::dataset::{Dataset, sample};
use shell_data::statistics::RunningVariance;
use shell_data::wrench::Axes;

pub const MAX_GROUPS: usize = 2000;

#[derive(Clone, Debug, Default)]
pub struct GroupedRows {
    blocks: Vec<Arc<Block>>,
    /// Runs in ascending order of groups, and within a group in the order of the data set.
    pub runs: Vec<Run>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Run {
    group: u32,
    block: u32,
    first: u32,
    pub rows: u32,
}

/// # Panics
/// If `at` is 2³² or more.
fn index(at: usize) -> u32 {
    u32::try_from(at).expect("fewer than 2³²")
}

impl GroupedRows {
    /// Groups the rows by the labels of a data set. Also returns the labels, in the order of the groups' first rows.
    pub fn from_labels(data: &Dataset) -> (Self, Vec<String>) {
        let (mut labels, mut positions) = (Vec::<String>::new(), HashMap::new());
        let mut rows = Self::default();
        for (_, block) in data.blocks() {
            let mut first = 0;
            for (label, count) in block.labels.iter().filter(|(_, count)| *count > 0) {
                let group = *positions.entry(label.clone()).or_insert_with(|| {
                    labels.push(label.clone());
                    labels.len() - 1
                });
                rows.push(group, first..first + count);
                first += count;
            }
            rows.blocks.push(Arc::clone(&block.rows));
        }
        rows.runs.sort_unstable();
        (rows, labels)
    }

    /// Groups the rows by fold. Rows that are never held out form the last group.
    pub fn from_split(data: &Dataset, split: &RandomSplit) -> Self {
        let mut rows = Self::default();
        for (_, block) in data.blocks() {
            let block = &block.rows;
            let mut fold_of = vec![split.held_out; block.rows];
            for (fold, assigned) in assign(block, split).iter().enumerate() {
                assigned.iter().for_each(|&row| fold_of[row] = fold);
            }
            let mut first = 0;
            for run in fold_of.chunk_by(|a, b| a == b) {
                rows.push(run[0], first..first + run.len());
                first += run.len();
            }
            rows.blocks.push(Arc::clone(block));
        }
        rows.runs.sort_unstable();
        rows
    }

    fn push(&mut self, group: usize, rows: Range<usize>) {
        let (group, block) = (index(group), index(self.blocks.len()));
        let (first, rows) = (index(rows.start), index(rows.len()));
        self.runs.push(Run { group, block, first, rows });
    }

    /// Moves the rows of each group g to group `groups[g]`.
    pub fn regrouped(&self, groups: &[usize]) -> Self {
        let into = |run: &Run| Run { group: index(groups[run.group as usize]), ..*run };
        let mut runs: Vec<Run> = self.runs.iter().map(into).collect();
        runs.sort_unstable();
        Self { blocks: self.blocks.clone(), runs }
    }

    /// Every n-th row of each group, starting with its first.
    pub fn every_nth(&self, n: usize) -> Self {
        let runs = self.groups().flat_map(|runs| every_nth(runs, n)).collect();
        Self { blocks: self.blocks.clone(), runs }
    }

    pub fn row_count(&self) -> usize {
        count(&self.runs)
    }

    pub fn groups(&self) -> impl Iterator<Item = &[Run]> {
        self.runs.chunk_by(|a, b| a.group == b.group)
    }

    /// Runs of a group; empty if it has no rows.
    pub fn group(&self, group: usize) -> &[Run] {
        let before = |end: usize| self.runs.partition_point(|run| (run.group as usize) < end);
        &self.runs[before(group)..before(group + 1)]
    }

    /// A column over some runs. Positions 0 to 5 are axes in N and N·m, followed by readings in counts.
    pub fn column(&self, runs: &[Run], position: usize) -> impl Iterator<Item = f64> {
        runs.iter().flat_map(move |run| self.of_run(run, position).iter().copied())
    }

    pub fn of_run(&self, run: &Run, position: usize) -> &[f64] {
        let Block { wrench, readings, .. } = &*self.blocks[run.block as usize];
        let column = if position < 6 { &wrench[position] } else { &readings[position - 6] };
        &column[run.first as usize..(run.first + run.rows) as usize]
    }

    /// Variance over some runs; `position` is as in [`column`](Self::column).
    pub fn spread(&self, runs: &[Run], position: usize) -> RunningVariance {
        let mut all = RunningVariance::default();
        for run in runs {
            all.merge(&RunningVariance::new(self.of_run(run, position)));
        }
        all
    }

    /// Copies readings and wrench of some runs, `rows` rows at a time.
    pub fn copied<'a>(&'a self, runs: &'a [Run], rows: usize) -> impl Iterator<Item = Block> + 'a {
        let (mut runs, mut taken) = (runs.iter().peekable(), 0);
        std::iter::from_fn(move || {
            let mut copy = Block::default();
            while let Some(run) = runs.peek().filter(|_| copy.rows < rows) {
                let (first, end) = ((run.first as usize) + taken, (run.first + run.rows) as usize);
                let part = first..end.min(first.saturating_add(rows - copy.rows));
                taken = if part.end == end { 0 } else { taken + part.len() };
                copy.append(&self.blocks[run.block as usize], part);
                if taken == 0 {
                    runs.next();
                }
            }
            (copy.rows > 0).then_some(copy)
        })
    }

    /// Number of channels; 0 without rows.
    pub fn channels(&self) -> usize {
        self.blocks.first().map_or(0, |block| block.channels().len())
    }

    pub fn to_block(&self, labels: &[String]) -> Block {
        let counts = self.groups().map(count);
        let groups = labels.iter().cloned().zip(counts).collect();
        Block { groups, ..self.copied(&self.runs, usize::MAX).next().unwrap_or_default() }
    }

    /// A data set with copies of the rows, labelled with their group numbers.
    pub fn to_dataset(&self) -> Dataset {
        let labelled = |runs: &[Run]| {
            let groups = vec![(runs[0].group.to_string(), count(runs))];
            self.copied(runs, usize::MAX).next().map(|block| Block { groups, ..block })
        };
        Dataset::from_blocks("groups", Axes::ALL, self.groups().filter_map(labelled).collect())
    }

    /// All rows, including those without a group.
    pub fn all<'a>(&'a self, workers: Workers<'a>) -> Rows<'a> {
        Rows::from_blocks(self.blocks.iter().map(|block| &**block), workers)
    }

    pub fn sample(&self) -> Block {
        sample(self.blocks.iter().map(|block| &**block))
    }
}

pub fn every_nth(runs: &[Run], n: usize) -> Vec<Run> {
    let mut before = 0;
    let nth = |run: &Run| {
        let rows = before..before + run.rows;
        before = rows.end;
        let (run, start) = (*run, rows.start);
        let kept = rows.filter(move |row| (*row as usize).is_multiple_of(n));
        kept.map(move |row| Run { first: run.first + row - start, rows: 1, ..run })
    };
    runs.iter().flat_map(nth).collect()
}

pub fn count(runs: &[Run]) -> usize {
    runs.iter().map(|run| run.rows as usize).sum()
}

impl Run {
    /// Number of the group, from 0.
    pub fn group(&self) -> u64 {
        self.group.into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows whose reading is their index, in blocks of ten, labelled a, b, c in turn every four rows.
    fn data() -> Dataset {
        let block = |start: u32| {
            let reading: Vec<f64> = (start..start + 10).map(f64::from).collect();
            let label = |row: u32| ["a", "b", "c"][row as usize / 4 % 3].to_owned();
            let groups = (start..start + 10).map(|row| (label(row), 1)).collect();
            let wrench = vec![reading.clone(); 6];
            Block { rows: 10, readings: vec![reading], wrench, groups, ..Block::default() }
        };
        Dataset::from_blocks("rows", Axes::ALL, (0..5).map(|i| block(10 * i)).collect())
    }

    fn readings(rows: &GroupedRows, group: usize) -> Vec<f64> {
        rows.column(rows.group(group), 6).collect()
    }

    #[test]
    fn groups_have_their_rows_in_order_in_copies_of_any_size_too() {
        let (rows, labels) = GroupedRows::from_labels(&data());
        assert_eq!((rows.row_count(), &labels[..]), (50, &["a", "b", "c"].map(String::from)[..]));
        let of = |group: u32| (0..50).filter(move |row| row / 4 % 3 == group).map(f64::from);
        for group in 0..3 {
            let expected: Vec<f64> = of(group as u32).collect();
            assert_eq!(readings(&rows, group), expected);
            for size in [1, 3, 7, 100] {
                let copies: Vec<Block> = rows.copied(rows.group(group), size).collect();
                assert!(copies[..copies.len() - 1].iter().all(|block| block.rows == size));
                let together = copies.iter().flat_map(|block| &block.readings[0]);
                assert_eq!(together.copied().collect::<Vec<_>>(), expected);
            }
        }
        let few = rows.every_nth(4).regrouped(&[1, 0, 1]);
        assert_eq!(readings(&few, 0), [4.0, 16.0, 28.0, 40.0]);
        assert_eq!(readings(&few, 1), [0.0, 8.0, 12.0, 20.0, 24.0, 32.0, 36.0, 44.0, 48.0]);
        assert!(few.group(2).is_empty());
        let folds = few.to_dataset();
        let labels: Vec<_> = folds.blocks().map(|(_, block)| block.labels[0].clone()).collect();
        assert_eq!(labels, [("0".to_owned(), 4), ("1".to_owned(), 9)]);
    }

    #[test]
    fn a_split_has_every_row_once_and_those_that_are_never_held_out_last() {
        let rows =
            GroupedRows::from_split(&data(), &RandomSplit { folds: 5, held_out: 2, seed: 3 });
        let mut all: Vec<f64> = (0..3).flat_map(|group| readings(&rows, group)).collect();
        assert!(rows.group(2).len() > rows.group(0).len());
        all.sort_unstable_by(f64::total_cmp);
        assert_eq!(all, (0..50).map(f64::from).collect::<Vec<_>>());
    }
}
