//! Sums of rows, group by group, in one pass.
//!
//! Rows are also assigned to random folds, for comparison. All sums are exact: those of the groups, and of the folds,
//! add up to the sums of all rows bit for bit, in any order. Every worker thread has a [`GroupWorker`], which sums
//! without locks. With each block it hands over the sums that have been open for the longest time to the [`GroupSums`]
//! of the caller, and at the end all others.
//!
//! A group takes about 16 bytes for each distinct sum and some 50 for each sum with a wrench (under 150 kB for eight
//! channels and poly3, 20 kB for the cubic model). In each worker that has met it, up to 256 rows wait to be summed
//! together, and at most `MAX_OPEN` groups have working sums. There may be [`MAX_GROUPS`] groups, or any number in as
//! many sets, see [`Apart::Sets`].

use crate::error::FitError;
use std::borrow::Cow;
use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, HashMap, HashSet, VecDeque};
use std::sync::Arc;

use crate::exact::{Accumulator, Adder, ExactError, ExactSums, PartitionedSums};
pub use crate::grouped_rows::MAX_GROUPS;
use crate::model::{Basis, Model};
use crate::random_split::mix;
pub use crate::random_split::{RandomSplit, assign};
use shell_data::block::Block;
use shell_data::dataset::LabelRuns;

/// Collects the sums of workers, block by block and at the end.
#[derive(Debug)]
pub struct GroupSums {
    empty: GroupWorker,
    labels: Vec<Arc<str>>,
    /// Sums of every group, and of the folds that have been handed over.
    sums: BTreeMap<SummedRows, Option<ExactSums>>,
    assigned: HashSet<u64>,
}

impl GroupSums {
    /// Starts with zero rows, for `basis` and the bases within it. `apart` selects groups or sets.
    pub fn new(basis: Basis, channels: usize, apart: Apart, random: RandomSplit) -> Self {
        let (sums, open) = (BTreeMap::new(), VecDeque::new());
        let adder = Adder::new(basis, channels);
        Self {
            empty: GroupWorker { channels, apart, random, adder, sums, open },
            labels: Vec::new(),
            sums: BTreeMap::new(),
            assigned: HashSet::new(),
        }
    }

    /// Number of groups or sets so far.
    pub fn group_count(&self) -> usize {
        self.labels.len()
    }

    pub fn worker(&self) -> GroupWorker {
        self.empty.clone()
    }

    /// Adds the sums that a worker hands over with a block. Call it in the order of the blocks.
    ///
    /// # Errors
    /// [`FitError::NotExact`] if rows cannot be summed exactly with earlier ones; [`FitError::TooManyGroups`].
    pub fn add(&mut self, block: BlockGroups) -> Result<(), FitError> {
        for label in block.labels {
            let Entry::Vacant(new) = self.sums.entry(SummedRows::Group(label.clone())) else {
                continue;
            };
            if self.labels.len() == MAX_GROUPS {
                return Err(FitError::TooManyGroups { limit: MAX_GROUPS });
            }
            new.insert(None);
            self.labels.push(label);
        }
        self.assigned.extend(block.assigned);
        block.settled.into_iter().try_for_each(|(rows, moments)| self.add_sums(rows, moments))
    }

    /// Returns the sums over all rows of all `workers`.
    ///
    /// # Errors
    /// [`FitError::NotExact`] if they cannot be exact.
    pub fn finish(
        mut self,
        workers: impl IntoIterator<Item = GroupWorker>,
    ) -> Result<SumsByGroup, FitError> {
        for worker in workers {
            for sums in worker.finish() {
                let (rows, moments) = sums?;
                self.add_sums(rows, moments)?;
            }
        }
        let mut sums_of = |summed: SummedRows| self.sums.remove(&summed).flatten();
        let with_label = |label: Arc<str>| {
            let name = label.to_string();
            Some((name, sums_of(SummedRows::Group(label))?))
        };
        let groups = self.labels.into_iter().filter_map(with_label).collect();
        let random =
            (0..self.empty.random.held_out).map(SummedRows::Fold).filter_map(sums_of).collect();
        let mut grouped = SumsByGroup::new(groups, random)?;
        if self.empty.apart == Apart::Sets {
            grouped.group_count = self.assigned.len();
        }
        Ok(grouped)
    }

