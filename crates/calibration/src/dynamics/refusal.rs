//! Rows in which time has nothing to say.

use std::fmt;

use crate::groups::{SHUFFLED_BELOW, has_poses, neighbour_correlation};
use shell_data::dataset::Dataset;

/// Why neither lag nor memory was searched for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NotSearched {
    /// Nothing moves within a pose.
    Poses,
    /// Rows are labelled by contact. A memory of the contact before depends on the order of the contacts, which differs
    /// in use, and leaks between groups that are held out.
    Groups,
    /// Neighbouring rows have nothing to do with each other; this is their largest correlation.
    Shuffled(f64),
    /// There are too few rows to hold some out.
    FewRows,
    /// Rows count more or less than one another.
    Weights,
}

impl fmt::Display for NotSearched {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Poses => f.write_str("the loads are constant in each pose"),
            Self::Groups => f.write_str(
                "the rows are labelled as groups, and the order of groups differs in use (`--memory-terms auto` searches \
                 anyway)",
            ),
            Self::Shuffled(correlation) => write!(
                f,
                "the rows are not in the order of time: neighbouring loads are not alike \
                 (correlation {correlation:.2})"
            ),
            Self::FewRows => f.write_str("there are too few rows to hold some out"),
            Self::Weights => f.write_str("rows with weights are not in the order of time"),
        }
    }
}

/// Why nothing should be searched for in these rows, if there is a reason.
pub(super) fn reason(data: &Dataset, in_groups: bool) -> Option<NotSearched> {
    if data.has_weights() {
        return Some(NotSearched::Weights);
    }
    // Before poses, which loads in any order might seem to be.
    let correlation = neighbour_correlation(data);
    if correlation < SHUFFLED_BELOW {
        return Some(NotSearched::Shuffled(correlation));
    }
    if has_poses(data) {
        return Some(NotSearched::Poses);
    }
    let is_labelled = data.logs.iter().all(|log| log.has_groups);
    (is_labelled && !in_groups).then_some(NotSearched::Groups)
}
