//! What a reader of a trial's results should know about its log.

use std::ops::Range;

use super::diagnostic::Diagnostic;
use super::forces::TrialForces;
use super::input::{TrialInput, TrialRows};
use super::leg::{STILL_RAD, Strides, unwrap};
use super::profile::Profile;
use calibration::Calibration;
use forces::TareFrames;
use shell_data::statistics::{extremes, upper_median};
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
) -> [Option<Diagnostic>; 2] {
    let rows = window.len() as u64;
    let has_sensors = !input.rows.readings.is_empty();
    let repeated = if has_sensors { rows - count_fresh(input.rows, window.clone()) } else { 0 };
    let missing = missing_rows(&input.rows.times_s[window], input.times.period_s);
    let (expected, rule) = (rows + missing, input.options.forces.rule);
    [
        (repeated > 0).then_some(Diagnostic::RepeatedRows { rows, repeated }),
        (missing > 0).then_some(Diagnostic::MissingRows { missing, expected, rule }),
    ]
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
) -> [Option<Diagnostic>; 2] {
    let turned_rad = turned_rad(tare, profile.leg_rad(Telemetry::RightLeg));
    let end_s = tare.end_s();
    [
        (turned_rad > STILL_RAD).then_some(Diagnostic::MovingTare { turned_rad, end_s }),
        (end_s > enter_s).then_some(Diagnostic::LateTare(end_s)),
    ]
}

/// By how much the right leg moves during a tare, rad; 0 if that is not known.
fn turned_rad(tare: &TareFrames, rad_per_count: f64) -> f64 {
    let (low, high) = extremes(unwrap(&tare.times_s[..tare.leg.len()], &tare.leg, rad_per_count));
    (high - low).max(0.0)
}

/// Readings that cannot be trusted.
pub(super) fn diagnose_frames(
    calibration: &Calibration,
    forces: &TrialForces,
    window: Range<usize>,
    full_scale: f64,
) -> [Option<Diagnostic>; 2] {
    let of_rows = &forces.frame_of_row[window];
    let (Some(&first), Some(&last)) = (of_rows.first(), of_rows.last()) else {
        return [None, None];
    };
    let of = (last - first + 1) as u64;
    let cut = |column: &Vec<f64>| column[first..=last].to_vec();
    let channels = forces.frames.iter().take(calibration.channels());
    let readings: Vec<Vec<f64>> = channels.map(cut).collect();
    let inside = |reading: f64| reading > 0.0 && reading < full_scale;
    let is_saturated = |frame: &usize| readings.iter().any(|column| !inside(column[*frame]));
    let saturated = (0..of as usize).filter(is_saturated).count() as u64;
    let frames = calibration.rows_out_of_range(&readings);
    [
        (frames > 0).then_some(Diagnostic::OutOfRange { frames, of }),
        (saturated > 0).then_some(Diagnostic::Saturated { frames: saturated, of }),
    ]
}

/// Legs that do not turn.
pub(super) fn diagnose_legs(strides: Option<&Strides>) -> Option<Diagnostic> {
    let Some(strides) = strides else { return Some(Diagnostic::NoLeg) };
    let mut periods: Vec<f64> = strides.spans().map(|(start, end)| end - start).collect();
    let Some(median) = upper_median(&mut periods) else { return Some(Diagnostic::NoStride) };
    let longest_s = strides.longest_still_s;
    (longest_s > STALL_STRIDES * median).then_some(Diagnostic::StalledLeg(longest_s))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_that_are_missing_are_counted() {
        assert_eq!(missing_rows(&[1.0, 1.001, 1.0039, 1.005, 1.0051], 0.001), 2);
    }
}
