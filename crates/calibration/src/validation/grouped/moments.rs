//! Exact sums by group.

use crate::exact::{ExactError, Moments, PartitionedMoments};
use crate::model::Model;
use crate::validation::ValidationError;

/// What a group is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
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
