//! What there is to remark on a trial, beside its results.

use std::ops::Range;

use super::forces::Forces;
use super::grid::missing_rows;
use super::leg::{STILL_RAD, Strides};
use super::options::TrialOptions;
use super::profile::Profile;
use super::remark::Remark;
use super::stretch::{Clock, Stretch};
use super::tare::TareFrames;
use calibration::Calibration;

/// A stall is told when the leg stands still for this many strides.
const STALL_STRIDES: f64 = 2.0;

/// Rows of the window that bring a new frame.
pub(super) fn count_fresh(stretch: &Stretch, window: Range<usize>) -> u64 {
    stretch.fresh[window].iter().filter(|fresh| **fresh).count() as u64
}

/// Rows that repeat, and rows that are missing.
pub(super) fn remark_rows(
    stretch: &Stretch,
    window: Range<usize>,
    clock: &Clock,
    options: &TrialOptions,
    remarks: &mut Vec<Remark>,
) {
    let rows = window.len() as u64;
    if !stretch.readings.is_empty() {
        let repeated = rows - count_fresh(stretch, window.clone());
        if repeated > 0 {
            remarks.push(Remark::RepeatedRows { rows, repeated });
        }
    }
    let missing = missing_rows(&stretch.times_s[window], clock.period_s);
    if missing > 0 {
        let (expected, rule) = (rows + missing, options.rule);
        remarks.push(Remark::MissingRows { missing, expected, rule });
    }
}

/// A tare that was not taken at rest.
pub(super) fn remark_tare(
    tare: &TareFrames,
    profile: &Profile,
    enter_s: f64,
    remarks: &mut Vec<Remark>,
) {
    let (turned_rad, end_s) = (tare.turned_rad(profile.telemetry.leg_rad_per_count), tare.end_s());
    if turned_rad > STILL_RAD {
        remarks.push(Remark::MovingTare { turned_rad, end_s });
    }
    if end_s > enter_s {
        remarks.push(Remark::LateTare { end_s });
    }
}

/// Readings that cannot be trusted.
pub(super) fn remark_frames(
    calibration: Option<&Calibration>,
    forces: Option<&Forces>,
    window: Range<usize>,
    options: &TrialOptions,
    remarks: &mut Vec<Remark>,
) {
    let (Some(calibration), Some(forces)) = (calibration, forces) else { return };
    let of_rows = &forces.frame_of_row[window];
    let (Some(&first), Some(&last)) = (of_rows.first(), of_rows.last()) else { return };
    let of = (last - first + 1) as u64;
    let cut = |column: &Vec<f64>| column[first..=last].to_vec();
    let frames: Vec<Vec<f64>> = forces.frames.iter().map(cut).collect();
    let out = calibration.rows_out_of_range(&frames);
    if out > 0 {
        remarks.push(Remark::OutOfRange { frames: out, of });
    }
    let inside = |reading: f64| reading > 0.0 && reading < options.full_scale;
    let is_saturated = |frame: &usize| frames.iter().any(|column| !inside(column[*frame]));
    let saturated = (0..of as usize).filter(is_saturated).count() as u64;
    if saturated > 0 {
        remarks.push(Remark::Saturated { frames: saturated, of });
    }
}

/// Legs that do not turn.
pub(super) fn remark_legs(strides: Option<&Strides>, remarks: &mut Vec<Remark>) {
    let Some(strides) = strides else {
        remarks.push(Remark::NoLeg);
        return;
    };
    let mut periods: Vec<f64> = strides.spans().map(|(start, end)| end - start).collect();
    periods.sort_by(f64::total_cmp);
    match periods.get(periods.len() / 2) {
        None => remarks.push(Remark::NoStride),
        Some(median) if strides.longest_still_s > STALL_STRIDES * median => {
            remarks.push(Remark::StalledLeg { longest_s: strides.longest_still_s });
        }
        Some(_) => {}
    }
}
