//! What a reader of a trial's results should know about its log.

use std::ops::Range;

use super::diagnostic::Diagnostic;
use super::forces::TrialForces;
use super::input::TrialInput;
use super::input::TrialRows;
use super::leg::{STILL_RAD, Strides, unwrap};
use super::profile::Profile;
use forces::TareFrames;
use shell_data::statistics::upper_median;
use shell_data::telemetry::Telemetry;

/// A stall is reported when the leg stands still for this many strides.
const STALL_STRIDES: f64 = 2.0;

/// Rows of the window that bring a new frame.
pub(super) fn count_fresh(rows: &TrialRows, window: Range<usize>) -> u64 {
    rows.fresh[window].iter().filter(|fresh| **fresh).count() as u64
}

/// Rows that repeat, and rows that are missing.
pub(super) fn diagnose_rows(
    input: &TrialInput<'_>,
    window: Range<usize>,
    diagnostics: &mut Vec<Diagnostic>,
) {
    let rows = window.len() as u64;
    if !input.rows.readings.is_empty() {
        let repeated = rows - count_fresh(input.rows, window.clone());
        if repeated > 0 {
            diagnostics.push(Diagnostic::RepeatedRows { rows, repeated });
        }
    }
    let missing = missing_rows(&input.rows.times_s[window], input.times.period_s);
    if missing > 0 {
        let (expected, rule) = (rows + missing, input.options.forces.rule);
        diagnostics.push(Diagnostic::MissingRows { missing, expected, rule });
    }
}

/// How many rows are missing between ascending `times` of rows that should be `period_s` apart.
fn missing_rows(times: &[f64], period_s: f64) -> u64 {
    let missing = |pair: &[f64]| ((pair[1] - pair[0]) / period_s).round() as u64;
    times.windows(2).map(|pair| missing(pair).saturating_sub(1)).sum()
}

/// A tare that was not taken at rest.
pub(super) fn diagnose_tare(
    tare: &TareFrames,
    profile: &Profile,
    enter_s: f64,
    diagnostics: &mut Vec<Diagnostic>,
) {
    let (turned_rad, end_s) =
        (turned_rad(tare, profile.leg_rad(Telemetry::RightLeg)), tare.end_s());
    if turned_rad > STILL_RAD {
        diagnostics.push(Diagnostic::MovingTare { turned_rad, end_s });
    }
    if end_s > enter_s {
        diagnostics.push(Diagnostic::LateTare { end_s });
    }
}

/// By how much the right leg moves during a tare, rad; 0 if that is not known.
fn turned_rad(tare: &TareFrames, rad_per_count: f64) -> f64 {
    let angle = unwrap(&tare.times_s[..tare.leg.len()], &tare.leg, rad_per_count);
    let span = |(low, high): (f64, f64), a: &f64| (low.min(*a), high.max(*a));
    let (low, high) = angle.iter().fold((f64::INFINITY, f64::NEG_INFINITY), span);
    (high - low).max(0.0)
}

/// Readings that cannot be trusted.
pub(super) fn diagnose_frames(
    input: &TrialInput<'_>,
    forces: Option<&TrialForces>,
    window: Range<usize>,
    diagnostics: &mut Vec<Diagnostic>,
) {
    let (Some(calibration), Some(forces)) = (input.instrument.calibration, forces) else { return };
    let of_rows = &forces.frame_of_row[window];
    let (Some(&first), Some(&last)) = (of_rows.first(), of_rows.last()) else { return };
    let of = (last - first + 1) as u64;
    let cut = |column: &Vec<f64>| column[first..=last].to_vec();
    let channels = forces.frames.iter().take(calibration.channels());
    let frames: Vec<Vec<f64>> = channels.map(cut).collect();
    let out = calibration.rows_out_of_range(&frames);
    if out > 0 {
        diagnostics.push(Diagnostic::OutOfRange { frames: out, of });
    }
    let inside = |reading: f64| reading > 0.0 && reading < input.options.full_scale;
    let is_saturated = |frame: &usize| frames.iter().any(|column| !inside(column[*frame]));
    let saturated = (0..of as usize).filter(is_saturated).count() as u64;
    if saturated > 0 {
        diagnostics.push(Diagnostic::Saturated { frames: saturated, of });
    }
}

/// Legs that do not turn.
pub(super) fn diagnose_legs(strides: Option<&Strides>, diagnostics: &mut Vec<Diagnostic>) {
    let Some(strides) = strides else {
        diagnostics.push(Diagnostic::NoLeg);
        return;
    };
    let mut periods: Vec<f64> = strides.spans().map(|(start, end)| end - start).collect();
    match upper_median(&mut periods) {
        None => diagnostics.push(Diagnostic::NoStride),
        Some(median) if strides.longest_still_s > STALL_STRIDES * median => {
            diagnostics.push(Diagnostic::StalledLeg { longest_s: strides.longest_still_s });
        }
        Some(_) => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_that_are_missing_are_counted() {
        assert_eq!(missing_rows(&[1.0, 1.001, 1.0039, 1.005, 1.0051], 0.001), 2);
    }
}
