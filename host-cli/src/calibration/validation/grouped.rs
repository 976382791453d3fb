//! Sums of rows, group by group, in one pass.
//!
//! Beside the groups, rows are dealt at random into as many folds as are asked for, for the naive
//! figure. All sums are exact, so those of the groups add up to those of all rows, bit for bit, and
//! so do those of the random folds.
//!
//! Memory: a group costs about 16 bytes for each distinct sum and some 50 for each sum with a wrench
//! (under 150 kB for eight channels and poly3, 20 kB for the cubic model), and no more than
//! `MOST_OPEN` groups have working sums besides. There may be [`MOST_GROUPS`] groups.

use std::collections::HashMap;

use super::ValidationError;
use crate::block::Block;
use crate::calibration::exact::{Accumulator, Adder, Moments};
use crate::calibration::model::Basis;

/// The largest number of groups.
pub const MOST_GROUPS: usize = 2000;

/// Groups whose sums are still in working form; when there are more, all are put away.
const MOST_OPEN: usize = 64;

/// How rows are summed.
#[derive(Debug)]
pub struct Grouping {
    basis: Basis,
    channels: usize,
    random: RandomSplit,
    adder: Adder,
}

/// How rows are dealt at random, for the naive figure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RandomSplit {
    /// Folds that all rows are dealt into.
    pub folds: usize,
    /// Those of them that are summed, to be held out. Three of ten tell an error to a hundredth
    /// from some thousand rows, at less than a third of the work.
    pub held_out: usize,
    /// Which way the rows are dealt.
    pub seed: u64,
}

/// Sums over the rows of a block.
#[derive(Debug)]
pub struct BlockSums {
    groups: Vec<(String, Accumulator)>,
    random: Vec<Accumulator>,
}

/// Sums under way, over many blocks.
#[derive(Debug)]
pub struct GroupSums {
    index: HashMap<String, usize>,
    groups: Vec<Group>,
    random: Vec<Accumulator>,
    open: usize,
}

#[derive(Debug)]
struct Group {
    label: String,
    moments: Option<Moments>,
    open: Option<Accumulator>,
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

impl Grouping {
    /// Sums for `basis` and the bases within it, by group and as `random` says.
    pub fn new(basis: Basis, channels: usize, random: RandomSplit) -> Self {
        Self { basis, channels, random, adder: Adder::new(basis, channels) }
    }

    /// Of no rows.
    pub fn empty(&self) -> GroupSums {
        let random = (0..self.random.held_out).map(|_| Accumulator::new(self.basis, self.channels));
        GroupSums { index: HashMap::new(), groups: Vec::new(), random: random.collect(), open: 0 }
    }

    /// Sums the rows of a block, by its group labels, or all under `label`.
    ///
    /// # Errors
    /// [`ValidationError::NotExact`] if they cannot be summed exactly.
    pub fn reduce(&self, block: &Block, label: Option<&str>) -> Result<BlockSums, ValidationError> {
        let columns: Vec<&[f64]> =
            block.readings.iter().chain(&block.wrench).map(Vec::as_slice).collect();
        let groups = match label {
            Some(label) => vec![(label.to_owned(), self.sum(&columns)?)],
            None => by_label(&block.groups)
                .into_iter()
                .map(|(label, rows)| Ok((label.to_owned(), self.sum_rows(&columns, &rows)?)))
                .collect::<Result<_, ValidationError>>()?,
        };
        let random = deal(&columns, block.rows, &self.random);
        let random = random.iter().map(|rows| self.sum_rows(&columns, std::slice::from_ref(rows)));
        Ok(BlockSums { groups, random: random.collect::<Result<_, _>>()? })
    }

    /// Sums `rows`: runs of them, or lists.
    fn sum_rows<R: Rows>(
        &self,
        columns: &[&[f64]],
        rows: &[R],
    ) -> Result<Accumulator, ValidationError> {
        let gathered: Vec<Vec<f64>> = columns
            .iter()
            .map(|column| {
                let mut gathered = Vec::new();
                rows.iter().for_each(|rows| rows.gather(column, &mut gathered));
                gathered
            })
            .collect();
        self.sum(&gathered)
    }

