//! Rows group by group.

use std::collections::HashMap;
use std::ops::Range;

use super::rows::FactoredRows;
use crate::error::FitError;
use crate::grouped_rows::{GroupedRows, Run};
use crate::model::Model;
use crate::passes::{Workers, map};
use crate::r_factor::Workspace;
use crate::scaling::Scaling;
use crate::validation::ValidationError;
use crate::validation::grouped::MAX_GROUPS;
use shell_data::block::Block;

/// What the R factors of all groups may take, in bytes.
const MEMORY: usize = 512 << 20;

/// The rows of each group, in the order of their first rows.
#[derive(Clone, Debug, PartialEq)]
pub struct FactoredGroups {
    /// Label and rows.
    pub groups: Vec<(String, FactoredRows)>,
}

/// Groups while their rows are being added. Rows of a group are factored so many at a time, whatever blocks
/// they come in: the result depends on the order of the rows and on nothing else.
#[derive(Debug)]
pub struct GroupFactors {
    empty: FactoredRows,
    workspace: Workspace,
    groups: Vec<Group>,
    positions: HashMap<String, usize>,
}

#[derive(Debug)]
struct Group {
    label: String,
    rows: FactoredRows,
    /// Rows that are not yet among them, fewer than fill the workspace.
    waiting: Block,
}

impl GroupFactors {
    /// No groups; features as in [`FactoredRows::new`].
    pub fn new(model: Model, scaling: Scaling) -> Self {
        let empty = FactoredRows::new(model, scaling);
        let workspace = empty.workspace();
        Self { empty, workspace, groups: Vec::new(), positions: HashMap::new() }
    }

    /// How many groups there are by now.
    pub fn group_count(&self) -> usize {
        self.groups.len()
    }

    /// Adds the rows of a block with their labels.
    ///
    /// # Errors
    /// [`ValidationError`] if there are too many groups, or a row that no fit can take.
    pub fn add(
        &mut self,
        block: &Block,
        labels: &[(String, usize)],
    ) -> Result<(), ValidationError> {
        let mut start = 0;
        for (label, rows) in labels {
            let position = self.position(label)?;
            let (group, end) = (&mut self.groups[position], start + rows);
            while start < end {
                let room = self.workspace.rows() - group.waiting.rows;
                let part = start..end.min(start + room);
                start = part.end;
                group.waiting.append(block, part);
                if group.waiting.rows == self.workspace.rows() {
                    group.settle(&mut self.workspace)?;
                }
            }
        }
        Ok(())
    }

    fn position(&mut self, label: &str) -> Result<usize, ValidationError> {
        if let Some(&position) = self.positions.get(label) {
            return Ok(position);
        }
        let position = self.groups.len();
        self.empty.check_group_count(position + 1)?;
        let group =
            Group { label: label.to_owned(), rows: self.empty.clone(), waiting: Block::default() };
        self.groups.push(group);
        self.positions.insert(label.to_owned(), position);
        Ok(position)
    }

    /// The groups, after all rows.
    ///
    /// # Errors
    /// [`ValidationError::Rows`] if there is a row that no fit can take.
    pub fn finish(mut self) -> Result<FactoredGroups, ValidationError> {
        for group in self.groups.iter_mut().filter(|group| group.waiting.rows > 0) {
            group.settle(&mut self.workspace)?;
        }
        let groups = self.groups.into_iter().map(|group| (group.label, group.rows)).collect();
        Ok(FactoredGroups { groups })
    }
}

impl Group {
    /// Factors the rows that wait.
    fn settle(&mut self, workspace: &mut Workspace) -> Result<(), ValidationError> {
        Ok(self.rows.absorb(&std::mem::take(&mut self.waiting), workspace)?)
    }
}

impl FactoredRows {
    /// # Errors
    /// [`ValidationError::TooManyGroups`] if so many groups of such rows take too much memory.
    fn check_group_count(&self, groups: usize) -> Result<(), ValidationError> {
        let limit = MAX_GROUPS.min(MEMORY / self.bytes());
        if groups > limit {
            return Err(ValidationError::TooManyGroups { limit });
        }
        Ok(())
    }
}

impl FactoredGroups {
    /// Groups of rows in memory, each with its label; features as in [`FactoredRows::new`].
    ///
    /// # Errors
    /// As [`GroupFactors::add`]; [`FitError::Interrupted`].
    pub(crate) fn from_rows(
        rows: &GroupedRows,
        labels: Vec<String>,
        (model, scaling): (Model, Scaling),
        workers: Workers<'_>,
    ) -> Result<Self, FitError> {
        let empty = FactoredRows::new(model, scaling);
        empty.check_group_count(labels.len())?;
        let factor = |runs: &&[Run]| {
            let (mut factored, mut workspace) = (empty.clone(), empty.workspace());
            let mut blocks = rows.copied(runs, workspace.rows());
            blocks.try_for_each(|block| factored.absorb(&block, &mut workspace))?;
            Ok(factored)
        };
        let factored = map(&rows.groups().collect::<Vec<_>>(), workers, factor)?;
        Ok(Self { groups: labels.into_iter().zip(factored).collect() })
    }

    /// All rows; `None` where there is no group.
    pub fn total(&self) -> Option<FactoredRows> {
        FactoredRows::merged(self.groups.iter().map(|(_, rows)| rows))
    }

    /// Neighbours together, each group of the result with the rows of a range that is not empty.
    pub(crate) fn merged(&self, ranges: &[Range<usize>]) -> Self {
        let merge = |range: &Range<usize>| {
            let (label, mut all) = self.groups[range.start].clone();
            self.groups[range.clone()].iter().skip(1).for_each(|(_, rows)| all.merge(rows));
            (label, all)
        };
        Self { groups: ranges.iter().map(merge).collect() }
    }

    /// For each group the rows of all others; `None` with fewer than two groups. From both ends on: nothing is taken away
    /// from anything, and no group is merged more than four times.
    pub(crate) fn without_each(&self) -> Option<Vec<FactoredRows>> {
        let merged = |earlier: &FactoredRows, later: &FactoredRows| {
            let mut all = earlier.clone();
            all.merge(later);
            all
        };
        let rows = |group: usize| &self.groups[group].1;
        let last = self.groups.len().checked_sub(1).filter(|&last| last > 0)?;
        // Those after each group, from the last but one on.
        let mut after = vec![rows(last).clone()];
        for group in (1..last).rev() {
            after.push(merged(rows(group), &after[after.len() - 1]));
        }
        let mut before = rows(0).clone();
        let mut others: Vec<FactoredRows> = after.pop().into_iter().collect();
        for group in 1..last {
            others.extend(after.pop().map(|after| merged(&before, &after)));
            before.merge(rows(group));
        }
        others.push(before);
        Some(others)
    }
}
