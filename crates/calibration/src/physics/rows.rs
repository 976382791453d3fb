//! The rows that a model is trained on, in groups that are held out together.

use std::collections::{BTreeMap, BTreeSet};

use super::inversion::Estimates;
use crate::grouped_rows::{GroupedRows, Run, count};
use shell_data::dataset::Dataset;
use shell_data::wrench::PerAxis;

/// Most rows that are converted at a time: their results take memory.
const ROWS_AT_ONCE: usize = 4096;

/// Rows for training.
#[derive(Clone, Debug, Default)]
pub struct TrainingRows {
    pub(super) rows: GroupedRows,
    pub(super) channels: usize,
    /// What conversions of a group's rows are judged by, where that is not their wrench: loads as they are stated,
    /// where the wrench is corrected by readings of these rows.
    pub judged_by: BTreeMap<u64, PerAxis<f64>>,
}

impl TrainingRows {
    /// The labelled rows of a data set, with the labels of their groups in the order of first rows.
    ///
    /// # Panics
    /// If there are 2³² blocks or groups, or a block has so many rows.
    pub fn from_dataset(data: &Dataset) -> (Self, Vec<String>) {
        let (rows, labels) = GroupedRows::from_labels(data);
        (Self { rows, channels: data.channels(), judged_by: BTreeMap::new() }, labels)
    }

    /// Number of rows.
    pub fn row_count(&self) -> usize {
        self.rows.row_count()
    }

    /// Number of groups.
    pub fn group_count(&self) -> usize {
        self.rows.groups().count()
    }

    /// The groups, assigned to folds: each alone, or in turn, in the order of their labels.
    pub fn folds(&self, folds: usize) -> Vec<Vec<u64>> {
        let mut assigned = vec![Vec::new(); folds.min(self.group_count())];
        for (position, runs) in self.rows.groups().enumerate() {
            let fold = position % assigned.len();
            assigned[fold].push(runs[0].group());
        }
        assigned
    }

    /// Converts every n-th row of some groups, beginning with the first of each, in parts of at most [`ROWS_AT_ONCE`]
    /// rows. `every` is n for a group's number of rows. `take` takes the group of each row, the predicted wrench less
    /// what it is judged by, and its standard errors as the model says, N and N·m.
    pub(super) fn convert(
        &self,
        groups: &BTreeSet<u64>,
        every: impl Fn(usize) -> usize,
        estimates: impl Fn(&[Vec<f64>]) -> Estimates,
        mut take: impl FnMut(u64, PerAxis<f64>, PerAxis<f64>),
    ) {
        let rows_of = |run: &'_ Run| 0..run.rows() as usize;
        let mut some: Vec<(&Run, usize)> = Vec::new();
        for runs in self.rows.groups().filter(|runs| groups.contains(&runs[0].group())) {
            let rows = runs.iter().flat_map(|run| rows_of(run).map(move |row| (run, row)));
            some.extend(rows.step_by(every(count(runs))));
        }
        for rows in some.chunks(ROWS_AT_ONCE) {
            let column = |position: usize| {
                rows.iter().map(move |&(run, row)| self.rows.of_run(run, position)[row])
            };
            let readings = (6..6 + self.channels).map(|at| column(at).collect());
            let estimates = estimates(&readings.collect::<Vec<_>>());
            for (at, &(run, row)) in rows.iter().enumerate() {
                let (estimate, stated) = (estimates.row(at), self.judged_by.get(&run.group()));
                let judge = |axis: usize| match stated {
                    Some(wrench) => wrench[axis],
                    None => self.rows.of_run(run, axis)[row],
                };
                let errors = std::array::from_fn(|axis| estimate.wrench[axis] - judge(axis));
                take(run.group(), errors, estimate.standard_errors);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use shell_data::block::Block;
    use shell_data::wrench::Axes;

    use super::*;
    use crate::physics::Flags;

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
            standard_errors: std::array::from_fn(|_| readings[0].clone()),
            flags: vec![Flags::default(); readings[0].len()],
        };
        let held_out = BTreeSet::from([0, 2]);
        let (mut groups, mut errors) = (Vec::new(), Vec::new());
        rows.convert(
            &held_out,
            |_| 3,
            as_read,
            |group, of_row, _| {
                groups.push(group);
                errors.push(of_row[4]);
            },
        );
        assert_eq!(groups, [vec![0; 2000], vec![2; 2000]].concat());
        let expected = |group: u32| {
            let rows = (0..18_000).filter(move |row| row / 1500 % 3 == group);
            rows.step_by(3).map(|row| -f64::from(row))
        };
        assert_eq!(errors, expected(0).chain(expected(2)).collect::<Vec<_>>());
    }
}