    fn sum<C: AsRef<[f64]>>(&self, columns: &[C]) -> Result<Accumulator, ValidationError> {
        let (readings, wrench) = columns.split_at(self.channels);
        Ok(self.adder.sum(readings, wrench)?)
    }
}

impl GroupSums {
    /// Adds the rows of a block.
    ///
    /// # Errors
    /// [`ValidationError::NotExact`] if they cannot be summed exactly with those before;
    /// [`ValidationError::TooManyGroups`].
    pub fn merge(&mut self, block: BlockSums) -> Result<(), ValidationError> {
        for (label, sums) in block.groups {
            let at = match self.index.get(&label) {
                Some(&at) => at,
                None => {
                    let at = self.groups.len();
                    if at == MOST_GROUPS {
                        return Err(ValidationError::TooManyGroups { limit: MOST_GROUPS });
                    }
                    self.index.insert(label.clone(), at);
                    self.groups.push(Group { label, moments: None, open: None });
                    at
                }
            };
            match &mut self.groups[at].open {
                Some(open) => open.merge(sums)?,
                open => {
                    *open = Some(sums);
                    self.open += 1;
                }
            }
            if self.open > MOST_OPEN {
                self.groups.iter_mut().try_for_each(Group::put_away)?;
                self.open = 0;
            }
        }
        for (own, other) in self.random.iter_mut().zip(block.random) {
            own.merge(other)?;
        }
        Ok(())
    }

    /// The sums over all rows.
    ///
    /// # Errors
    /// [`ValidationError::NotExact`] if they cannot be exact.
    pub fn finish(mut self) -> Result<GroupedMoments, ValidationError> {
        self.groups.iter_mut().try_for_each(Group::put_away)?;
        let moments = |group: Group| Some((group.label, group.moments?));
        let random = self.random.into_iter().map(Accumulator::finish);
        let groups: Vec<_> = self.groups.into_iter().filter_map(moments).collect();
        let total = total(groups.iter().map(|(_, moments)| moments))?;
        Ok(GroupedMoments { groups, random: random.collect::<Result<_, _>>()?, total })
    }
}

impl Group {
    fn put_away(&mut self) -> Result<(), ValidationError> {
        let Some(open) = self.open.take() else { return Ok(()) };
        let sums = open.finish()?;
        match &mut self.moments {
            Some(moments) => moments.merge(&sums)?,
            None => self.moments = Some(sums),
        }
        Ok(())
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

/// Some rows of a column.
trait Rows {
    fn gather(&self, column: &[f64], target: &mut Vec<f64>);
}

impl Rows for std::ops::Range<usize> {
    fn gather(&self, column: &[f64], target: &mut Vec<f64>) {
        target.extend_from_slice(&column[self.clone()]);
    }
}

impl Rows for Vec<usize> {
    fn gather(&self, column: &[f64], target: &mut Vec<f64>) {
        target.extend(self.iter().map(|&row| column[row]));
    }
}

/// The runs of every label, labels in the order of their first rows.
fn by_label(runs: &[(String, usize)]) -> Vec<(&str, Vec<std::ops::Range<usize>>)> {
    let mut index: HashMap<&str, usize> = HashMap::new();
    let mut labels: Vec<(&str, Vec<std::ops::Range<usize>>)> = Vec::new();
    let mut start = 0;
    for (label, rows) in runs {
        let at = *index.entry(label).or_insert(labels.len());
        if at == labels.len() {
            labels.push((label, Vec::new()));
        }
        labels[at].1.push(start..start + rows);
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
        assert_eq!(by_label(&runs), [("b", vec![0..2, 3..6]), ("a", vec![2..3, 6..10])]);
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