    fn add_sums(&mut self, rows: SummedRows, moments: ExactSums) -> Result<(), FitError> {
        Ok(moments.add_to(self.sums.entry(rows).or_default())?)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum GroupKind {
    File,
    /// The rows with one label in the group column of the logs.
    Column,
}

impl GroupKind {
    pub const ALL: [Self; 2] = [Self::File, Self::Column];

    pub fn name(self) -> &'static str {
        match self {
            Self::File => "file",
            Self::Column => "column",
        }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct SumsByGroup {
    /// Sums of each group, in the order of first rows.
    pub groups: Vec<(String, ExactSums)>,
    /// Number of groups: more than the length of `groups` if sets of groups were summed.
    pub group_count: usize,
    pub random: Vec<ExactSums>,
    total: Option<ExactSums>,
}

impl SumsByGroup {
    /// Combines the sums of `groups`, in the order of their first rows, and of the random folds.
    ///
    /// # Errors
    /// [`ExactError`] if all groups together cannot be summed exactly.
    ///
    /// # Panics
    /// If bases or numbers of channels differ.
    pub fn new(
        groups: Vec<(String, ExactSums)>,
        random: Vec<ExactSums>,
    ) -> Result<Self, ExactError> {
        let total = total(groups.iter().map(|(_, moments)| moments))?;
        Ok(Self { group_count: groups.len(), groups, random, total })
    }

    /// The sums of all rows, prepared for fits without groups.
    ///
    /// # Errors
    /// [`FitError`] if there are fewer than two groups, or features of the model were not summed.
    pub(crate) fn partitioned(&self, model: &Model) -> Result<PartitionedSums<'_>, FitError> {
        PartitionedSums::new(self.all_of_several()?, model)
    }

    /// The sums over the rows of all groups; an error with fewer than two groups.
    pub(crate) fn all_of_several(&self) -> Result<&ExactSums, FitError> {
        let found = self.groups.len();
        self.total().filter(|_| found > 1).ok_or(FitError::TooFewGroups { found })
    }

    /// The sums over the rows of a fold, given by the positions of its groups.
    ///
    /// # Panics
    /// If the fold is empty.
    pub(crate) fn of_fold(&self, fold: &[usize]) -> ExactSums {
        let moments = total(fold.iter().map(|&group| &self.groups[group].1));
        moments.expect("parts of sums that are exact").expect("a fold of one group or more")
    }

    /// The sums over the rows of all groups; `None` for zero groups.
    pub fn total(&self) -> Option<&ExactSums> {
        self.total.as_ref()
    }
}

fn total<'a>(
    parts: impl IntoIterator<Item = &'a ExactSums>,
) -> Result<Option<ExactSums>, ExactError> {
    let mut parts = parts.into_iter();
    let Some(first) = parts.next() else { return Ok(None) };
    let mut total = first.clone();
    for part in parts {
        total.merge(part)?;
    }
    Ok(Some(total))
}

/// Maximum number of groups with sums in working form; those open for the longest time are handed over.
pub(super) const MAX_OPEN: usize = 64;

/// The level at which sums are kept separately.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Apart {
    /// Each group; at most [`MAX_GROUPS`].
    #[default]
    Groups,
    /// Each of [`MAX_GROUPS`] sets. Every group belongs to one set, so folds can have any number of groups.
    Sets,
}

#[derive(Clone, Debug)]
pub struct GroupWorker {
    channels: usize,
    apart: Apart,
    random: RandomSplit,
    adder: Adder,
    sums: BTreeMap<SummedRows, Accumulator>,
    /// Entries with sums in working form, in the order in which they were opened.
    open: VecDeque<SummedRows>,
}

#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum SummedRows {
    Fold(usize),
    Group(Arc<str>),
}

