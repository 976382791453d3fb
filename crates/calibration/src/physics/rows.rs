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

/// A row converted by a model that has not seen it.
pub(super) struct HeldOutRow {
    pub(super) group: u64,
    /// Predicted less what it is judged by, N and N·m.
    pub(super) errors: PerAxis<f64>,
    /// N and N·m, as the model says.
    pub(super) standard_errors: PerAxis<f64>,
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
    /// rows. `every` is n for a group's number of rows.
    pub(super) fn convert<'a>(
        &'a self,
        groups: &'a BTreeSet<u64>,
        every: impl Fn(usize) -> usize + 'a,
        estimates: impl Fn(&[Vec<f64>]) -> Estimates + 'a,
    ) -> impl Iterator<Item = HeldOutRow> + 'a {
        let spread = move |runs: &'a [Run]| {
            let rows =
                runs.iter().flat_map(|run| (0..run.rows() as usize).map(move |row| (run, row)));
            rows.step_by(every(count(runs)))
        };
        let held_out = self.rows.groups().filter(|runs| groups.contains(&runs[0].group()));
        let mut rows = held_out.flat_map(spread);
        let parts = std::iter::from_fn(move || {
            let some: Vec<(&Run, usize)> = rows.by_ref().take(ROWS_AT_ONCE).collect();
            (!some.is_empty()).then(|| self.convert_rows(&some, &estimates))
        });
        parts.flatten()
    }

    fn convert_rows(
        &self,
        rows: &[(&Run, usize)],
        estimates: impl Fn(&[Vec<f64>]) -> Estimates,
    ) -> Vec<HeldOutRow> {
        let value = |run: &Run, row: usize, position: usize| self.rows.of_run(run, position)[row];
        let readings =
            |channel: usize| rows.iter().map(|&(run, row)| value(run, row, 6 + channel)).collect();
        let estimates = estimates(&(0..self.channels).map(readings).collect::<Vec<_>>());
        let convert = |(at, &(run, row)): (usize, &(&Run, usize))| {
            let (estimate, stated) = (estimates.row(at), self.judged_by.get(&run.group()));
            let judge = |axis| stated.map_or_else(|| value(run, row, axis), |wrench| wrench[axis]);
            HeldOutRow {
                group: run.group(),
                errors: std::array::from_fn(|axis| estimate.wrench[axis] - judge(axis)),
                standard_errors: estimate.standard_errors,
            }
        };
        rows.iter().enumerate().map(convert).collect()
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
        let found: Vec<HeldOutRow> = rows.convert(&held_out, |_| 3, as_read).collect();
        let groups: Vec<u64> = found.iter().map(|row| row.group).collect();
        assert_eq!(groups, [vec![0; 2000], vec![2; 2000]].concat());
        let errors: Vec<f64> = found.iter().map(|row| row.errors[4]).collect();
        let expected = |group: u32| {
            let rows = (0..18_000).filter(move |row| row / 1500 % 3 == group);
            rows.step_by(3).map(|row| -f64::from(row))
        };
        assert_eq!(errors, expected(0).chain(expected(2)).collect::<Vec<_>>());
    }
}
