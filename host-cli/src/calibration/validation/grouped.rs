//! Sums of rows, group by group, in one pass.
//!
//! Beside the groups, rows are dealt at random into as many folds as are asked for, for the naive
//! figure. All sums are exact, so those of the groups add up to those of all rows, bit for bit, and
//! so do those of the random folds.
//!
//! Since sums are exact, they do not depend on the order of the rows either: a block is added to
//! whatever sums of its group no other thread is adding to.
//!
//! Memory: a group costs about 16 bytes for each distinct sum and some 50 for each sum with a wrench
//! (under 150 kB for eight channels and poly3, 20 kB for the cubic model), and no more than
//! `MOST_OPEN` have working sums besides. There may be [`MOST_GROUPS`] groups.

use std::collections::{HashMap, VecDeque};
use std::sync::{Mutex, MutexGuard, PoisonError};

use super::ValidationError;
use crate::block::Block;
use crate::calibration::exact::{Accumulator, Adder, Moments};
use crate::calibration::model::Basis;

/// The largest number of groups.
pub const MOST_GROUPS: usize = 2000;

/// Sums in working form that may wait to be added to; when there are more, those that have waited
/// longest are put away.
const MOST_OPEN: usize = 64;

/// How rows are dealt at random, for the naive figure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RandomSplit {
    /// Folds that all rows are dealt into.
    pub folds: usize,
    /// Those of them that are summed, to be held out. Two of ten tell an error to a hundredth
    /// from some thousand rows, at a fifth of the work.
    pub held_out: usize,
    /// Which way the rows are dealt.
    pub seed: u64,
}

/// Sums under way, which any thread may add to.
#[derive(Debug)]
pub struct GroupSums {
    channels: usize,
    random: RandomSplit,
    adder: Adder,
    sets: Mutex<Sets>,
}

/// The groups of a block, in the order of their first rows.
#[derive(Debug)]
#[must_use]
pub struct BlockGroups(Vec<usize>);

/// The sets of rows that are summed: random folds, then groups as they turn up.
#[derive(Debug)]
struct Sets {
    by_label: HashMap<String, usize>,
    /// The groups in the order of their first rows, as far as that is known.
    order: Vec<usize>,
    /// What has been put away of each set.
    closed: Vec<Option<Moments>>,
    /// Sums of some set that no thread is adding to, the latest at the end.
    idle: VecDeque<(usize, Accumulator)>,
}

/// Sums over all rows, apart by group.
#[derive(Clone, Debug, PartialEq)]
pub struct GroupedMoments {
    /// Label and sums of each group, in the order of their first rows.
    pub groups: Vec<(String, Moments)>,
    /// The sums of rows that were drawn at random from the same ones.
    pub random: Vec<Moments>,
    total: Option<Moments>,
}

impl GroupSums {
    /// Of no rows: for `basis` and the bases within it, by group and as `random` says.
    pub fn new(basis: Basis, channels: usize, random: RandomSplit) -> Self {
        let sets = Sets {
            by_label: HashMap::new(),
            order: Vec::new(),
            closed: vec![None; random.held_out],
            idle: VecDeque::new(),
        };
        Self { channels, random, adder: Adder::new(basis, channels), sets: Mutex::new(sets) }
    }

    /// Adds the rows of a block, by its group labels, or all under `label`. What it returns is to be
    /// handed to [`Self::note`].
    ///
    /// # Errors
    /// [`ValidationError::NotExact`] if they cannot be summed exactly with those before;
    /// [`ValidationError::TooManyGroups`].
    pub fn add(&self, block: &Block, label: Option<&str>) -> Result<BlockGroups, ValidationError> {
        let columns: Vec<&[f64]> =
            block.readings.iter().chain(&block.wrench).map(Vec::as_slice).collect();
        let labels = match label {
            Some(label) => vec![(label, (0..block.rows).collect())],
            None => by_label(&block.groups),
        };
        let mut groups = Vec::with_capacity(labels.len());
        for (label, rows) in labels {
            let set = self.sets().of_group(label)?;
            self.add_rows(set, &columns, &rows)?;
            groups.push(set);
        }
        for (fold, rows) in deal(&columns, block.rows, &self.random).iter().enumerate() {
            self.add_rows(fold, &columns, rows)?;
        }
        Ok(BlockGroups(groups))
    }

    /// Takes note of the groups of a block, after those of all blocks before it.
    pub fn note(&self, BlockGroups(groups): BlockGroups) {
        let order = &mut self.sets().order;
        for set in groups {
            if !order.contains(&set) {
                order.push(set);
            }
        }
    }

    /// The sums over all rows.
    ///
    /// # Errors
    /// [`ValidationError::NotExact`] if they cannot be exact.
    pub fn finish(self) -> Result<GroupedMoments, ValidationError> {
        let Sets { by_label, order, mut closed, idle } =
            self.sets.into_inner().unwrap_or_else(PoisonError::into_inner);
        let mut open: Vec<Option<Accumulator>> = closed.iter().map(|_| None).collect();
        for (set, sums) in idle {
            match &mut open[set] {
                Some(open) => self.adder.merge(open, sums)?,
                open => *open = Some(sums),
            }
        }
        for (closed, open) in closed.iter_mut().zip(open) {
            if let Some(open) = open {
                add(closed, self.adder.finish(open)?)?;
            }
        }
        let mut labels: HashMap<usize, String> =
            by_label.into_iter().map(|(label, set)| (set, label)).collect();
        let mut of_group = |set| Some((labels.remove(&set)?, closed.get_mut(set)?.take()?));
        let groups: Vec<_> = order.into_iter().filter_map(&mut of_group).collect();
        closed.truncate(self.random.held_out);
        let total = total(groups.iter().map(|(_, moments)| moments))?;
        Ok(GroupedMoments { groups, random: closed.into_iter().flatten().collect(), total })
    }

