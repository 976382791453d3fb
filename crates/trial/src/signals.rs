//! The signals of a trial at every row: forces, motor power and leg angles, with diagnostics on the log.

use std::ops::Range;

use super::diagnostic::{Diagnostic, Severity};
use super::error::TrialError;
use super::input::{TraceExtent, TrialInput, TrialRows};
use super::leg::{STILL_RAD, Strides, ambiguous_step, unwrap};
use super::power::Power;
use super::profile::Profile;
use super::trace::Trace;
use calibration::{Calibration, ReadingSpans};
use forces::{ForceError, RowRule, TareFrames};
use shell_data::statistics::{extremes, upper_median};
use shell_data::telemetry::Telemetry;
use shell_data::wrench::{Axes, Axis, PerAxis};

const STALL_STRIDES: f64 = 2.0;

const NO_FORCES: &str = "forces and drag energy are left out";

pub(super) struct Signals {
    pub(super) forces: Option<TrialForces>,
    pub(super) power: Option<Power>,
    /// Angles, rad; empty if unknown.
    right_leg: Vec<f64>,
    left_leg: Vec<f64>,
    pub(super) strides: Option<Strides>,
    pub(super) is_beyond: bool,
    pub(super) is_stuck: bool,
}

impl Signals {
    /// Computes the signals, and adds `diagnostics` on missing data and on the rows `window`.
    ///
    /// # Errors
    /// [`TrialError`] if there are neither forces nor power, or the sensors do not match the calibration.
    pub(super) fn new(
        input: &TrialInput<'_>,
        window: Range<usize>,
        diagnostics: &mut Vec<Diagnostic>,
    ) -> Result<Self, TrialError> {
        let TrialInput { trial, instrument, rows, pipeline, options, .. } = *input;
        let forces = find_forces(input, diagnostics)?;
        let power = Power::new(rows, instrument.profile, window.clone());
        let power = power.map_err(|why| diagnostics.push(why)).ok();
        if forces.is_none() && power.is_none() {
            let reasons: Vec<&str> = diagnostics.iter().map(|why| &*why.text).collect();
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
        diagnose_rows(input, window.clone(), diagnostics);
        let [mut is_beyond, mut is_stuck] = [false; 2];
        let counts = rows.telemetry(Telemetry::RightLeg).unwrap_or_default();
        let angle = right_leg.get(window.clone()).unwrap_or_default();
        let per_count = instrument.profile.leg_rad(Telemetry::RightLeg);
        diagnostics.extend(ambiguous_step(counts, angle, per_count).map(diagnose_turns));
        if let (Some(calibration), Some(forces)) = (instrument.calibration, &forces) {
            if let Some(tare) = pipeline.and_then(|of| of.tare_frames.as_ref()) {
                diagnostics.extend(diagnose_tare(tare, instrument.profile, enter));
            }
            let of_rows = &forces.frame_of_row[window];
            if let (Some(&first), Some(&last)) = (of_rows.first(), of_rows.last()) {
                let cut = |column: &Vec<f64>| column[first..=last].to_vec();
                let channels = forces.frames.iter().take(calibration.channels());
                let readings: Vec<Vec<f64>> = channels.map(cut).collect();
                diagnostics.extend(diagnose_frames(calibration, &readings, options.full_scale));
                let beyond = calibration.rows_out_of_range(&readings);
                let stuck = ReadingSpans::new(&readings).stuck(calibration);
                is_stuck = !stuck.is_empty();
                diagnostics.extend(stuck.into_iter().map(diagnose_stuck));
                is_beyond = 2 * beyond > readings.first().map_or(0, Vec::len) as u64;
            }
        }
        let are_counts = instrument.profile.unit_text(Telemetry::RightLeg).is_some()
            || !counts.iter().any(|count| count.fract().abs() > 0.0);
        diagnostics.extend(diagnose_legs(strides.as_ref(), are_counts));
        let left_leg = leg(Telemetry::LeftLeg);
        Ok(Self { forces, power, right_leg, left_leg, strides, is_beyond, is_stuck })
    }

    pub(super) fn into_trace(self, of: &TrialRows) -> Trace {
        let (power_w, [right_power_w, left_power_w]) = match self.power {
            Some(Power { sides_w: Some(sides), .. }) => (Vec::new(), sides),
            Some(Power { total_w, sides_w: None }) => (total_w, Default::default()),
            None => Default::default(),
        };
        Trace {
            t_s: of.times_s.clone(),
            wrench: self.forces.map(|forces| forces.wrench).unwrap_or_default(),
            fresh: of.fresh.clone(),
            right_leg_rad: self.right_leg,
            left_leg_rad: self.left_leg,
            right_power_w,
            left_power_w,
            power_w,
            stride_times_s: self.strides.map(|strides| strides.times_s).unwrap_or_default(),
        }
    }
}

fn find_forces(
    input: &TrialInput<'_>,
    diagnostics: &mut Vec<Diagnostic>,
) -> Result<Option<TrialForces>, TrialError> {
    let found = input.rows.readings.len();
    let Some(calibration) = input.instrument.calibration else {
        let text = format!("no calibration was given: {NO_FORCES}");
        diagnostics.push(Diagnostic::warning("no_calibration", text));
        return Ok(None);
    };
    let expected = calibration.columns();
    if found > 0 && found != expected {
        return Err(TrialError::Channels { expected, found });
    }
    let Some(pipeline) = input.pipeline.filter(|_| found > 0) else {
        let text = format!("the log has no sensor columns: {NO_FORCES}");
        diagnostics.push(Diagnostic::warning("no_sensors", text));
        return Ok(None);
    };
    if let (Some(low_pass), None) = (input.options.forces.low_pass, pipeline.low_pass) {
        let text = format!(
            "the log's rate is too low for a low-pass of {} Hz: forces are not filtered",
            low_pass.cutoff_hz
        );
        diagnostics.push(Diagnostic::warning("unfiltered", text));
    }
    // Results need two axes; traces show all.
    let needed: Axes = [Axis::Fx, Axis::Fz].into_iter().collect();
    if !calibration.axes.contain(needed) {
        return Err(TrialError::Axes(needed.without(calibration.axes)));
    }
    let traced = input.options.trace != TraceExtent::Nothing;
    let axes: Vec<Axis> = if traced { calibration.axes } else { needed }.iter().collect();
    let rows = input.rows;
    let (frames, frame_of_row) = frames(rows);
    let by_frame = (&*frames, &*frame_of_row);
    let mut wrench = pipeline.wrench_of_rows(calibration, &rows.times_s, by_frame);
    for axis in Axis::ALL.iter().filter(|axis| !axes.contains(axis)) {
        wrench[axis.index()] = Vec::new();
    }
    let mut stream = pipeline.stream(&axes);
    let mut wrench = stream.push(&rows.times_s, wrench).map_err(ForceError::from)?;
    let rest = stream.finish().map_err(ForceError::from)?;
    wrench.iter_mut().zip(rest).for_each(|(wrench, rest)| wrench.extend(rest));
    Ok(Some(TrialForces { wrench, frame_of_row, frames }))
}

#[derive(Clone, Debug, Default)]
pub(super) struct TrialForces {
    /// Tared and filtered, one value per row, N and N·m; axes that were not requested are empty.
    pub(super) wrench: PerAxis<Vec<f64>>,
    pub(super) frame_of_row: Vec<usize>,
    pub(super) frames: Vec<Vec<f64>>,
}

fn frames(rows: &TrialRows) -> (Vec<Vec<f64>>, Vec<usize>) {
    let is_new = |row: usize| row == 0 || rows.fresh[row];
    let new_rows: Vec<usize> = (0..rows.times_s.len()).filter(|&row| is_new(row)).collect();
    let pick = |column: &Vec<f64>| new_rows.iter().map(|&row| column[row]).collect();
    let mut frame = 0;
    let frame_of_row = (0..rows.times_s.len()).map(|row| {
        frame += usize::from(is_new(row));
        frame - 1
    });
    let frame_of_row = frame_of_row.collect();
    (rows.readings.iter().map(pick).collect(), frame_of_row)
}

pub(super) fn count_fresh(rows: &TrialRows, window: Range<usize>) -> u64 {
    rows.fresh[window].iter().filter(|fresh| **fresh).count() as u64
}

fn diagnose_rows(input: &TrialInput<'_>, window: Range<usize>, diagnostics: &mut Vec<Diagnostic>) {
    let rows = window.len() as u64;
    let ends_s = [input.trial.t_enter_s, input.trial.t_exit_s];
    let missing = missing_rows(&input.rows.times_s[window.clone()], ends_s, input.times.period_s);
    let has_sensors = !input.rows.readings.is_empty();
    let repeated = if has_sensors { rows - count_fresh(input.rows, window) } else { 0 };
    if repeated > 0 {
        let text = format!("{repeated} of {rows} rows are duplicates of the previous frame");
        diagnostics.push(Diagnostic::note("repeated_rows", text));
    }
    if missing > 0 {
        let expected = rows + missing;
        let rule = match input.options.forces.rule {
            RowRule::Time => "all is computed by time, not by row",
            RowRule::Rows => "by row, the filter takes no notice of that",
        };
        let text = format!("about {missing} of {expected} rows are missing; {rule}");
        let severity = if missing * 100 < expected { Severity::Note } else { Severity::Warning };
        diagnostics.push(Diagnostic { severity, code: "missing_rows", text });
    }
}

/// The number of rows missing between ascending `times`, which should be `period_s` apart, and between them and the ends
/// of the window: a gap may reach over entry or exit.
fn missing_rows(times: &[f64], [enter_s, exit_s]: [f64; 2], period_s: f64) -> u64 {
    let times = [&[enter_s], times, &[exit_s]].concat();
    let missing = |pair: &[f64]| ((pair[1] - pair[0]) / period_s).round() as u64;
    times.windows(2).map(|pair| missing(pair).saturating_sub(1)).sum()
}

/// Reports a tare in which the sensor or the robot was not still.
fn diagnose_tare(tare: &TareFrames, profile: &Profile, enter_s: f64) -> Vec<Diagnostic> {
    let mut diagnostics = Vec::new();
    // The rotation of the right leg; 0 if unknown.
    let per_count = profile.leg_rad(Telemetry::RightLeg);
    let (low, high) = extremes(unwrap(&tare.times_s[..tare.leg.len()], &tare.leg, per_count));
    let (turned_rad, end_s) = ((high - low).max(0.0), tare.end_s());
    if turned_rad > STILL_RAD {
        let text = format!(
            "the right leg turns by {turned_rad:.1} rad while the tare is taken, up to {end_s:.3} s"
        );
        diagnostics.push(Diagnostic::warning("moving_tare", text));
    }
    if end_s > enter_s {
        let text =
            format!("the tare ends at {end_s:.3} s, after the robot has entered the channel");
        diagnostics.push(Diagnostic::warning("late_tare", text));
    }
    diagnostics
}

fn diagnose_frames(
    calibration: &Calibration,
    readings: &[Vec<f64>],
    full_scale: f64,
) -> impl Iterator<Item = Diagnostic> {
    let of = readings.first().map_or(0, Vec::len);
    let converter = calibration.converter(Some(full_scale));
    let is_at_end = |reading: f64| converter.is_some_and(|of| of.is_at_end(reading));
    let is_saturated = |frame: &usize| readings.iter().any(|column| is_at_end(column[*frame]));
    let saturated = (0..of).filter(is_saturated).count() as u64;
    let out_of_range = calibration.rows_out_of_range(readings);
    let kinds = [
        ("out_of_range", out_of_range, "reading outside the range of the training data"),
        ("saturated", saturated, "saturated reading"),
    ];
    kinds.into_iter().filter(|(_, count, _)| *count > 0).map(move |(code, count, what)| {
        Diagnostic::warning(code, format!("{count} of {of} frames have a {what}"))
    })
}

fn diagnose_stuck((channel, reading): (usize, f64)) -> Diagnostic {
    let text = format!(
        "channel {} reads {reading} in every frame of the window while others change: forces are wrong; \
         `shellcal doctor` tells what to check",
        channel + 1
    );
    Diagnostic::warning("stuck_channel", text)
}

fn diagnose_turns(step: f64) -> Diagnostic {
    let text = format!(
        "the right leg turns by {step:.2} turns from row to row or more: strides are uncertain; log more rows per \
         second"
    );
    Diagnostic::warning("ambiguous_strides", text)
}

/// `are_counts` is false for positions that are taken for counts but cannot be.
fn diagnose_legs(strides: Option<&Strides>, are_counts: bool) -> Option<Diagnostic> {
    let Some(strides) = strides else {
        let text = "the log has no right leg position: strides are left out";
        return Some(Diagnostic::warning("no_leg", text));
    };
    let mut periods: Vec<f64> = strides.spans().map(|(start, end)| end - start).collect();
    let Some(median) = upper_median(&mut periods) else {
        let text = "the right leg does not complete a turn in the window";
        let unit = ": its positions are no counts, give the profile `right_leg = { unit = … }` under `[columns]`";
        let text = [text, if are_counts { "" } else { unit }].concat();
        return Some(Diagnostic::warning("no_stride", text));
    };
    let longest_s = strides.longest_still_s;
    let text = format!("the right leg stands still for {longest_s:.3} s");
    (longest_s > STALL_STRIDES * median).then(|| Diagnostic::warning("stalled_leg", text))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_that_are_missing_are_counted() {
        let times = [1.0, 1.001, 1.0039, 1.005, 1.0051];
        assert_eq!(missing_rows(&times, [1.0, 1.0051], 0.001), 2);
        assert_eq!(missing_rows(&times, [0.9995, 1.0059], 0.001), 2, "ends between rows");
        // Rows at 1.0061, 1.0071 and 1.0081 s are missing before the exit.
        assert_eq!(missing_rows(&times, [1.0, 1.0091], 0.001), 5);
    }
}
