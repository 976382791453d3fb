//! A physics model as a calibration: inverted, with what is known of its errors.

use std::collections::BTreeSet;

use super::PhysicsError;
use super::choice::Choice;
use super::intervals::{GroupIntervals, Scores};
use super::inversion::{Estimates, Inversion};
use super::model::PhysicsModel;
use super::rows::TrainingRows;

/// Rows of each group that tell its quantiles: rows of a group resemble each other.
const MOST_SCORED: usize = 64;

/// A physics model, ready to convert readings.
#[derive(Clone, Debug, PartialEq)]
pub struct PhysicsCalibration {
    model: PhysicsModel,
    inversion: Inversion,
    /// Intervals from groups that were held out, where those are known.
    pub intervals: Option<GroupIntervals>,
}

impl PhysicsCalibration {
    /// Makes a model ready, without intervals.
    pub fn new(model: PhysicsModel) -> Self {
        Self { inversion: Inversion::new(&model), model, intervals: None }
    }

    /// Fits to rows: chooses λ and the width of the priors by groups that are held out, whose errors
    /// give the intervals. λ and width were chosen on these groups, too: two numbers, for all of them.
    ///
    /// # Errors
    /// [`PhysicsError`].
    pub fn fit(rows: &TrainingRows) -> Result<(Self, Choice), PhysicsError> {
        let choice = Choice::fit(&rows.observations()?)?;
        let mut scores = Scores::default();
        for fold in &choice.fold_models {
            let groups: BTreeSet<u64> = fold.groups.iter().copied().collect();
            let held_out = rows.convert(&groups, &fold.model, MOST_SCORED);
            for (row, &group) in held_out.groups.iter().enumerate() {
                let error = held_out.errors.each_ref().map(|column| column[row]);
                scores.add(group, &error, &held_out.estimates.row(row).standard_errors);
            }
        }
        let intervals = Some(scores.intervals());
        Ok((Self { intervals, ..Self::new(choice.model.clone()) }, choice))
    }

    /// The model.
    pub fn model(&self) -> &PhysicsModel {
        &self.model
    }

    /// The wrenches of all rows; see [`Inversion::estimates`].
    ///
    /// # Panics
    /// If `readings` are not the model's channels, or of different lengths.
    pub fn estimates(&self, readings: &[Vec<f64>]) -> Estimates {
        self.inversion.estimates(readings)
    }
}
