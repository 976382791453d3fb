//! Summary of a conversion, with its remarks.

use std::fmt;
use std::path::Path;

use super::frames::ConvertedFrames;
use crate::workflow::remark::{Remark, used_rows};
use crate::workflow::selection::RowFilter;
use calibration::dynamics::ReferenceLag;
use calibration::memory::TimeBase;
use calibration_file::Diagnostics;
use forces::payload::Lag;
use forces::sampling::Rate;
use forces::stationary::ZeroMove;
use forces::{AppliedLowPass, TareResult, by_column};
use shell_data::statistics::RunningVariance;
use shell_data::wrench::{AxisValues, PerAxis};

#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct ConvertSummary {
    pub rows: u64,
    /// Duplicates: rows whose readings equal the previous row's.
    pub repeated_rows: u64,
    pub skipped_rows: u64,
    pub frames: u64,
    pub rows_used: RowFilter,
    pub tare: Option<TareResult>,
    /// Low-pass filter, and the rate of its grid.
    pub low_pass: Option<AppliedLowPass>,
    /// The sampling of the frames written, if they were filtered.
    pub sampling: Option<Rate>,
    /// Correction of the lag of the calibration's reference, if it has a lag.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clock: Option<LagMadeUp>,
    /// Number of frames with a reading outside the range of the training data.
    pub out_of_range_frames: u64,
    pub saturated_frames: u64,
    /// Number of frames with a channel on a plateau of its curve.
    #[serde(skip_serializing_if = "is_zero")]
    pub insensitive_frames: u64,
    #[serde(skip_serializing_if = "is_zero")]
    pub left_out_frames: u64,
    /// Channels with one reading in all frames while others change.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub stuck_channels: Vec<StuckChannel>,
    /// Smallest, mean and largest value of each axis, N and N·m.
    #[serde(serialize_with = "by_column")]
    pub axes: AxisValues<AxisSummary>,
    /// Change of the zero between the first stationary interval and the last, before any tare. Only for a log with
    /// time, two of them, and no load to subtract.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub zero: Option<ZeroMove>,
    /// The remainder after the carried load was subtracted, if there is a load.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub load: Option<LoadSummary>,
}

impl ConvertSummary {
    pub fn remarks(&self, path: &Path) -> Vec<Remark> {
        let Self { rows, repeated_rows, skipped_rows, frames, .. } = *self;
        let counts = [rows, repeated_rows, skipped_rows];
        let mut remarks = vec![used_rows(path, self.rows_used, counts)];
        remarks.push(Remark::Note(self.tare_words()));
        remarks.push(Remark::Note(match self.low_pass {
            None => "low-pass: none".to_owned(),
            Some(AppliedLowPass { low_pass, rate_hz }) => {
                format!("low-pass: {low_pass}, at {rate_hz:.2} rows per second")
            }
        }));
        if let Some(clock) = self.clock.filter(|clock| clock.how != LagRule::NotMadeUp) {
            remarks.push(Remark::Note(clock.to_string()));
        }
        let path = path.display();
        let mut warn = |text: String| remarks.push(Remark::Warning(format!("`{path}`: {text}")));
        if let Some(clock) = self.clock.filter(|clock| clock.how == LagRule::NotMadeUp) {
            warn(clock.to_string());
        }
        if let Some(rate) = self.sampling {
            if rate.gaps > 0 {
                warn(format!("{} gaps between frames", rate.gaps));
            }
            if rate.backwards > 0 {
                warn(format!("time stands still or runs backwards {} times", rate.backwards));
            }
        }
        let is_fixed = self.tare.as_ref().is_some_and(|tare| tare.rests.is_none());
        if let Some(text) = self.zero.as_ref().filter(|_| is_fixed).and_then(ZeroMove::in_words) {
            warn(text);
        }
        for StuckChannel { name, reading } in &self.stuck_channels {
            warn(format!(
                "`{name}` reads {reading} in every frame while others change: forces are wrong; \
                 `shellcal doctor` tells what to check"
            ));
        }
        for (count, what) in [
            (self.out_of_range_frames, "outside the calibrated range"),
            (self.saturated_frames, "saturated"),
            (self.insensitive_frames, "on a plateau of its curve, insensitive to the load"),
            (self.left_out_frames, "left out by the model"),
        ] {
            if count > 0 {
                let share = 100.0 * count as f64 / frames.max(1) as f64;
                warn(format!("{count} of {frames} frames ({share:.1} %) have a reading {what}"));
            }
        }
        remarks
    }

    /// A doubt about the tare, based on the training data of the calibration.
    pub fn tare_doubt(&self, path: &Path, trained: Option<&Diagnostics>) -> Option<String> {
        let trained = trained?;
        let doubt = self.tare.as_ref()?.doubt(&trained.train, trained.excitation.as_ref()?)?;
        Some(format!("`{}`: {doubt}", path.display()))
    }

    fn tare_words(&self) -> String {
        let Some(tare) = &self.tare else {
            return "tare: none, zero is that of the calibration".to_owned();
        };
        let when = match (tare.start_s, tare.end_s) {
            (Some(start), Some(end)) => format!(", {} s to {} s", short(start), short(end)),
            _ => String::new(),
        };
        match (tare.rests, tare.last_rest_s) {
            (Some(rests), Some(last_s)) => format!(
                "tare: follows {rests} stationary intervals, the first{when}, the last until {} s",
                short(last_s)
            ),
            _ => format!("tare: mean of {} frames{when}", tare.frames),
        }
    }
}