/// The groups of a block, and the sums handed over with it. Later rows may still add to them.
#[derive(Debug)]
#[must_use]
pub struct BlockGroups {
    pub(super) labels: Vec<Arc<str>>,
    /// Hash of each group, if groups are assigned to sets.
    pub(super) assigned: Vec<u64>,
    pub(super) settled: Vec<(SummedRows, ExactSums)>,
}

impl GroupWorker {
    /// # Errors
    /// [`FitError::NotExact`] if rows cannot be summed exactly with earlier ones; [`FitError::TooManyGroups`].
    pub fn add(
        &mut self,
        block: &Block,
        labels: &[(String, usize)],
    ) -> Result<BlockGroups, FitError> {
        let columns: Vec<&[f64]> =
            block.readings.iter().chain(&block.wrench).map(Vec::as_slice).collect();
        let (sets, assigned) = match self.apart {
            Apart::Groups => (None, Vec::new()),
            Apart::Sets => assign_to_sets(labels),
        };
        let (labels, rows): (Vec<Arc<str>>, Vec<_>) =
            rows_by_label(sets.as_deref().unwrap_or(labels)).into_iter().unzip();
        let groups = labels.iter().cloned().map(SummedRows::Group).zip(rows);
        let folds = (0..).map(SummedRows::Fold).zip(assign(block, &self.random));
        let mut settled = Vec::new();
        for (summed, rows) in groups.chain(folds) {
            settled.extend(self.add_rows(summed, &columns, &rows)?);
        }
        Ok(BlockGroups { labels, assigned, settled })
    }

    pub(super) fn finish(
        mut self,
    ) -> impl Iterator<Item = Result<(SummedRows, ExactSums), FitError>> {
        let sums = std::mem::take(&mut self.sums);
        sums.into_iter().map(move |(rows, sums)| Ok((rows, self.adder.finish(sums)?)))
    }

    /// Adds some rows of the columns to the sums, each row once. Returns sums to hand over.
    fn add_rows<'a>(
        &mut self,
        summed: SummedRows,
        columns: &[&'a [f64]],
        rows: &[usize],
    ) -> Result<Option<(SummedRows, ExactSums)>, FitError> {
        let of_rows = |column: &&'a [f64]| match column.len() == rows.len() {
            true => Cow::Borrowed(*column),
            false => rows.iter().map(|&row| column[row]).collect(),
        };
        let columns: Vec<Cow<'a, [f64]>> = columns.iter().map(of_rows).collect();
        if self.sums.len() == MAX_GROUPS + self.random.held_out && !self.sums.contains_key(&summed)
        {
            return Err(FitError::TooManyGroups { limit: MAX_GROUPS });
        }
        let sums = self.sums.entry(summed.clone()).or_insert_with(|| self.adder.begin());
        let was_open = sums.is_open();
        let (readings, wrench) = columns.split_at(self.channels);
        self.adder.add(sums, readings, wrench)?;
        if sums.is_open() && !was_open {
            self.open.push_back(summed);
        }
        if self.open.len() <= MAX_OPEN {
            return Ok(None);
        }
        let Some(longest) = self.open.pop_front() else { return Ok(None) };
        let sums = self.sums.get_mut(&longest).expect("sums that are open");
        Ok(sums.settle()?.map(|moments| (longest, moments)))
    }

    #[cfg(test)]
    pub(super) fn open_sums(&self) -> usize {
        self.sums.values().filter(|sums| sums.is_open()).count()
    }
}

/// Replaces group labels with set labels; a label always gets the same set. Also returns the hashes of the groups.
fn assign_to_sets(runs: &[(String, usize)]) -> (Option<LabelRuns>, Vec<u64>) {
    let assign = |(label, rows): &(String, usize)| {
        // FNV-1a with a final mix, because its high bits are poor for short labels.
        let fnv = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x100_0000_01b3);
        let hash = mix(label.as_bytes().iter().fold(0xcbf2_9ce4_8422_2325, fnv));
        ((format!("set {}", hash % MAX_GROUPS as u64 + 1), *rows), hash)
    };
    let (sets, mut hashes): (_, Vec<u64>) = runs.iter().map(assign).unzip();
    hashes.sort_unstable();
    hashes.dedup();
    (Some(sets), hashes)
}

