//! The results of one trial.
//!
//! ```text
//! drag energy             E = mean(Fx)·l
//! of a stride             mean(Fx)·v̄·T
//! electrical energy       ∫ (P_left + P_right) dt
//! specific resistance     η = P̄/(m·g·v̄),   v̄ = l/(t_exit − t_enter) unless given
//! ```

use super::error::TrialError;
use super::forces::Forces;
use super::integral::{Span, rows_within};
use super::leg::{Strides, unwrap};
use super::observe::{count_fresh, remark_frames, remark_legs, remark_rows, remark_tare};
use super::options::{TraceExtent, TrialOptions};
use super::power::Power;
use super::profile::Profile;
use super::remark::Remark;
use super::results::{StrideRow, Trace, TrialResult, TrialRow};
use super::statistics::Interval;
use super::stretch::{Clock, Stretch};
use super::subject::Trial;
use super::tare::TareFrames;
use super::uncertainty::half_widths;
use calibration::Calibration;
use shell_data::telemetry::Telemetry;
use shell_data::wrench::{Axis, PerAxis};

/// A trial with its overrides filled in.
struct Terms {
    velocity_m_s: f64,
    channel_length_m: f64,
    /// m·g·v̄, W.
    weight_power_w: f64,
}

/// Evaluates a trial on the rows around its window; `calibration` and `tare` are `None` where there
/// are no forces.
///
/// # Errors
/// [`TrialError`] if the window is not within the log, a number of the trial cannot be, or nothing
/// can be computed at all.
pub fn evaluate(
    trial: &Trial,
    profile: &Profile,
    calibration: Option<&Calibration>,
    clock: &Clock,
    tare: Option<&TareFrames>,
    stretch: &Stretch,
    options: &TrialOptions,
) -> Result<TrialResult, TrialError> {
    check_window(trial, clock)?;
    let terms = Terms::new(trial, profile)?;
    let times = &stretch.times_s;
    let (enter, exit) = (trial.t_enter_s, trial.t_exit_s);
    let span_of = |from, to| Span::new(options.rule, times, from, to);
    let span = span_of(enter, exit).ok_or(TrialError::Gap { enter, exit })?;
    let mut remarks: Vec<Remark> = trial.notes.iter().cloned().map(Remark::Manifest).collect();
    let window = rows_within(times, enter, exit);

    let forces = find_forces(calibration, clock, tare, stretch, options, &mut remarks)?;
    let power = find_power(profile, stretch, window.clone(), &mut remarks);
    if forces.is_none() && power.is_none() {
        let reasons: Vec<String> = remarks.iter().map(Remark::to_string).collect();
        return Err(TrialError::Nothing(reasons.join("; ")));
    }
    let leg = |kind| {
        let counts = stretch.telemetry(kind)?;
        Some(unwrap(times, counts, profile.telemetry.leg_rad_per_count))
    };
    let right_leg = leg(Telemetry::RightLeg);
    let strides = right_leg.as_ref().map(|angle| Strides::new(times, angle, enter, exit));
    remark_rows(stretch, window.clone(), clock, options, &mut remarks);
    if let Some(tare) = tare.filter(|_| forces.is_some()) {
        remark_tare(tare, profile, enter, &mut remarks);
    }
    remark_frames(calibration, forces.as_ref(), window.clone(), options, &mut remarks);
    remark_legs(strides.as_ref(), &mut remarks);

    let total_w = power.as_ref().map(Power::total_w);
    let of_span = |span: &Span| Means::new(span, times, forces.as_ref(), total_w.as_deref());
    let means = of_span(&span);
    let half_widths = forces.as_ref().and_then(|forces| {
        let (calibration, axes) = (calibration?, [Axis::Fx, Axis::Fz]);
        let tare = tare.zip(forces.tare.as_ref());
        half_widths(calibration, tare, forces, &span, &axes, options)
    });
    if forces.is_some() && half_widths.is_none() {
        remarks.push(Remark::NoIntervals);
    }
    let about = |value: Option<f64>, factor: f64, axis: Axis| {
        let (value, half) = (value?, half_widths?[axis.index()] * factor);
        Some(Interval { low: value - half, high: value + half })
    };
    let (drag, lift) = (means.fx_n.map(|fx| -fx), means.fz_n);
    let drag_energy = means.fx_n.map(|fx| fx * terms.channel_length_m);
    let mean_power = means.energy_j.map(|energy| energy / (exit - enter));
    let row = TrialRow {
        file: trial.file.clone(),
        condition: trial.condition.clone(),
        t_enter_s: enter,
        t_exit_s: exit,
        duration_s: exit - enter,
        velocity_m_s: terms.velocity_m_s,
        rows: window.len() as u64,
        fresh_frames: forces.is_some().then(|| count_fresh(stretch, window.clone())),
        drag_mean_n: drag,
        lift_mean_n: lift,
        drag_energy_j: drag_energy,
        drag_energy_95_j: about(drag_energy, terms.channel_length_m, Axis::Fx),
        drag_mean_95_n: about(drag, 1.0, Axis::Fx),
        lift_mean_95_n: about(lift, 1.0, Axis::Fz),
        electrical_energy_j: means.energy_j,
        mean_power_w: mean_power,
        specific_resistance: mean_power.map(|power| power / terms.weight_power_w),
        strides: strides.as_ref().map(|strides| strides.count() as u64),
        stride_frequency_hz: strides.as_ref().and_then(Strides::frequency_hz),
    };
    check_finite(&row)?;
    let spans = strides.iter().flat_map(Strides::spans).enumerate();
    let stride_rows = spans.map(|(number, (start, end))| {
        let means = span_of(start, end).map(|span| of_span(&span)).unwrap_or_default();
        let period = end - start;
        let mean_power = means.energy_j.map(|energy| energy / period);
        StrideRow {
            stride: number as u64 + 1,
            t_start_s: start,
            t_end_s: end,
            period_s: period,
            rows: rows_within(times, start, end).len() as u64,
            drag_mean_n: means.fx_n.map(|fx| -fx),
            lift_mean_n: means.fz_n,
            drag_energy_j: means.fx_n.map(|fx| fx * terms.velocity_m_s * period),
            electrical_energy_j: means.energy_j,
            mean_power_w: mean_power,
            specific_resistance: mean_power.map(|power| power / terms.weight_power_w),
        }
    });
    let stride_rows = stride_rows.collect();
    let trace = (options.trace != TraceExtent::Nothing).then(|| {
        let rows = match options.trace {
            TraceExtent::Log => 0..times.len(),
            _ => window,
        };
        let cut = |column: &[f64]| column.get(rows.clone()).unwrap_or_default().to_vec();
        Trace {
            t_s: cut(times),
            wrench: forces.as_ref().map_or_else(PerAxis::default, |forces| {
                forces.wrench.each_ref().map(|axis| cut(axis))
            }),
            fresh: stretch.fresh.get(rows.clone()).unwrap_or_default().to_vec(),
            right_leg_rad: cut(right_leg.as_deref().unwrap_or_default()),
            left_leg_rad: cut(leg(Telemetry::LeftLeg).as_deref().unwrap_or_default()),
            right_power_w: cut(power.as_ref().map_or(&[], |power| &power.right_w)),
            left_power_w: cut(power.as_ref().map_or(&[], |power| &power.left_w)),
            stride_times_s: strides.as_ref().map_or_else(Vec::new, |s| s.times_s.clone()),
        }
    });
    Ok(TrialResult { row, stride_rows, remarks, trace, phase: None })
}

