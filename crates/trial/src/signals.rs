//! The signals of a trial at every row: forces, motor power, leg angles.

use std::ops::Range;

use super::diagnose::{diagnose_frames, diagnose_legs, diagnose_rows, diagnose_tare};
use super::diagnostic::Diagnostic;
use super::error::TrialError;
use super::forces::TrialForces;
use super::input::TraceExtent;
use super::input::TrialInput;
use super::input::TrialRows;
use super::leg::{Strides, unwrap};
use super::power::Power;
use super::trace::Trace;
use shell_data::telemetry::Telemetry;
use shell_data::wrench::{Axes, Axis, PerAxis};

/// What can be computed of the rows of a trial.
pub(super) struct Signals {
    pub(super) forces: Option<TrialForces>,
    pub(super) power: Option<Power>,
    /// Angles, rad.
    pub(super) right_leg: Option<Vec<f64>>,
    pub(super) left_leg: Option<Vec<f64>>,
    pub(super) strides: Option<Strides>,
}

impl Signals {
    /// Adds to `diagnostics` what is missing, and what is unusual in the rows `window`.
    ///
    /// # Errors
    /// [`TrialError`] if there are neither forces nor power, or the sensors are not the calibration's.
    pub(super) fn new(
        input: &TrialInput<'_>,
        window: Range<usize>,
        diagnostics: &mut Vec<Diagnostic>,
    ) -> Result<Self, TrialError> {
        let TrialInput { trial, instrument, rows, tare_frames, .. } = *input;
        let forces = find_forces(input, diagnostics)?;
        let power = Power::new(rows, instrument.profile, window.clone());
        let power = power.map_err(|why| diagnostics.push(why)).ok();
        if forces.is_none() && power.is_none() {
            let reasons: Vec<String> = diagnostics.iter().map(Diagnostic::to_string).collect();
            return Err(TrialError::Nothing(reasons.join("; ")));
        }
        let leg = |kind| {
            let rad = instrument.profile.leg_rad(kind);
            Some(unwrap(&rows.times_s, rows.telemetry(kind)?, rad))
        };
        let right_leg = leg(Telemetry::RightLeg);
        let (enter, exit) = (trial.t_enter_s, trial.t_exit_s);
        let strides = right_leg.as_ref();
        let strides = strides.map(|angle| Strides::new(&rows.times_s, angle, enter, exit));
        diagnose_rows(input, window.clone(), diagnostics);
        if let Some(tare) = tare_frames.filter(|_| forces.is_some()) {
            diagnose_tare(tare, instrument.profile, enter, diagnostics);
        }
        diagnose_frames(input, forces.as_ref(), window, diagnostics);
        diagnose_legs(strides.as_ref(), diagnostics);
        let left_leg = leg(Telemetry::LeftLeg);
        Ok(Self { forces, power, right_leg, left_leg, strides })
    }

    /// The signals at some rows.
    pub(super) fn trace(&self, of: &TrialRows, rows: Range<usize>) -> Trace {
        let cut = |column: &[f64]| column.get(rows.clone()).unwrap_or_default().to_vec();
        let cut_optional = |column: &Option<Vec<f64>>| cut(column.as_deref().unwrap_or_default());
        let wrench = match &self.forces {
            None => PerAxis::default(),
            Some(forces) => forces.wrench.each_ref().map(|axis| cut(axis)),
        };
        let sides = self.power.as_ref().and_then(|power| power.sides_w.as_ref());
        let side = |position: usize| sides.map_or_else(Vec::new, |sides| cut(&sides[position]));
        let total = self.power.as_ref().filter(|power| power.sides_w.is_none());
        Trace {
            t_s: cut(&of.times_s),
            wrench,
            fresh: of.fresh.get(rows.clone()).unwrap_or_default().to_vec(),
            right_leg_rad: cut_optional(&self.right_leg),
            left_leg_rad: cut_optional(&self.left_leg),
            right_power_w: side(0),
            left_power_w: side(1),
            power_w: total.map_or_else(Vec::new, |power| cut(&power.total_w)),
            stride_times_s: self.strides.as_ref().map_or_else(Vec::new, |s| s.times_s.clone()),
        }
    }
}

fn find_forces(
    input: &TrialInput<'_>,
    diagnostics: &mut Vec<Diagnostic>,
) -> Result<Option<TrialForces>, TrialError> {
    let found = input.rows.readings.len();
    let Some(calibration) = input.instrument.calibration else {
        diagnostics.push(Diagnostic::NoCalibration);
        return Ok(None);
    };
    let expected = calibration.columns();
    if found > 0 && found != expected {
        return Err(TrialError::Channels { expected, found });
    }
    let Some(pipeline) = input.pipeline.filter(|_| found > 0) else {
        diagnostics.push(Diagnostic::NoSensors);
        return Ok(None);
    };
    if let (Some(low_pass), None) = (input.options.forces.low_pass, pipeline.low_pass) {
        diagnostics.push(Diagnostic::Unfiltered { cutoff_hz: low_pass.cutoff_hz });
    }
    // Results need two axes; traces show all.
    let needed: Axes = [Axis::Fx, Axis::Fz].into_iter().collect();
    if !calibration.axes.contain(needed) {
        return Err(TrialError::Axes(needed.without(calibration.axes)));
    }
    let axes = match input.options.trace {
        TraceExtent::Nothing => needed,
        TraceExtent::Window | TraceExtent::Log => calibration.axes,
    };
    let axes: Vec<Axis> = axes.iter().collect();
    TrialForces::new(input.rows, calibration, pipeline, &axes).map(Some)
}
