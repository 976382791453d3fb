//! Sums by group of all rows, from those of the workers.

use std::collections::HashSet;
use std::collections::btree_map::{BTreeMap, Entry};
use std::sync::Arc;

use super::worker::{Apart, BlockGroups, GroupWorker, MAX_GROUPS, RandomSplit, SummedRows};
use crate::exact::{ExactError, Moments, PartitionedMoments};
use crate::model::{Basis, Model};
use crate::validation::ValidationError;

/// Collects the sums of workers, block by block and at the end.
#[derive(Debug)]
pub struct GroupSums {
    basis: Basis,
    channels: usize,
    apart: Apart,
    random: RandomSplit,
    /// The labels of the groups, in the order of their first rows.
    labels: Vec<Arc<str>>,
    /// Every group is among them, and those folds that have been handed over.
    sums: BTreeMap<SummedRows, Option<Moments>>,
    /// Hashes of the groups that have been assigned to sets.
    assigned: HashSet<u64>,
}

impl GroupSums {
    /// Zero rows: for `basis` and the bases within it, by what is `apart` and as `random` says.
    pub fn new(basis: Basis, channels: usize, apart: Apart, random: RandomSplit) -> Self {
        Self {
            basis,
            channels,
            apart,
            random,
            labels: Vec::new(),
            sums: BTreeMap::new(),
            assigned: HashSet::new(),
        }
    }

    /// The number of groups, or sets of them, so far.
    pub fn group_count(&self) -> usize {
        self.labels.len()
    }

    /// A worker without rows.
    pub fn worker(&self) -> GroupWorker {
        GroupWorker::new(self.basis, self.channels, self.apart, self.random)
    }

    /// Adds what a worker hands over with a block, after all blocks before it.
    ///
    /// # Errors
    /// [`ValidationError::NotExact`] if the rows cannot be summed exactly with those before;
    /// [`ValidationError::TooManyGroups`].
    pub fn add(&mut self, block: BlockGroups) -> Result<(), ValidationError> {
        for label in block.labels {
            let Entry::Vacant(new) = self.sums.entry(SummedRows::Group(label.clone())) else {
                continue;
            };
            if self.labels.len() == MAX_GROUPS {
                return Err(ValidationError::TooManyGroups { limit: MAX_GROUPS });
            }
            new.insert(None);
            self.labels.push(label);
        }
        self.assigned.extend(block.assigned);
        block.settled.into_iter().try_for_each(|(rows, moments)| self.add_moments(rows, moments))
    }

    /// The sums over all rows of all `workers`.
    ///
    /// # Errors
    /// [`ValidationError::NotExact`] if they cannot be exact.
    pub fn finish(
        mut self,
        workers: impl IntoIterator<Item = GroupWorker>,
    ) -> Result<GroupedMoments, ValidationError> {
        for worker in workers {
            for sums in worker.finish() {
                let (rows, moments) = sums?;
                self.add_moments(rows, moments)?;
            }
        }
        let mut sums_of = |summed: SummedRows| self.sums.remove(&summed).flatten();
        let with_label = |label: Arc<str>| {
            let name = label.to_string();
            Some((name, sums_of(SummedRows::Group(label))?))
        };
        let groups = self.labels.into_iter().filter_map(with_label).collect();
        let random = (0..self.random.held_out).map(SummedRows::Fold).filter_map(sums_of).collect();
        let mut grouped = GroupedMoments::new(groups, random)?;
        if self.apart == Apart::Sets {
            grouped.group_count = self.assigned.len();
        }
        Ok(grouped)
    }

    fn add_moments(&mut self, rows: SummedRows, moments: Moments) -> Result<(), ValidationError> {
        Ok(moments.add_to(self.sums.entry(rows).or_default())?)
    }
}

/// What a group is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GroupKind {
    /// The rows of a file.
    File,
    /// The rows with one label in the logs' group column.
    Column,
}

impl GroupKind {
    /// Both.
    pub const ALL: [Self; 2] = [Self::File, Self::Column];

    /// As options and documents call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::File => "file",
            Self::Column => "column",
        }
    }
}

/// Sums over all rows, apart by group.
#[derive(Clone, Debug, PartialEq)]
pub struct GroupedMoments {
    /// Label and sums of each group, in the order of their first rows.
    pub groups: Vec<(String, Moments)>,
    /// How many groups there are: more than have sums where sets of them were summed.
    pub group_count: usize,
    /// The sums of rows that were drawn at random from the same ones.
    pub random: Vec<Moments>,
    total: Option<Moments>,
}

impl GroupedMoments {
    /// The sums of `groups`, in the order of their first rows, and of the rows drawn at random.
    ///
    /// # Errors
    /// [`ExactError`] if all groups together cannot be summed exactly.
    ///
    /// # Panics
    /// If bases or numbers of channels differ.
    pub fn new(groups: Vec<(String, Moments)>, random: Vec<Moments>) -> Result<Self, ExactError> {
        let total = total(groups.iter().map(|(_, moments)| moments))?;
        Ok(Self { group_count: groups.len(), groups, random, total })
    }

