//! What `--json` says of lag and memory.

use calibration::dynamics::{Dynamics, NotSearched};
use calibration::fit::Fit;
use calibration_file::stored::{OfAxes, Stored};
use serde::Serialize;
use shell_data::wrench::Axes;

/// What was found, or why nothing was searched for.
#[derive(Serialize)]
pub(super) struct DynamicsReport {
    #[serde(skip_serializing_if = "Option::is_none")]
    not_searched: Option<String>,
    /// `s` or `rows`.
    #[serde(skip_serializing_if = "Option::is_none")]
    time_base: Option<&'static str>,
    /// Of the reference, in units of the time base; 0 for none.
    lag: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    lag_standard_error: Option<f64>,
    time_constants: Vec<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    held_out_rms: Option<GainReport>,
}

/// Errors of the family that was searched on, N and N·m.
#[derive(Serialize)]
struct GainReport {
    folds: usize,
    plain: OfAxes<f64>,
    with_lag: OfAxes<f64>,
    with_lag_and_memory: OfAxes<f64>,
}

impl DynamicsReport {
    /// What a fit found, if anything was to be searched for.
    pub(super) fn from_fit(fitted: &Fit, axes: Axes) -> Option<Self> {
        fitted.dynamics.as_ref().map(|found| Self::new(found, axes))
    }

    fn new(found: &Result<Dynamics, NotSearched>, axes: Axes) -> Self {
        let reason = found.as_ref().err();
        let found = found.as_ref().ok();
        let gain = found.and_then(|found| found.gain);
        Self {
            not_searched: reason.map(ToString::to_string),
            time_base: found.map(|found| found.time_base.unit()),
            lag: found.and_then(|found| found.lag).map_or(0.0, |lag| lag.by),
            lag_standard_error: found.and_then(|found| found.lag_standard_error),
            time_constants: found
                .and_then(|found| found.memory.as_ref())
                .map_or_else(Vec::new, |memory| memory.time_constants.clone()),
            held_out_rms: gain.map(|gain| GainReport {
                folds: gain.folds,
                plain: Stored::of(&gain.plain, axes),
                with_lag: Stored::of(&gain.with_lag, axes),
                with_lag_and_memory: Stored::of(&gain.with_all, axes),
            }),
        }
    }
}