/// Checks the window of a trial against the clock of its log.
///
/// # Errors
/// [`TrialError::ExitBeforeEntry`], [`TrialError::OutsideLog`].
pub fn check_window(trial: &Trial, clock: &Clock) -> Result<(), TrialError> {
    let (enter, exit) = (trial.t_enter_s, trial.t_exit_s);
    if enter.is_nan() || exit.is_nan() || exit <= enter {
        return Err(TrialError::ExitBeforeEntry { enter, exit });
    }
    let Clock { first_s: first, last_s: last, .. } = *clock;
    if enter < first || exit > last {
        return Err(TrialError::OutsideLog { enter, exit, first, last });
    }
    Ok(())
}

impl Terms {
    fn new(trial: &Trial, profile: &Profile) -> Result<Self, TrialError> {
        let positive = |what, value: f64| match value > 0.0 && value.is_finite() {
            true => Ok(value),
            false => Err(TrialError::NotPositive { what, value }),
        };
        let length = trial.channel_length_m.unwrap_or(profile.channel.length_m);
        let length = positive("the channel length, m,", length)?;
        let mass = positive("the mass, kg,", trial.mass_kg.unwrap_or(profile.robot.mass_kg))?;
        let mean = length / (trial.t_exit_s - trial.t_enter_s);
        let velocity = positive("the velocity, m/s,", trial.velocity_m_s.unwrap_or(mean))?;
        let weight_power_w = mass * profile.robot.gravity_m_s2 * velocity;
        Ok(Self { velocity_m_s: velocity, channel_length_m: length, weight_power_w })
    }
}