    /// The sums of all rows, of which those of groups are parts.
    ///
    /// # Errors
    /// [`ValidationError`] if there are fewer than two groups, or the sums do not suit the model.
    pub(crate) fn partitioned(
        &self,
        model: &Model,
    ) -> Result<PartitionedMoments<'_>, ValidationError> {
        Ok(PartitionedMoments::new(self.all_of_several()?, model)?)
    }

    /// The sums over the rows of all groups, which are two at least.
    pub(crate) fn all_of_several(&self) -> Result<&Moments, ValidationError> {
        let found = self.groups.len();
        self.total().filter(|_| found > 1).ok_or(ValidationError::TooFewGroups { found })
    }

    /// The sums over the rows of a fold of groups, by their positions.
    ///
    /// # Panics
    /// If there are none.
    pub(crate) fn of_fold(&self, fold: &[usize]) -> Moments {
        let moments = total(fold.iter().map(|&group| &self.groups[group].1));
        moments.expect("parts of sums that are exact").expect("a fold of one group or more")
    }

    /// The sums over the rows of all groups; `None` for zero groups.
    pub fn total(&self) -> Option<&Moments> {
        self.total.as_ref()
    }
}

/// The sums of all `parts`.
fn total<'a>(parts: impl IntoIterator<Item = &'a Moments>) -> Result<Option<Moments>, ExactError> {
    let mut parts = parts.into_iter();
    let Some(first) = parts.next() else { return Ok(None) };
    let mut total = first.clone();
    for part in parts {
        total.merge(part)?;
    }
    Ok(Some(total))
}

#[cfg(test)]
mod tests {
    use super::super::worker::MAX_OPEN;
    use super::super::worker::mix;
    use super::*;
    use crate::exact::Accumulator;
    use shell_data::block::Block;

    /// So many rows from `start` on, of two channels, each row of another group than the one before.
    fn interleaved(start: usize, rows: usize, groups: usize) -> Block {
        let number = |row: usize, column: u64| (mix(row as u64 ^ (column << 32)) >> 54) as f64;
        let column = |column: u64| (start..start + rows).map(|row| number(row, column)).collect();
        Block {
            rows,
            readings: (0..2).map(column).collect(),
            wrench: (2..8).map(column).collect(),
            groups: (start..start + rows).map(|row| ((row % groups).to_string(), 1)).collect(),
            ..Block::default()
        }
    }

    #[test]
    fn more_groups_than_stay_open_are_summed_as_each_alone_by_any_workers() {
        // 420 rows of each group: a full block and more, so that all are open at some time.
        const GROUPS: usize = 2 * MAX_OPEN + 2;
        const ROWS: usize = 420 * GROUPS;
        let whole = interleaved(0, ROWS, GROUPS);
        let mut sums = GroupSums::new(Basis::Quadratic, 2, Apart::Groups, RandomSplit::default());
        let mut workers = [sums.worker(), sums.worker()];
        for (i, start) in (0..ROWS).step_by(3000).enumerate() {
            let block = interleaved(start, 3000.min(ROWS - start), GROUPS);
            let worker = &mut workers[usize::from(i % 3 == 0)];
            sums.add(worker.add(&block, &block.groups).unwrap()).unwrap();
            assert!(worker.open_sums() <= MAX_OPEN);
        }
        let found = sums.finish(workers).unwrap();
        assert_eq!(found.groups.len(), GROUPS);
        for (group, (label, moments)) in found.groups.iter().enumerate() {
            assert_eq!(*label, group.to_string());
            let pick = |column: &Vec<f64>| -> Vec<f64> {
                column.iter().copied().skip(group).step_by(GROUPS).collect()
            };
            let mut alone = Accumulator::new(Basis::Quadratic, 2);
            let [readings, wrench] =
                [&whole.readings, &whole.wrench].map(|columns| columns.iter().map(pick).collect());
            let (readings, wrench): (Vec<Vec<f64>>, Vec<Vec<f64>>) = (readings, wrench);
            alone.absorb(&readings, &wrench).unwrap();
            assert_eq!(*moments, alone.finish().unwrap(), "group {group}");
        }
    }

    #[test]
    fn more_groups_than_may_be_are_dealt_whole_into_sets_and_counted() {
        const GROUPS: usize = 3 * MAX_GROUPS;
        const ROWS: usize = 2 * GROUPS;
        let sum = |apart: Apart, parts: usize| {
            let mut sums = GroupSums::new(Basis::Linear, 2, apart, RandomSplit::default());
            let mut workers = [sums.worker(), sums.worker()];
            for (i, start) in (0..ROWS).step_by(parts).enumerate() {
                let block = interleaved(start, parts.min(ROWS - start), GROUPS);
                sums.add(workers[i % 2].add(&block, &block.groups)?)?;
            }
            sums.finish(workers)
        };
        let too_many = ValidationError::TooManyGroups { limit: MAX_GROUPS };
        assert_eq!(sum(Apart::Groups, ROWS).unwrap_err(), too_many);
        let found = sum(Apart::Sets, ROWS).unwrap();
        assert_eq!(found.group_count, GROUPS);
        // Poisson of mean 3: of 2000 sets e⁻³, some 100, stay empty.
        assert!((1850..1950).contains(&found.groups.len()), "{}", found.groups.len());
        // Both rows of a group are in one set, so that every number of rows is even.
        assert!(found.groups.iter().all(|(_, moments)| moments.rows() % 2 == 0));
        assert_eq!(found.total().unwrap().rows(), ROWS as u64);
        assert_eq!(sum(Apart::Sets, 777).unwrap(), found);
    }
}
