//! The signals of a trial at every row: forces, motor power, leg angles.

use std::ops::Range;

use super::diagnose::{diagnose_frames, diagnose_legs, diagnose_rows, diagnose_tare};
use super::diagnostic::Diagnostic;
use super::error::TrialError;
use super::forces::TrialForces;
use super::input::{TraceExtent, TrialInput, TrialRows};
use super::leg::{Strides, unwrap};
use super::power::Power;
use super::trace::Trace;
use shell_data::telemetry::Telemetry;
use shell_data::wrench::{Axes, Axis};

/// What can be computed of the rows of a trial.
pub(super) struct Signals {
    pub(super) forces: Option<TrialForces>,
    pub(super) power: Option<Power>,
    /// Angles, rad; empty where they are not known.
    right_leg: Vec<f64>,
    left_leg: Vec<f64>,
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
        let TrialInput { trial, instrument, rows, tare_frames, options, .. } = *input;
        let forces = find_forces(input, diagnostics)?;
        let power = Power::new(rows, instrument.profile, window.clone());
        let power = power.map_err(|why| diagnostics.push(why)).ok();
        if forces.is_none() && power.is_none() {
            let reasons: Vec<String> = diagnostics.iter().map(Diagnostic::to_string).collect();
            return Err(TrialError::Nothing(reasons.join("; ")));
        }
        let leg = |kind| {
            let counts = rows.telemetry(kind).unwrap_or_default();
            unwrap(&rows.times_s, counts, instrument.profile.leg_rad(kind))
        };
        let right_leg = leg(Telemetry::RightLeg);
        let (enter, exit) = (trial.t_enter_s, trial.t_exit_s);
        let strides =
            (!right_leg.is_empty()).then(|| Strides::new(&rows.times_s, &right_leg, enter, exit));
        diagnostics.extend(diagnose_rows(input, window.clone()).into_iter().flatten());
        if let (Some(calibration), Some(forces)) = (instrument.calibration, &forces) {
            let of_tare = tare_frames.map(|tare| diagnose_tare(tare, instrument.profile, enter));
            let of_frames = diagnose_frames(calibration, forces, window, options.full_scale);
            diagnostics.extend(of_tare.into_iter().flatten().chain(of_frames).flatten());
        }
        diagnostics.extend(diagnose_legs(strides.as_ref()));
        let left_leg = leg(Telemetry::LeftLeg);
        Ok(Self { forces, power, right_leg, left_leg, strides })
    }

    /// The signals at some rows.
    pub(super) fn trace(&self, of: &TrialRows, rows: Range<usize>) -> Trace {
        let cut = |column: &[f64]| column.get(rows.clone()).unwrap_or_default().to_vec();
        let wrench = self.forces.as_ref().map(|forces| forces.wrench.each_ref().map(|of| cut(of)));
        let (power_w, [right_power_w, left_power_w]) = match &self.power {
            Some(Power { sides_w: Some(sides), .. }) => {
                (Vec::new(), sides.each_ref().map(|w| cut(w)))
            }
            Some(Power { total_w, sides_w: None }) => (cut(total_w), Default::default()),
            None => Default::default(),
        };
        Trace {
            t_s: cut(&of.times_s),
            wrench: wrench.unwrap_or_default(),
            fresh: of.fresh.get(rows.clone()).unwrap_or_default().to_vec(),
            right_leg_rad: cut(&self.right_leg),
            left_leg_rad: cut(&self.left_leg),
            right_power_w,
            left_power_w,
            power_w,
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
        diagnostics.push(Diagnostic::Unfiltered(low_pass.cutoff_hz));
    }
    // Results need two axes; traces show all.
    let needed: Axes = [Axis::Fx, Axis::Fz].into_iter().collect();
    if !calibration.axes.contain(needed) {
        return Err(TrialError::Axes(needed.without(calibration.axes)));
    }
    let traced = input.options.trace != TraceExtent::Nothing;
    let axes: Vec<Axis> = if traced { calibration.axes } else { needed }.iter().collect();
    TrialForces::new(input.rows, calibration, pipeline, &axes).map(Some)
}
