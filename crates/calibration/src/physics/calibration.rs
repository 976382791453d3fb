//! A physics model as a calibration: inverted, with what is known of its errors.

use std::collections::BTreeSet;

use super::choice::Choice;
use super::intervals::{GroupIntervals, Scores};
use super::inversion::{Estimates, Inversion};
use super::model::PhysicsModel;
use super::observation::ObservationSample;
use super::rows::TrainingRows;
use crate::error::FitError;
use crate::passes::Workers;
use shell_data::wrench::PerAxis;

/// Groups that the model's own standard errors count as, when held-out groups correct them.
const MODEL_GROUPS: f64 = 4.0;

/// Rows of each group that tell its quantiles: rows of a group resemble each other.
const MOST_SCORED: usize = 64;

/// A physics model, ready to convert readings.
#[derive(Clone, Debug, PartialEq)]
pub struct PhysicsCalibration {
    model: PhysicsModel,
    inversion: Inversion,
    error_scale: PerAxis<f64>,
    /// Intervals from groups that were held out, where those are known.
    pub intervals: Option<GroupIntervals>,
}

impl PhysicsCalibration {
    /// Makes a model ready, without intervals. Its standard errors are multiplied by `error_scale`.
    pub fn new(model: PhysicsModel, error_scale: PerAxis<f64>) -> Self {
        Self { inversion: Inversion::new(&model), model, error_scale, intervals: None }
    }

    /// Fits to rows: chooses λ, the width of the priors and shared factors by groups that are held out, whose
    /// errors scale the standard errors and give the intervals. They were chosen on these groups, too: three
    /// numbers, for all of them.
    ///
    /// # Errors
    /// [`FitError::Physics`], [`FitError::Interrupted`].
    pub fn fit(rows: &TrainingRows, workers: Workers<'_>) -> Result<(Self, Choice), FitError> {
        Self::fit_from(rows, ObservationSample::from_rows(rows)?, None, workers)
    }

    /// Fits to a sample of the observations of these rows; `before` is the choice for a larger sample, where the fit
    /// starts.
    pub(crate) fn fit_from(
        rows: &TrainingRows,
        sample: ObservationSample,
        before: Option<&Choice>,
        workers: Workers<'_>,
    ) -> Result<(Self, Choice), FitError> {
        let choice = Choice::fit_from(sample, before, workers)?;
        let mut scores = Scores::default();
        for fold in &choice.fold_models {
            let groups: BTreeSet<u64> = fold.groups.iter().copied().collect();
            let inversion = Inversion::new(&fold.model);
            let every = |rows: usize| rows.div_ceil(MOST_SCORED);
            for row in rows.convert(&groups, every, |readings| inversion.estimates(readings)) {
                scores.add(row.group, &row.errors, &row.standard_errors);
            }
        }
        let error_scale = scores.rescale(MODEL_GROUPS);
        let intervals = Some(scores.intervals());
        Ok((Self { intervals, ..Self::new(choice.model.clone(), error_scale) }, choice))
    }

    /// The model.
    pub fn model(&self) -> &PhysicsModel {
        &self.model
    }

    /// What the model's standard errors are multiplied by on each axis: the root mean square of held-out errors
    /// in them.
    pub fn error_scale(&self) -> &PerAxis<f64> {
        &self.error_scale
    }

    /// The wrenches of all rows, with standard errors as held-out groups have them; see [`Inversion::estimates`].
    ///
    /// # Panics
    /// If `readings` are not the model's channels, or of different lengths.
    pub fn estimates(&self, readings: &[Vec<f64>]) -> Estimates {
        let mut estimates = self.inversion.estimates(readings);
        for (errors, scale) in estimates.standard_errors.iter_mut().zip(self.error_scale) {
            errors.iter_mut().for_each(|error| *error *= scale);
        }
        estimates
    }
}
