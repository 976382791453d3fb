//! The rows that a model is trained on, in groups that are held out together.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::ops::Range;
use std::sync::Arc;

use super::inversion::Estimates;
use crate::reading_ranges::ReadingRange;
use shell_data::block::Block;
use shell_data::dataset::Dataset;
use shell_data::wrench::PerAxis;

/// Most rows that are converted at a time: their results take memory.
const ROWS_AT_ONCE: usize = 4096;

/// Rows for training: references into the blocks of a data set, ordered by group.
#[derive(Clone, Debug, Default)]
pub struct TrainingRows {
    blocks: Vec<Arc<Block>>,
    channels: usize,
    /// In ascending order of groups, those of a group in the order of the data set.
    runs: Vec<Run>,
    /// What conversions of a group's rows are judged by, where that is not their wrench: loads as they are stated,
    /// where the wrench is corrected by readings of these rows.
    pub judged_by: BTreeMap<u64, PerAxis<f64>>,
}

/// Rows of a group that follow each other in a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Run {
    group: u32,
    block: u32,
    first: u32,
    rows: u32,
}

/// Rows converted by a model that has not seen them.
pub(super) struct HeldOutRows {
    /// Their groups.
    pub(super) groups: Vec<u64>,
    /// Predicted less what they are judged by, N and N·m.
    pub(super) errors: PerAxis<Vec<f64>>,
    /// What the model says of them.
    pub(super) estimates: Estimates,
}

impl TrainingRows {
    /// The labelled rows of a data set, with the labels of their groups in the order of first rows.
    ///
    /// # Panics
    /// If there are 2³² blocks or groups, or a block has so many rows.
    pub fn from_dataset(data: &Dataset) -> (Self, Vec<String>) {
        let mut rows = Self { channels: data.channels(), ..Self::default() };
        let (mut labels, mut positions) = (Vec::<String>::new(), HashMap::new());
        let index = |at: usize| u32::try_from(at).expect("fewer than 2³²");
        for (_, block) in data.blocks() {
            let mut first = 0;
            for (label, count) in &*block.labels {
                let position = *positions.entry(label.clone()).or_insert_with(|| {
                    labels.push(label.clone());
                    labels.len() - 1
                });
                if *count > 0 {
                    rows.runs.push(Run {
                        group: index(position),
                        block: index(rows.blocks.len()),
                        first: index(first),
                        rows: index(*count),
                    });
                }
                first += count;
            }
            rows.blocks.push(Arc::clone(&block.rows));
        }
        rows.runs.sort_unstable();
        (rows, labels)
    }

    /// Number of rows.
    pub fn row_count(&self) -> usize {
        count(&self.runs)
    }

    /// Number of groups.
    pub fn group_count(&self) -> usize {
        self.groups().count()
    }

    /// The runs of each group.
    pub(super) fn groups(&self) -> impl Iterator<Item = &[Run]> {
        self.runs.chunk_by(|a, b| a.group == b.group)
    }

    /// Number of channels.
    pub(super) fn channels(&self) -> usize {
        self.channels
    }

    /// A column along some runs: of the six axes, N and N·m, then of the channels, counts.
    pub(super) fn column(&self, runs: &[Run], position: usize) -> impl Iterator<Item = f64> {
        runs.iter().flat_map(move |run| self.of_run(run, position).iter().copied())
    }

    /// The part of a column that is a run's.
    pub(super) fn of_run(&self, run: &Run, position: usize) -> &[f64] {
        let Block { wrench, readings, .. } = &*self.blocks[run.block as usize];
        let column = if position < 6 { &wrench[position] } else { &readings[position - 6] };
        &column[run.range()]
    }

    /// All rows.
    pub(super) fn runs(&self) -> &[Run] {
        &self.runs
    }

    /// The least and the largest reading of each channel.
    pub fn reading_ranges(&self) -> Vec<ReadingRange> {
        let range = |channel: usize| {
            let start = ReadingRange { min: f64::INFINITY, max: f64::NEG_INFINITY };
            self.column(&self.runs, 6 + channel).fold(start, |range, reading| ReadingRange {
                min: range.min.min(reading),
                max: range.max.max(reading),
            })
        };
        (0..self.channels).map(range).collect()
    }

    /// The groups, assigned to folds: each alone, or in turn, in the order of their labels.
    pub fn folds(&self, folds: usize) -> Vec<Vec<u64>> {
        let mut assigned = vec![Vec::new(); folds.min(self.group_count())];
        for (position, runs) in self.groups().enumerate() {
            let fold = position % assigned.len();
            assigned[fold].push(runs[0].group());
        }
        assigned
    }