/// The rows of every label, with labels in the order of their first rows.
fn rows_by_label(runs: &[(String, usize)]) -> Vec<(Arc<str>, Vec<usize>)> {
    let mut index: HashMap<&str, usize> = HashMap::new();
    let mut labels: Vec<(Arc<str>, Vec<usize>)> = Vec::new();
    let mut start = 0;
    for (label, rows) in runs {
        let at = *index.entry(label).or_insert(labels.len());
        if at == labels.len() {
            labels.push((label.as_str().into(), Vec::new()));
        }
        labels[at].1.extend(start..start + rows);
        start += rows;
    }
    labels
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exact::Accumulator;
    use shell_data::block::Block;

    /// `rows` rows of two channels from `start` on; consecutive rows belong to different groups.
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
    fn more_groups_than_stay_open_have_the_sums_of_separate_groups_for_any_workers() {
        // 420 rows per group, more than a full block, so that every group is open at some time.
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
    fn more_groups_than_the_limit_are_merged_into_sets_and_counted() {
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
        let too_many = FitError::TooManyGroups { limit: MAX_GROUPS };
        assert_eq!(sum(Apart::Groups, ROWS).unwrap_err(), too_many);
        let found = sum(Apart::Sets, ROWS).unwrap();
        assert_eq!(found.group_count, GROUPS);
        // Poisson distribution of mean 3: a fraction e⁻³ of 2000 sets, some 100, stay empty.
        assert!((1850..1950).contains(&found.groups.len()), "{}", found.groups.len());
        // Both rows of a group are in one set, so every number of rows is even.
        assert!(found.groups.iter().all(|(_, moments)| moments.rows() % 2 == 0));
        assert_eq!(found.total().unwrap().rows(), ROWS as u64);
        assert_eq!(sum(Apart::Sets, 777).unwrap(), found);
    }

    #[test]
    fn runs_of_one_label_are_put_together_in_the_order_of_first_rows() {
        let runs = [("b", 2), ("a", 1), ("b", 3), ("a", 4)].map(|(l, rows)| (l.to_owned(), rows));
        assert_eq!(
            rows_by_label(&runs),
            [("b".into(), vec![0, 1, 3, 4, 5]), ("a".into(), vec![2, 6, 7, 8, 9])]
        );
    }

    #[test]
    fn rows_are_dealt_evenly_each_once_and_by_the_seed() {
        let column: Vec<f64> = (0..10_000).map(f64::from).collect();
        let split = RandomSplit { folds: 10, held_out: 10, seed: 7 };
        let assign = |column: &[f64], split: RandomSplit| {
            let readings = vec![column.to_vec()];
            super::assign(&Block { rows: column.len(), readings, ..Block::default() }, &split)
        };
        let assigned = assign(&column, split);
        let mut all: Vec<usize> = assigned.iter().flatten().copied().collect();
        all.sort_unstable();
        assert_eq!(all, (0..10_000).collect::<Vec<_>>());
        // Binomial distribution: mean 1000, standard deviation 30; the limit is five standard deviations.
        assert!(assigned.iter().all(|rows| rows.len().abs_diff(1000) < 150));
        assert_ne!(assign(&column, RandomSplit { seed: 8, ..split }), assigned);
        // The rows are the same for any division into blocks.
        let [first, second] = [&column[..4321], &column[4321..]];
        let parts = assign(first, split).into_iter().zip(assign(second, split));
        let parts: Vec<Vec<usize>> = parts
            .map(|(a, b)| a.into_iter().chain(b.iter().map(|row| row + 4321)).collect())
            .collect();
        assert_eq!(parts, assigned);
        let some = assign(&column, RandomSplit { held_out: 3, ..split });
        assert_eq!(some, assigned[..3]);
    }
}
