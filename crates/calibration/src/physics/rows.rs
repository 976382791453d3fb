//! The rows that a model is trained on, in groups that are held out together.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use super::PhysicsError;
use super::inversion::Estimates;
use super::observations::{Observation, group_means};
use shell_data::dataset::Dataset;
use shell_data::wrench::PerAxis;

/// Rows for training, all of them in memory: some 8 bytes for each number.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrainingRows {
    /// The group of each row: rows of one pose, push or file.
    pub groups: Vec<u64>,
    /// N and N·m, one column per axis.
    pub wrench: PerAxis<Vec<f64>>,
    /// Counts, one column per channel.
    pub readings: Vec<Vec<f64>>,
    /// What conversions of a group's rows are judged by, where that is not their wrench: loads as they are stated,
    /// where the wrench is corrected by readings of these rows.
    pub judged_by: BTreeMap<u64, PerAxis<f64>>,
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
    /// The rows of a data set, with the labels of their groups in the order of first rows.
    pub fn from_dataset(data: &Dataset) -> (Self, Vec<String>) {
        let (mut rows, mut labels) = (Self::default(), Vec::<String>::new());
        let mut positions = HashMap::new();
        rows.readings.resize_with(data.channels(), Vec::new);
        for (_, block) in data.blocks() {
            let columns = rows.wrench.iter_mut().chain(&mut rows.readings);
            for (column, more) in columns.zip(block.rows.wrench.iter().chain(&block.rows.readings))
            {
                column.extend_from_slice(more);
            }
            for (label, count) in &*block.labels {
                let position = *positions.entry(label.clone()).or_insert_with(|| {
                    labels.push(label.clone());
                    labels.len() as u64 - 1
                });
                rows.groups.extend(std::iter::repeat_n(position, *count));
            }
        }
        (rows, labels)
    }

    /// Number of groups.
    pub fn group_count(&self) -> usize {
        self.groups.iter().collect::<BTreeSet<_>>().len()
    }

    /// The observations that these rows are.
    ///
    /// # Errors
    /// As [`group_means`].
    ///
    /// # Panics
    /// If the columns are of different lengths.
    pub fn observations(&self) -> Result<Vec<Observation>, PhysicsError> {
        let wrench = self.wrench.each_ref().map(Vec::as_slice);
        let readings: Vec<&[f64]> = self.readings.iter().map(Vec::as_slice).collect();
        group_means(&self.groups, &wrench, &readings)
    }

    /// The rows of all other groups.
    pub(super) fn without(&self, groups: &BTreeSet<u64>) -> Self {
        let keep: Vec<bool> = self.groups.iter().map(|group| !groups.contains(group)).collect();
        let pick = |column: &Vec<f64>| {
            let kept = column.iter().zip(&keep).filter(|(_, keep)| **keep);
            kept.map(|(value, _)| *value).collect()
        };
        Self {
            groups: self.groups.iter().copied().filter(|group| !groups.contains(group)).collect(),
            wrench: self.wrench.each_ref().map(pick),
            readings: self.readings.iter().map(pick).collect(),
            judged_by: self.judged_by.clone(),
        }
    }

    /// The groups, assigned to folds: each alone, or in turn, in the order of their labels.
    pub fn folds(&self, folds: usize) -> Vec<Vec<u64>> {
        let groups: BTreeSet<u64> = self.groups.iter().copied().collect();
        let mut assigned = vec![Vec::new(); folds.min(groups.len())];
        for (position, group) in groups.into_iter().enumerate() {
            let fold = position % assigned.len();
            assigned[fold].push(group);
        }
        assigned
    }

    /// Converts the rows of some groups, of each group `most` that are spread over it.
    pub(super) fn convert(
        &self,
        groups: &BTreeSet<u64>,
        most: usize,
        estimates: impl Fn(&[Vec<f64>]) -> Estimates,
    ) -> HeldOutRows {
        let rows = 0..self.groups.len();
        let rows = rows.filter(|&row| groups.contains(&self.groups[row]));
        let mut of_groups = BTreeMap::<u64, Vec<usize>>::new();
        rows.for_each(|row| of_groups.entry(self.groups[row]).or_default().push(row));
        let spread = |rows: Vec<usize>| {
            let step = rows.len().div_ceil(most);
            rows.into_iter().step_by(step)
        };
        let rows: Vec<usize> = of_groups.into_values().flat_map(spread).collect();
        let pick = |column: &Vec<f64>| rows.iter().map(|&row| column[row]).collect::<Vec<_>>();
        let readings: Vec<Vec<f64>> = self.readings.iter().map(pick).collect();
        let estimates = estimates(&readings);
        let error = |axis: usize| {
            let pairs = rows.iter().zip(&estimates.wrench[axis]);
            let judge = |row: usize| {
                let stated = self.judged_by.get(&self.groups[row]);
                stated.map_or(self.wrench[axis][row], |wrench| wrench[axis])
            };
            pairs.map(|(&row, predicted)| predicted - judge(row)).collect()
        };
        HeldOutRows {
            groups: rows.iter().map(|&row| self.groups[row]).collect(),
            errors: std::array::from_fn(error),
            estimates,
        }
    }
}