    /// Adds some rows of the columns to the sums of a set.
    fn add_rows(
        &self,
        set: usize,
        columns: &[&[f64]],
        rows: &[usize],
    ) -> Result<(), ValidationError> {
        let gather = |column: &&[f64]| rows.iter().map(|&row| column[row]).collect();
        let gathered: Vec<Vec<f64>> = columns.iter().map(gather).collect();
        let idle = self.sets().take(set);
        let mut sums = idle.unwrap_or_else(|| self.adder.begin());
        let (readings, wrench) = gathered.split_at(self.channels);
        self.adder.add(&mut sums, readings, wrench)?;
        let Some((set, oldest)) = self.sets().give_back(set, sums) else { return Ok(()) };
        let oldest = self.adder.finish(oldest)?;
        add(&mut self.sets().closed[set], oldest)
    }

    fn sets(&self) -> MutexGuard<'_, Sets> {
        // A poisoned lock means that a thread has panicked, and the panic will be passed on.
        self.sets.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Sets {
    /// The set of the rows with this label.
    fn of_group(&mut self, label: &str) -> Result<usize, ValidationError> {
        if let Some(&set) = self.by_label.get(label) {
            return Ok(set);
        }
        if self.by_label.len() == MOST_GROUPS {
            return Err(ValidationError::TooManyGroups { limit: MOST_GROUPS });
        }
        let set = self.closed.len();
        self.by_label.insert(label.to_owned(), set);
        self.closed.push(None);
        Ok(set)
    }

    fn take(&mut self, set: usize) -> Option<Accumulator> {
        let place = self.idle.iter().rposition(|&(of, _)| of == set)?;
        self.idle.remove(place).map(|(_, sums)| sums)
    }

    /// Has sums wait; if too many do, the one that has waited longest is to be put away.
    fn give_back(&mut self, set: usize, sums: Accumulator) -> Option<(usize, Accumulator)> {
        self.idle.push_back((set, sums));
        (self.idle.len() > MOST_OPEN).then(|| self.idle.pop_front())?
    }
}

fn add(closed: &mut Option<Moments>, sums: Moments) -> Result<(), ValidationError> {
    match closed {
        Some(closed) => closed.merge(&sums)?,
        closed => *closed = Some(sums),
    }
    Ok(())
}

impl GroupedMoments {
    /// The sums over the rows of all groups; `None` of no groups.
    pub fn total(&self) -> Option<&Moments> {
        self.total.as_ref()
    }
}

/// The sums of all `parts`.
pub(super) fn total<'a>(
    parts: impl IntoIterator<Item = &'a Moments>,
) -> Result<Option<Moments>, ValidationError> {
    let mut parts = parts.into_iter();
    let Some(first) = parts.next() else { return Ok(None) };
    let mut total = first.clone();
    for part in parts {
        total.merge(part)?;
    }
    Ok(Some(total))
}

/// The rows of every label, labels in the order of their first rows.
fn by_label(runs: &[(String, usize)]) -> Vec<(&str, Vec<usize>)> {
    let mut index: HashMap<&str, usize> = HashMap::new();
    let mut labels: Vec<(&str, Vec<usize>)> = Vec::new();
    let mut start = 0;
    for (label, rows) in runs {
        let at = *index.entry(label).or_insert(labels.len());
        if at == labels.len() {
            labels.push((label, Vec::new()));
        }
        labels[at].1.extend(start..start + rows);
        start += rows;
    }
    labels
}

/// The rows of the folds that are held out, at random but the same for the same block and seed.
fn deal(columns: &[&[f64]], rows: usize, split: &RandomSplit) -> Vec<Vec<usize>> {
    let mut dealt = vec![Vec::new(); split.held_out];
    if split.held_out == 0 {
        return dealt;
    }
    // A block does not know its place in the log; its first row tells it from others.
    let first = columns.iter().filter_map(|column| column.first());
    let key = first.fold(split.seed, |key, value| mix(key ^ value.to_bits()));
    for row in 0..rows {
        let random = mix(key.wrapping_add(row as u64));
        let fold = ((u128::from(random) * split.folds as u128) >> 64) as usize;
        dealt.get_mut(fold).into_iter().for_each(|fold| fold.push(row));
    }
    dealt
}

/// The finaliser of SplitMix64 (Steele, Lea and Flood, OOPSLA 2014), after its increment.
fn mix(state: u64) -> u64 {
    let z = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_of_one_label_are_put_together_in_the_order_of_first_rows() {
        let runs = [("b", 2), ("a", 1), ("b", 3), ("a", 4)].map(|(l, rows)| (l.to_owned(), rows));
        assert_eq!(by_label(&runs), [("b", vec![0, 1, 3, 4, 5]), ("a", vec![2, 6, 7, 8, 9])]);
    }

    #[test]
    fn rows_are_dealt_evenly_each_once_and_by_the_seed() {
        let column: Vec<f64> = (0..10_000).map(f64::from).collect();
        let split = RandomSplit { folds: 10, held_out: 10, seed: 7 };
        let dealt = deal(&[&column], 10_000, &split);
        let mut all: Vec<usize> = dealt.iter().flatten().copied().collect();
        all.sort_unstable();
        assert_eq!(all, (0..10_000).collect::<Vec<_>>());
        // Binomial: mean 1000, standard deviation 30; five of those.
        assert!(dealt.iter().all(|rows| rows.len().abs_diff(1000) < 150));
        assert_ne!(deal(&[&column], 10_000, &RandomSplit { seed: 8, ..split }), dealt);
        let some = deal(&[&column], 10_000, &RandomSplit { held_out: 3, ..split });
        assert_eq!(some, dealt[..3]);
    }
}
