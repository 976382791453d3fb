//! The sample of observations that a model is chosen on and fitted to, at equal strides in the order of cells:
//! neighbours resemble each other.

use std::collections::BTreeSet;

use super::PhysicsError;
use super::cells::{Cells, step};
use super::observation::Observation;
use super::rows::TrainingRows;

/// Most observations that candidates are tried on.
const MOST_TRIED: usize = 600;

/// Most observations that a model is fitted to: with more of them the errors of some ten parameters a sensor are a
/// two-hundredth of the squared error.
const MOST_FITTED: usize = 2_000;

/// A sample of observations.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ObservationSample {
    /// Number of observations that it was drawn from.
    pub(super) count: usize,
    /// Those that candidates are tried on.
    pub(super) tried: Vec<Observation>,
    /// Those that the chosen model is fitted to.
    pub(super) fitted: Vec<Observation>,
}

impl ObservationSample {
    pub(super) fn new(observations: &[Observation]) -> Self {
        let count = observations.len();
        let few = |most| observations.iter().step_by(step(count, most)).cloned().collect();
        Self { count, tried: few(MOST_TRIED), fitted: few(MOST_FITTED) }
    }

    /// # Errors
    /// As [`Cells::new`].
    pub(crate) fn from_rows(rows: &TrainingRows) -> Result<Self, PhysicsError> {
        let cells = Cells::new(rows)?;
        let [tried, fitted] = [MOST_TRIED, MOST_FITTED].map(|most| cells.observations(most));
        Ok(Self { count: cells.count, tried, fitted })
    }

    /// Those of all other groups.
    pub(super) fn without(&self, groups: &BTreeSet<u64>) -> Self {
        let rest = |of: &[Observation]| {
            of.iter().filter(|o| !groups.contains(&o.group)).cloned().collect()
        };
        Self { count: self.count, tried: rest(&self.tried), fitted: rest(&self.fitted) }
    }
}