    /// Converts every n-th row of some groups, beginning with the first of each, in parts of at most [`ROWS_AT_ONCE`]
    /// rows. `every` is n for a group's number of rows.
    pub(super) fn convert<'a>(
        &'a self,
        groups: &'a BTreeSet<u64>,
        every: impl Fn(usize) -> usize + 'a,
        estimates: impl Fn(&[Vec<f64>]) -> Estimates + 'a,
    ) -> impl Iterator<Item = HeldOutRows> + 'a {
        let spread = move |runs: &'a [Run]| {
            let rows =
                runs.iter().flat_map(|run| (0..run.rows as usize).map(move |row| (run, row)));
            rows.step_by(every(count(runs)))
        };
        let held_out = self.groups().filter(|runs| groups.contains(&runs[0].group()));
        let mut rows = held_out.flat_map(spread);
        std::iter::from_fn(move || {
            let some: Vec<(&Run, usize)> = rows.by_ref().take(ROWS_AT_ONCE).collect();
            (!some.is_empty()).then(|| self.convert_rows(&some, &estimates))
        })
    }

    fn convert_rows(
        &self,
        rows: &[(&Run, usize)],
        estimates: impl Fn(&[Vec<f64>]) -> Estimates,
    ) -> HeldOutRows {
        let value = |run: &Run, row: usize, position: usize| self.of_run(run, position)[row];
        let readings =
            |channel: usize| rows.iter().map(|&(run, row)| value(run, row, 6 + channel)).collect();
        let estimates = estimates(&(0..self.channels).map(readings).collect::<Vec<_>>());
        let error = |axis: usize| {
            let judge = |run: &Run, row: usize| {
                let stated = self.judged_by.get(&run.group());
                stated.map_or_else(|| value(run, row, axis), |wrench| wrench[axis])
            };
            let pairs = rows.iter().zip(&estimates.wrench[axis]);
            pairs.map(|(&(run, row), predicted)| predicted - judge(run, row)).collect()
        };
        HeldOutRows {
            groups: rows.iter().map(|(run, _)| run.group()).collect(),
            errors: std::array::from_fn(error),
            estimates,
        }
    }
}

/// Number of rows.
pub(super) fn count(runs: &[Run]) -> usize {
    runs.iter().map(|run| run.rows as usize).sum()
}

impl Run {
    pub(super) fn group(&self) -> u64 {
        self.group.into()
    }

    pub(super) fn rows(&self) -> u32 {
        self.rows
    }

    fn range(&self) -> Range<usize> {
        self.first as usize..(self.first + self.rows) as usize
    }
}

#[cfg(test)]
mod tests {
    use shell_data::wrench::Axes;

    use super::*;

    #[test]
    fn every_third_row_of_a_group_is_converted_and_held_against_its_own_wrench() {
        // Groups of 6000 rows take turns every 1500; a reading is the row's number, each load twice that.
        let number: Vec<f64> = (0..18_000).map(f64::from).collect();
        let groups = (0..12).map(|run| ((run % 3).to_string(), 1500)).collect();
        let wrench = vec![number.iter().map(|n| 2.0 * n).collect(); 6];
        let rows = number.len();
        let block = Block { rows, readings: vec![number], wrench, groups, ..Block::default() };
        let data = Dataset::from_blocks("rows", Axes::ALL, vec![block]);
        let (rows, labels) = TrainingRows::from_dataset(&data);
        assert_eq!((rows.row_count(), labels.len()), (18_000, 3));
        let as_read = |readings: &[Vec<f64>]| Estimates {
            wrench: std::array::from_fn(|_| readings[0].clone()),
            ..Estimates::default()
        };
        let held_out = BTreeSet::from([0, 2]);
        let found: Vec<HeldOutRows> = rows.convert(&held_out, |_| 3, as_read).collect();
        let groups: Vec<u64> = found.iter().flat_map(|some| some.groups.clone()).collect();
        assert_eq!(groups, [vec![0; 2000], vec![2; 2000]].concat());
        let errors: Vec<f64> = found.iter().flat_map(|some| some.errors[4].clone()).collect();
        let expected = |group: u32| {
            let rows = (0..18_000).filter(move |row| row / 1500 % 3 == group);
            rows.step_by(3).map(|row| -f64::from(row))
        };
        assert_eq!(errors, expected(0).chain(expected(2)).collect::<Vec<_>>());
    }
}
