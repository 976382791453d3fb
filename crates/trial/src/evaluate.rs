//! The results of one trial.
//!
//! ```text
//! drag energy             E = mean(Fx)·l
//! of a stride             mean(Fx)·v̄·T
//! electrical energy       ∫ (P_left + P_right) dt
//! specific resistance     η = P̄/(m·g·v̄),   v̄ = l/(t_exit − t_enter) unless given
//! ```

use std::ops::Range;

use super::diagnostic::Diagnostic;
use super::error::{FEWEST_PERIODS, TrialError};
use super::input::{LogTimes, TraceExtent, Trial, TrialInput};
use super::integral::{Span, rows_within};
use super::leg::Strides;
use super::profile::Profile;
use super::results::{Quantity, RunMeasures, StrideRow, TrialResult, TrialRow};
use super::signals::{Signals, count_fresh};
use super::statistics::Interval;
use super::uncertainty::{ForceUncertainty, of_means};
use shell_data::wrench::Axis;

/// Evaluates a trial on the rows around its window.
///
/// # Errors
/// [`TrialError`] for a window outside the log, an invalid number, or nothing to compute.
pub fn evaluate(input: &TrialInput<'_>) -> Result<TrialResult, TrialError> {
    let TrialInput { trial, rows, options, .. } = *input;
    check_window(trial, input.times)?;
    let [channel_length_m, velocity_m_s, weight_power_w] = terms(trial, input.instrument.profile)?;
    let (enter, exit) = (trial.t_enter_s, trial.t_exit_s);
    let span = Span::new(options.forces.rule, &rows.times_s, enter, exit);
    let span = span.ok_or(TrialError::Gap { enter, exit })?;
    let window = rows_within(&rows.times_s, enter, exit);
    let mut diagnostics: Vec<Diagnostic> =
        trial.notes.iter().map(|notes| Diagnostic::note("manifest", notes)).collect();
    diagnostics.extend(diagnose_terms(trial, input.instrument.profile));
    let signals = Signals::new(input, window.clone(), &mut diagnostics)?;
    let evaluation =
        TrialEvaluation { input, channel_length_m, velocity_m_s, weight_power_w, window, signals };
    let forces = evaluation.signals.forces.as_ref();
    let Signals { is_beyond, is_stuck, .. } = evaluation.signals;
    let uncertainty = forces.and_then(|forces| of_means(input, forces, &span));
    if is_beyond {
        let text = "most frames are outside the calibrated range, where nothing is known of errors: intervals are left \
                    out";
        diagnostics.push(Diagnostic::warning("no_intervals", text));
    } else if is_stuck {
        let text = "a channel stands still, whose error is not known: intervals are left out";
        diagnostics.push(Diagnostic::warning("no_intervals", text));
    } else if forces.is_some() && uncertainty.is_none() {
        let text = "the calibration does not know its errors: intervals are left out";
        diagnostics.push(Diagnostic::note("no_intervals", text));
    }
    let row = evaluation.trial_row(&span, uncertainty.filter(|_| !is_beyond && !is_stuck));
    if let Some(energy) = row.measures.electrical_energy_j.filter(|energy| *energy < 0.0) {
        let text = format!(
            "the electrical energy is negative, {energy:.3} J: check the sign of the current, and for readings such \
             as -9999 that stand for no value"
        );
        diagnostics.push(Diagnostic::warning("negative_energy", text));
    }
    let is_wrong = |of: &Quantity| of.of(&row.measures).is_some_and(|value| !value.is_finite());
    if let Some(wrong) = Quantity::ALL.into_iter().find(is_wrong) {
        return Err(TrialError::NotFinite(wrong.name()));
    }
    let spans = evaluation.signals.strides.iter().flat_map(Strides::spans);
    let stride_rows = (1..).zip(spans).map(|(k, span)| evaluation.stride_row(k, span)).collect();
    let whole = || evaluation.signals.into_trace(rows);
    let trace = match options.trace {
        TraceExtent::Nothing => None,
        TraceExtent::Window => Some(whole().within(enter, exit)),
        TraceExtent::Log => Some(whole()),
    };
    Ok(TrialResult { row, stride_rows, diagnostics, trace, phase: None })
}

/// # Errors
/// [`TrialError::ExitBeforeEntry`], [`TrialError::OutsideLog`], [`TrialError::Short`].
pub fn check_window(trial: &Trial, times: &LogTimes) -> Result<(), TrialError> {
    let (enter, exit) = (trial.t_enter_s, trial.t_exit_s);
    if enter.is_nan() || exit.is_nan() || exit <= enter {
        return Err(TrialError::ExitBeforeEntry { enter, exit });
    }
    let LogTimes { first_s: first, last_s: last, period_s: period } = *times;
    if enter < first || exit > last {
        return Err(TrialError::OutsideLog { enter, exit, first, last });
    }
    if exit - enter < FEWEST_PERIODS * period {
        return Err(TrialError::Short { enter, exit, period });
    }
    Ok(())
}

