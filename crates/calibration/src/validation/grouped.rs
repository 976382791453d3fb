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
//! (under 150 kB for eight channels and poly3, 20 kB for the cubic model), on each thread that has
//! met it up to 256 rows that wait to be summed together, and no more than `MOST_OPEN` have working
//! sums besides. There may be [`MOST_GROUPS`] groups.

use std::collections::{HashMap, VecDeque};
use std::sync::{Mutex, MutexGuard, PoisonError};

use super::ValidationError;
use crate::exact::{Accumulator, Adder, Moments};
use crate::model::Basis;
use shell_data::block::Block;

/// The largest number of groups.
pub const MOST_GROUPS: usize = 2000;

/// Sums in working form; when there are more, those that have been for longest are put away.
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
    sets: Vec<Set>,
    /// The sets that have sums in working form, once for each, in the order of these.
    open: VecDeque<usize>,
}

#[derive(Debug, Default)]
struct Set {
    /// Sums that no thread is adding to.
    idle: Vec<Accumulator>,
    /// What has been put away.
    closed: Option<Moments>,
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
            sets: (0..random.held_out).map(|_| Set::default()).collect(),
            open: VecDeque::new(),
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
        let Sets { by_label, order, sets, .. } =
            self.sets.into_inner().unwrap_or_else(PoisonError::into_inner);
        let mut sums = Vec::with_capacity(sets.len());
        for Set { idle, mut closed } in sets {
            let mut idle = idle.into_iter();
            if let Some(mut all) = idle.next() {
                idle.try_for_each(|sums| self.adder.merge(&mut all, sums))?;
                self.adder.finish(all)?.add_to(&mut closed)?;
            }
            sums.push(closed);
        }
        let mut labels: HashMap<usize, String> =
            by_label.into_iter().map(|(label, set)| (set, label)).collect();
        let mut of_group = |set| Some((labels.remove(&set)?, sums.get_mut(set)?.take()?));
        let groups: Vec<_> = order.into_iter().filter_map(&mut of_group).collect();
        sums.truncate(self.random.held_out);
        let total = total(groups.iter().map(|(_, moments)| moments))?;
        Ok(GroupedMoments { groups, random: sums.into_iter().flatten().collect(), total })
    }

    /// Adds some rows of the columns to the sums of a set, each row once.
    fn add_rows(
        &self,
        set: usize,
        columns: &[&[f64]],
        rows: &[usize],
    ) -> Result<(), ValidationError> {
        if columns.iter().all(|column| column.len() == rows.len()) {
            return self.add_columns(set, columns);
        }
        let gather = |column: &&[f64]| rows.iter().map(|&row| column[row]).collect();
        let gathered: Vec<Vec<f64>> = columns.iter().map(gather).collect();
        self.add_columns(set, &gathered)
    }

    /// Adds all rows of the columns to the sums of a set.
    fn add_columns<C: AsRef<[f64]>>(
        &self,
        set: usize,
        columns: &[C],
    ) -> Result<(), ValidationError> {
        let idle = self.sets().sets[set].idle.pop();
        let mut sums = idle.unwrap_or_else(|| self.adder.begin());
        let was_open = sums.is_open();
        let (readings, wrench) = columns.split_at(self.channels);
        self.adder.add(&mut sums, readings, wrench)?;
        let overdue = {
            let mut sets = self.sets();
            if sums.is_open() && !was_open {
                sets.open.push_back(set);
            }
            sets.sets[set].idle.push(sums);
            sets.overdue()
        };
        if let Some((set, mut sums)) = overdue {
            let settled = sums.settle()?;
            let set = &mut self.sets().sets[set];
            set.idle.push(sums);
            if let Some(settled) = settled {
                settled.add_to(&mut set.closed)?;
            }
        }
        Ok(())
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
        let set = self.sets.len();
        self.by_label.insert(label.to_owned(), set);
        self.sets.push(Set::default());
        Ok(set)
    }

    /// Sums that are to be put away, and their set, where too many are in working form.
    fn overdue(&mut self) -> Option<(usize, Accumulator)> {
        if self.open.len() <= MOST_OPEN {
            return None;
        }
        let set = self.open.pop_front()?;
        let idle = &mut self.sets[set].idle;
        match idle.iter().position(Accumulator::is_open) {
            Some(place) => Some((set, idle.swap_remove(place))),
            None => {
                // Another thread is adding to them.
                self.open.push_back(set);
                None
            }
        }
    }
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
    fn more_groups_than_stay_open_are_summed_as_each_alone_on_any_thread() {
        // 420 rows of each group: a full block and more, so that all are open at some time.
        const GROUPS: usize = 2 * MOST_OPEN + 2;
        const ROWS: usize = 420 * GROUPS;
        let whole = interleaved(0, ROWS, GROUPS);
        let sums = GroupSums::new(Basis::Quadratic, 2, RandomSplit::default());
        let starts: Vec<usize> = (0..ROWS).step_by(3000).collect();
        let add = |start: &usize| {
            sums.add(&interleaved(*start, 3000.min(ROWS - start), GROUPS), None).unwrap()
        };
        let halves = std::thread::scope(|scope| {
            let (even, odd): (Vec<_>, Vec<_>) =
                starts.iter().partition(|start| **start % 2000 == 0);
            let halves = [even, odd].map(|half| {
                scope
                    .spawn(|| half.into_iter().map(|start| (start, add(start))).collect::<Vec<_>>())
            });
            halves.map(|half| half.join().unwrap())
        });
        let mut blocks: Vec<_> = halves.into_iter().flatten().collect();
        blocks.sort_by_key(|(start, _)| *start);
        blocks.into_iter().for_each(|(_, groups)| sums.note(groups));
        assert!(sums.sets().open.len() <= MOST_OPEN + 2, "one more for each thread");
        let found = sums.finish().unwrap();
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
