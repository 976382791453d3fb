//! The groups of a partial fit. The last bits of results depend on the order of the groups, so each
//! group records the position of its first row. In any order of merging, groups are sorted as
//! one fit over all files, sorted by name, would have them.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use calibration::exact::ExactSums;
use calibration::factored::FactoredGroups;
use calibration::sums::GroupedSums;
use calibration::validation::grouped::{GroupKind, MAX_GROUPS, RandomSplit, SumsByGroup};
use serde::{Deserialize, Serialize};

use super::{MergeError, PartialFit, SourceFile, Sums, expect};

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PartialGroups {
    pub by: GroupKind,
    /// The assignment of rows to random folds; the errors on held-out groups are compared with the
    /// errors on these folds.
    #[serde(flatten)]
    pub split: RandomSplit,
    /// The sums of the held-out random folds; empty if rows are not summed exactly.
    pub random: Vec<ExactSums>,
    #[serde(rename = "sums")]
    pub groups: Vec<PartialGroup>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PartialGroup {
    pub label: String,
    pub source: usize,
    /// The number of groups that begin before it in that source.
    #[serde(rename = "place")]
    pub position: usize,
    #[serde(flatten)]
    pub sums: Sums,
}

impl PartialGroups {
    /// Makes groups from `sums`, assigned to random folds by `split`; `first_in` has, for each
    /// group, the index of the source with its first row.
    pub fn exact(by: GroupKind, split: RandomSplit, sums: SumsByGroup, first_in: &[usize]) -> Self {
        let SumsByGroup { groups, random, .. } = sums;
        let groups = groups.into_iter().map(|(label, moments)| (label, Sums::Exact(moments)));
        Self { split, random, ..Self::new(by, groups, first_in) }
    }

    /// Creates groups that cannot be summed exactly. They have no random folds: the R factor
    /// would have to be recomputed for each.
    pub fn factored(by: GroupKind, groups: FactoredGroups, first_in: &[usize]) -> Self {
        let groups = groups.groups.into_iter();
        Self::new(by, groups.map(|(label, rows)| (label, Sums::Factored(rows))), first_in)
    }

    fn new(by: GroupKind, sums: impl Iterator<Item = (String, Sums)>, first_in: &[usize]) -> Self {
        let (mut last, mut position) = (None, 0);
        let group = |((label, sums), &source): ((String, Sums), &usize)| {
            position = if last == Some(source) { position + 1 } else { 0 };
            last = Some(source);
            PartialGroup { label, source, position, sums }
        };
        let groups = sums.zip(first_in).map(group).collect();
        Self { by, split: RandomSplit::default(), groups, random: Vec::new() }
    }

    pub(super) fn check(&self, other: &Self) -> Result<(), MergeError> {
        expect(self.by.name(), other.by.name(), MergeError::GroupsAre)?;
        if self.split != other.split {
            return Err(MergeError::Split(self.split.seed, other.split.seed));
        }
        let known: HashSet<&str> = self.groups.iter().map(|group| group.label.as_str()).collect();
        let shared = |group: &&PartialGroup| known.contains(group.label.as_str());
        let shared_count = other.groups.iter().filter(shared).count();
        if self.groups.len() + other.groups.len() - shared_count > MAX_GROUPS {
            return Err(MergeError::TooManyGroups);
        }
        match (self.by, other.groups.iter().find(shared)) {
            (GroupKind::File, Some(group)) => Err(MergeError::SameName(group.label.clone())),
            _ => Ok(()),
        }
    }

    /// Adds groups. `sources` are the merged sources, those of `self` (`own` of them) first.
    pub(super) fn add(
        &mut self,
        other: &Self,
        sources: &[SourceFile],
        own: usize,
    ) -> Result<(), MergeError> {
        let positions: HashMap<String, usize> =
            self.groups.iter().enumerate().map(|(i, group)| (group.label.clone(), i)).collect();
        let begins = |source: usize, position: usize| (rank(&sources[source]), position);
        for group in &other.groups {
            let source = group.source + own;
            let Some(&known) = positions.get(&group.label) else {
                self.groups.push(PartialGroup { source, ..group.clone() });
                continue;
            };
            let known = &mut self.groups[known];
            expect(known.sums.kind(), group.sums.kind(), MergeError::Kind)?;
            known.sums.merge(&group.sums)?;
            if begins(source, group.position) < begins(known.source, known.position) {
                (known.source, known.position) = (source, group.position);
            }
        }
        for (i, fold) in other.random.iter().enumerate() {
            match self.random.get_mut(i) {
                Some(sums) => sums.merge(fold)?,
                None => self.random.push(fold.clone()),
            }
        }
        Ok(())
    }
}

fn rank(source: &SourceFile) -> (&Path, Option<&str>) {
    (&source.path, source.checksum.as_deref())
}

impl PartialFit {
    /// The sums by group, with the random folds if there are `random_folds` of them.
    ///
    /// # Errors
    /// [`MergeError::NotExact`] if all groups together cannot be summed exactly.
    pub fn grouped_sums(
        &self,
        random_folds: Option<usize>,
    ) -> Result<Option<(GroupKind, GroupedSums)>, MergeError> {
        let Some(PartialGroups { by, split, random, groups }) = &self.groups else {
            return Ok(None);
        };
        let (mut exact, mut factored) = (Vec::new(), Vec::new());
        for PartialGroup { label, sums, .. } in groups {
            match sums {
                Sums::Exact(sums) => exact.push((label.clone(), sums.clone())),
                Sums::Factored(rows) => factored.push((label.clone(), rows.clone())),
            }
        }
        let sums = match &self.sums {
            Sums::Exact(_) => {
                let is_dealt = random_folds == Some(split.folds);
                let random = if is_dealt { random.clone() } else { Vec::new() };
                let sums = SumsByGroup::new(exact, random).map_err(MergeError::NotExact)?;
                GroupedSums::Exact(Box::new(sums))
            }
            Sums::Factored(_) => GroupedSums::Factored(FactoredGroups { groups: factored }),
        };
        Ok(Some((*by, sums)))
    }

    /// Sorts sources by name, and groups by their first rows. Without groups no result depends on
    /// the order, and sources stay in the order of merging.
    pub fn put_in_order(&mut self) {
        let Some(groups) = &mut self.groups else { return };
        let mut sources: Vec<(usize, SourceFile)> = self.sources.drain(..).enumerate().collect();
        sources.sort_by(|(_, a), (_, b)| rank(a).cmp(&rank(b)));
        let mut now_at = vec![0; sources.len()];
        for (now, (before, source)) in sources.into_iter().enumerate() {
            now_at[before] = now;
            self.sources.push(source);
        }
        groups.groups.iter_mut().for_each(|group| group.source = now_at[group.source]);
        groups.groups.sort_unstable_by_key(|group| (group.source, group.position));
        // Groups that turned out to begin in an earlier source have left gaps in the positions of
        // the source they were in.
        let (mut last, mut next) = (None, 0);
        for group in &mut groups.groups {
            next = if last == Some(group.source) { next + 1 } else { 0 };
            (last, group.position) = (Some(group.source), next);
        }
    }
}