#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct StuckChannel {
    pub name: String,
    pub reading: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct LagMadeUp {
    #[serde(flatten)]
    pub lag: ReferenceLag,
    pub how: LagRule,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LagRule {
    /// Time stamps or row numbers are shifted.
    Stamps,
    /// Forces are interpolated between rows; time stamps stay with the readings.
    BetweenRows,
    /// No correction: the log has no time.
    NotMadeUp,
}

impl fmt::Display for LagMadeUp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lag = self.lag;
        match self.how {
            LagRule::Stamps => {
                let sign = if self.lag.by < 0.0 { '-' } else { '+' };
                let what = match self.lag.time_base {
                    TimeBase::Seconds => "t_s is the time of the readings",
                    TimeBase::Rows => "`row` is the row of the readings, from 0,",
                };
                write!(f, "clock: {what} {sign} {lag}, the lag of the reference")
            }
            LagRule::BetweenRows => {
                write!(
                    f,
                    "clock: forces are moved by {lag}, the lag of the reference, to their rows"
                )
            }
            LagRule::NotMadeUp => {
                write!(f, "it has no time, so forces are off by the lag of the reference, {lag}")
            }
        }
    }
}

/// A time rounded to a microsecond, s.
fn short(time_s: f64) -> f64 {
    (time_s * 1e6).round() / 1e6
}

#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct LoadSummary {
    /// True if inertia was subtracted, too.
    pub has_inertia: bool,
    /// The centrifugal force at 1 rad/s, N, if it is not subtracted; it grows with the square of the rate.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub turning_n: Option<f64>,
    /// Factor on the accelerations, if their unit was not that of the poses.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rescaled: Option<f64>,
    /// The lag found for the clock of the motion, whether or not it was applied.
    pub lag: Option<Lag>,
    /// Part of the lag that was applied, s.
    pub lag_taken_s: Option<f64>,
    /// Number of rows so far from any sample of the motion that their load is not known.
    pub rows_without_motion: u64,
    /// Standard deviation of the remaining wrench, N and N·m.
    #[serde(serialize_with = "by_column")]
    pub standard_deviation: AxisValues<f64>,
    /// Standard deviation of the wrench with the load, before the low-pass, N and N·m.
    #[serde(serialize_with = "by_column")]
    pub standard_deviation_before: AxisValues<f64>,
}

impl LoadSummary {
    /// Standard deviations of the forces with the load and without it, N, root sums of squares over the axes, if they
    /// are larger without it.
    pub fn scatters_more(&self) -> Option<[f64; 2]> {
        let forces = |of: &AxisValues<f64>| {
            let forces = of.iter().filter(|(axis, _)| !axis.is_moment());
            forces.map(|(_, sd)| sd * sd).sum::<f64>().sqrt()
        };
        let [before, after] =
            [&self.standard_deviation_before, &self.standard_deviation].map(forces);
        (after > WORSE * before).then_some([before, after])
    }
}

/// Noise of the orientation makes the forces of a sensor that is held still scatter by a little more.
const WORSE: f64 = 1.05;

fn is_zero(count: &u64) -> bool {
    *count == 0
}

/// Values of one axis over all frames, N or N·m.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct AxisSummary {
    pub min: f64,
    pub mean: f64,
    pub max: f64,
}

#[derive(Default)]
pub(super) struct Totals {
    pub(super) frames: u64,
    pub(super) flagged: [u64; 4],
    pub(super) axes: PerAxis<Option<(f64, f64, f64)>>,
    /// `Some` if a load was subtracted.
    pub(super) scatter: Option<PerAxis<RunningVariance>>,
}

impl Totals {
    /// Adds the wrenches of some frames. The error is the index of the first frame that is not finite.
    pub(super) fn add(&mut self, wrench: &PerAxis<Vec<f64>>) -> Result<(), u64> {
        for (total, column) in self.axes.iter_mut().zip(wrench).filter(|(_, of)| !of.is_empty()) {
            let (min, sum, max) = total.get_or_insert((f64::INFINITY, 0.0, -f64::INFINITY));
            for &value in column {
                *min = min.min(value);
                *max = max.max(value);
                *sum += value;
            }
            if !(min.is_finite() && max.is_finite() && sum.is_finite()) {
                let bad = column.iter().position(|value| !value.is_finite()).unwrap_or(0);
                return Err(self.frames + bad as u64 + 1);
            }
        }
        for (scatter, column) in self.scatter.iter_mut().flatten().zip(wrench) {
            scatter.merge(&RunningVariance::new(column));
        }
        self.frames += wrench[0].len() as u64;
        Ok(())
    }

    pub(super) fn count(&mut self, frames: &ConvertedFrames) {
        for (count, flags) in self.flagged.iter_mut().zip(&frames.flags) {
            *count += flags.iter().filter(|channels| **channels != 0).count() as u64;
        }
    }

    /// The standard deviation; zero if it was not requested.
    pub(super) fn standard_deviation(&self) -> PerAxis<f64> {
        self.scatter.unwrap_or_default().map(|scatter| standard_deviation(&scatter))
    }

    pub(super) fn axes(&self) -> PerAxis<AxisSummary> {
        self.axes.map(|total| {
            let (min, sum, max) = total.unwrap_or_default();
            AxisSummary { min, mean: sum / self.frames.max(1) as f64, max }
        })
    }
}

pub(super) fn standard_deviation(scatter: &RunningVariance) -> f64 {
    if scatter.count == 0 { 0.0 } else { scatter.rms_about_mean() }
}