/// Length of the channel, m, mean velocity, m/s, and m·g·v̄, W: the trial's or else the profile's.
fn terms(trial: &Trial, profile: &Profile) -> Result<[f64; 3], TrialError> {
    let positive = |what, value: f64| match value > 0.0 && value.is_finite() {
        true => Ok(value),
        false => Err(TrialError::NotPositive { what, value }),
    };
    let length = trial.channel_length_m.unwrap_or(profile.channel.length_m);
    let length = positive("the channel length, m,", length)?;
    let mass = positive("the mass, kg,", trial.mass_kg.unwrap_or(profile.robot.mass_kg))?;
    let mean = length / (trial.t_exit_s - trial.t_enter_s);
    let velocity = positive("the velocity, m/s,", trial.velocity_m_s.unwrap_or(mean))?;
    Ok([length, velocity, mass * profile.robot.gravity_m_s2 * velocity])
}

/// Reports numbers of the manifest that probably have another unit.
fn diagnose_terms(trial: &Trial, profile: &Profile) -> impl Iterator<Item = Diagnostic> {
    /// Larger than what robots and channels differ by, smaller than the step from cm or g to the next unit.
    const MOST: f64 = 5.0;
    let length = trial.channel_length_m.unwrap_or(profile.channel.length_m);
    let mean = length / (trial.t_exit_s - trial.t_enter_s);
    let (robot, channel) = (profile.robot, profile.channel);
    [
        (
            ("velocity_unit", "velocity", "m/s"),
            (trial.velocity_m_s, mean),
            "channel length over the time in it",
        ),
        (("mass_unit", "mass", "kg"), (trial.mass_kg, robot.mass_kg), "mass in the profile"),
        (
            ("length_unit", "channel length", "m"),
            (trial.channel_length_m, channel.length_m),
            "length in the profile",
        ),
    ]
    .into_iter()
    .filter_map(|((code, what, unit), (value, usual), of)| {
        let value = value.filter(|value| !(1.0 / MOST..=MOST).contains(&(value / usual)))?;
        let text = format!(
            "the {what} is {value} {unit} in the manifest, but the {of} is {usual:.4} {unit}: check its unit"
        );
        Some(Diagnostic::warning(code, text))
    })
}

struct TrialEvaluation<'a> {
    input: &'a TrialInput<'a>,
    channel_length_m: f64,
    velocity_m_s: f64,
    weight_power_w: f64,
    window: Range<usize>,
    signals: Signals,
}

impl TrialEvaluation<'_> {
    fn measures(&self, span: &Span, time_s: f64, energy: impl Fn(f64) -> f64) -> RunMeasures {
        let forces = self.signals.forces.as_ref();
        let mean = |axis: Axis| forces.map(|forces| span.mean(&forces.wrench[axis.index()]));
        let fx_n = mean(Axis::Fx);
        let power = self.signals.power.as_ref();
        let electrical_energy_j = power.map(|power| span.integral(&power.total_w));
        let mean_power_w = electrical_energy_j.map(|energy| energy / time_s);
        RunMeasures {
            drag_mean_n: fx_n.map(|fx| -fx),
            lift_mean_n: mean(Axis::Fz),
            drag_energy_j: fx_n.map(energy),
            electrical_energy_j,
            mean_power_w,
            specific_resistance: mean_power_w.map(|power| power / self.weight_power_w),
        }
    }

    fn trial_row(&self, span: &Span, uncertainty: Option<ForceUncertainty>) -> TrialRow {
        let TrialInput { trial, rows, .. } = *self.input;
        let (enter, exit) = (trial.t_enter_s, trial.t_exit_s);
        let length_m = self.channel_length_m;
        let measures = self.measures(span, exit - enter, |fx| fx * length_m);
        let about = |value: Option<f64>, factor: f64, axis: Axis| {
            let half = uncertainty.as_ref()?.half_widths[axis.index()] * factor;
            let value = value?;
            Some(Interval { low: value - half, high: value + half })
        };
        let strides = self.signals.strides.as_ref();
        let has_forces = self.signals.forces.is_some();
        TrialRow {
            file: trial.file.clone(),
            condition: trial.condition.clone(),
            t_enter_s: enter,
            t_exit_s: exit,
            duration_s: exit - enter,
            velocity_m_s: self.velocity_m_s,
            rows: self.window.len() as u64,
            fresh_frames: has_forces.then(|| count_fresh(rows, self.window.clone())),
            drag_energy_95_j: about(measures.drag_energy_j, length_m, Axis::Fx),
            drag_mean_95_n: about(measures.drag_mean_n, 1.0, Axis::Fx),
            lift_mean_95_n: about(measures.lift_mean_n, 1.0, Axis::Fz),
            measures,
            strides: strides.map(|strides| strides.count() as u64),
            stride_frequency_hz: strides.and_then(Strides::frequency_hz),
            channel_length_m: length_m,
            has_unknown_error: self.signals.is_beyond || self.signals.is_stuck,
            uncertainty,
        }
    }

    fn stride_row(&self, stride: u64, (start, end): (f64, f64)) -> StrideRow {
        let times = &self.input.rows.times_s;
        let span = Span::new(self.input.options.forces.rule, times, start, end);
        let period_s = end - start;
        let energy = |fx: f64| fx * self.velocity_m_s * period_s;
        let measures = span.map(|span| self.measures(&span, period_s, energy));
        StrideRow {
            stride,
            t_start_s: start,
            t_end_s: end,
            period_s,
            rows: rows_within(times, start, end).len() as u64,
            measures: measures.unwrap_or_default(),
        }
    }
}