/// What is integrated over a span.
#[derive(Default)]
struct Means {
    fx_n: Option<f64>,
    fz_n: Option<f64>,
    energy_j: Option<f64>,
}

impl Means {
    fn new(span: &Span, times: &[f64], forces: Option<&Forces>, total_w: Option<&[f64]>) -> Self {
        let mean = |axis: Axis| forces.map(|forces| span.mean(&forces.wrench[axis.index()]));
        let energy_j = total_w.map(|power| span.integral(times, power));
        Self { fx_n: mean(Axis::Fx), fz_n: mean(Axis::Fz), energy_j }
    }
}

fn find_forces(
    calibration: Option<&Calibration>,
    clock: &Clock,
    tare: Option<&TareFrames>,
    stretch: &Stretch,
    options: &TrialOptions,
    remarks: &mut Vec<Remark>,
) -> Result<Option<Forces>, TrialError> {
    let found = stretch.readings.len();
    let Some(calibration) = calibration else {
        remarks.push(Remark::NoCalibration);
        return Ok(None);
    };
    if found == 0 {
        remarks.push(Remark::NoSensors);
        return Ok(None);
    }
    let expected = calibration.model().channels;
    if found != expected {
        return Err(TrialError::Channels { expected, found });
    }
    // Results need two axes; traces show all.
    let axes: &[Axis] = match options.trace {
        TraceExtent::Nothing => &[Axis::Fx, Axis::Fz],
        TraceExtent::Window | TraceExtent::Log => &Axis::ALL,
    };
    Forces::new(stretch, calibration, tare, axes, clock, options).map(Some)
}

fn find_power(
    profile: &Profile,
    stretch: &Stretch,
    window: std::ops::Range<usize>,
    remarks: &mut Vec<Remark>,
) -> Option<Power> {
    let power = Power::new(stretch, profile).map_err(|missing| Remark::NoPower { missing });
    let power = power.map_err(|remark| remarks.push(remark)).ok()?;
    let battery = &stretch.telemetry(Telemetry::Battery)?[window];
    let empty = battery.iter().filter(|&&counts| counts <= 0.0).count() as u64;
    if empty > 0 {
        remarks.push(Remark::NoBattery { rows: empty, of: battery.len() as u64 });
        return None;
    }
    Some(power)
}

fn check_finite(row: &TrialRow) -> Result<(), TrialError> {
    let values = [
        ("the mean drag", row.drag_mean_n),
        ("the mean lift", row.lift_mean_n),
        ("the electrical energy", row.electrical_energy_j),
        ("the specific resistance", row.specific_resistance),
    ];
    match values.into_iter().find(|(_, value)| value.is_some_and(|value| !value.is_finite())) {
        Some((what, _)) => Err(TrialError::NotFinite { what }),
        None => Ok(()),
    }
}
