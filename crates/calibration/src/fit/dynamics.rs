//! Lag and memory, before anything else is made of the rows.

use super::{Fit, FitOptions, ModelRule};
use crate::dynamics::{Dynamics, DynamicsRule, MemoryRule, NotSearched, find, prepared};
use crate::error::FitError;
use shell_data::dataset::Dataset;

/// Rows with memory terms beside their readings, and the wrench at the time of the readings.
pub(super) struct PreparedRows {
    pub(super) train: Dataset,
    pub(super) test: Dataset,
    dynamics: Option<Result<Dynamics, NotSearched>>,
}

impl FitOptions<'_> {
    /// Finds lag and memory as far as that is asked for, and prepares the rows for a model that has them.
    pub(super) fn prepare(&self, train: Dataset, test: Dataset) -> Result<PreparedRows, FitError> {
        let mut rule = self.dynamics;
        if self.means && !rule.is_nothing() {
            let are_given = rule.lag != DynamicsRule::AUTO.lag || rule.memory != MemoryRule::Auto;
            if are_given {
                return Err(FitError::DynamicsOfMeans);
            }
            rule = DynamicsRule::NOTHING;
        }
        if self.model == ModelRule::Physics {
            rule.memory = MemoryRule::Given(&[]);
        }
        if rule.is_nothing() {
            return Ok(PreparedRows { train, test, dynamics: None });
        }
        let found = find(&train, &rule, self.intercept, self.workers)?;
        let (memory, lag) = match &found {
            Ok(found) => (found.memory.as_ref(), found.lag),
            Err(_) => (None, None),
        };
        Ok(PreparedRows {
            train: prepared(train, memory, lag)?,
            test: prepared(test, memory, lag)?,
            dynamics: Some(found),
        })
    }
}

impl PreparedRows {
    /// Says what was found, and puts it into the calibration.
    pub(super) fn complete(self, fitted: &mut Fit) {
        if let Some(Ok(found)) = &self.dynamics {
            fitted.calibration.lag = found.lag;
            let has_terms = fitted.calibration.columns() > fitted.calibration.channels();
            fitted.calibration.memory = found.memory.clone().filter(|_| has_terms);
        }
        fitted.dynamics = self.dynamics;
    }
}
