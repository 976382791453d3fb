//! Numbers behind a report's interactive plots, for `report.js`. Traces are plotted frame by frame
//! ([`Trace::thinned`]), at some 60 kB per trial; five digits are more than a screen can show.

use std::f64::consts::TAU;

use serde_json::{Value, json};

use super::markup::{capital, figure};
use super::units::ColumnUnit;
use super::{MOST_TRACES, Report};
use figures::trial::{Passage, smoothed, stride_s};
use trial::{ConditionRow, Per, PhaseForce, PhaseProfile, Quantity, Trace, TrialResult};

pub(super) struct Plots {
    /// The plot of effects; empty if no quantity has values.
    pub(super) effects: Vec<Plot>,
    pub(super) boxes: Vec<Plot>,
    pub(super) phases: Vec<Plot>,
    /// The numbers of each trial, `null` without a trace.
    pub(super) trials: Vec<Value>,
}

pub(super) struct Plot {
    numbers: Value,
    pub(super) alt: String,
    pub(super) caption: String,
}

/// A number in five digits; `null` if it is not finite.
fn short(value: f64) -> Value {
    let digits = 4 - value.abs().max(1e-9).log10().floor() as i32;
    let factor = 10_f64.powi(digits.clamp(-12, 12));
    json!((value * factor).round() / factor)
}

impl Plots {
    pub(super) fn new(report: &Report<'_>) -> Self {
        let drawn = |(at, trial): (usize, &TrialResult)| {
            let trace =
                trial.trace.as_ref().filter(|trace| at < MOST_TRACES && !trace.t_s.is_empty());
            let window = [trial.row.t_enter_s, trial.row.t_exit_s];
            let passage = Passage::new(window, report.robot_length_m, report.channel_length_m);
            trace.map_or(Value::Null, |trace| of_trial(trace, &passage))
        };
        Self {
            effects: effect(report).into_iter().collect(),
            boxes: boxes(report),
            phases: phases(report),
            trials: report.trials.iter().enumerate().map(drawn).collect(),
        }
    }

    pub(super) fn json(&self) -> String {
        let [effects, boxes, phases] = [&self.effects, &self.boxes, &self.phases]
            .map(|plots| plots.iter().map(|plot| &plot.numbers).collect::<Vec<_>>());
        let trials = &self.trials;
        json!({ "effects": effects, "boxes": boxes, "phases": phases, "trials": trials })
            .to_string()
    }
}

/// Means with confidence intervals, of the conditions or of their differences from the reference,
/// in drag energy or, without it, the first quantity available.
fn effect(report: &Report<'_>) -> Option<Plot> {
    let mut found = Quantity::COMPARED.into_iter().map(|of| (of, report.of(of, Per::Trial)));
    let (quantity, rows) = found.find(|(_, rows)| !rows.is_empty())?;
    let reference = rows.iter().find_map(|row| Some(&row.difference.as_ref()?.reference));
    let of = |row: &ConditionRow| match (reference, &row.difference) {
        (None, _) => Some((row.statistics.mean, row.statistics.mean_95)),
        (Some(_), less) => less.as_ref().map(|less| (less.mean, less.mean_95)),
    };
    let means = rows.iter().filter_map(|row| Some(of(row)?.0));
    let scale = ColumnUnit::new(quantity.unit(), means);
    let scaled = |value: f64| short(scale.factor * value);
    let (mut conditions, mut texts) = (Vec::new(), Vec::new());
    for row in rows {
        let Some((mean, interval)) = of(row) else { continue };
        let text =
            format!("{} {} {}", row.condition, scale.estimate(Some(mean), interval), scale.unit);
        let text = text.trim_end().to_owned();
        conditions.push(json!({
            "name": row.condition,
            "trials": row.statistics.n,
            "mean": scaled(mean),
            "low": interval.map(|interval| scaled(interval.low)),
            "high": interval.map(|interval| scaled(interval.high)),
            "text": text,
        }));
        texts.push(text);
    }
    let name = quantity.name();
    let caption = match reference {
        Some(reference) => format!(
            "{} per trial less that of {reference}: mean and 95 % interval; zero is no effect",
            capital(name)
        ),
        None => format!("{} per trial: mean and 95 % interval", capital(name)),
    };
    let numbers = json!({
        "quantity": name, "unit": scale.unit, "reference": reference, "conditions": conditions,
    });
    Some(Plot { numbers, alt: format!("{caption}: {}", texts.join("; ")), caption })
}

fn boxes(report: &Report<'_>) -> Vec<Plot> {
    let plots = Quantity::COMPARED.into_iter().flat_map(|of| Per::ALL.map(|per| (of, per)));
    let plot = |(quantity, per): (Quantity, Per)| {
        let rows = report.of(quantity, per);
        let ends = rows.iter().map(|row| &row.statistics);
        let ends = ends.flat_map(|statistics| [statistics.whisker_low, statistics.whisker_high]);
        let ColumnUnit { factor, unit } = ColumnUnit::new(quantity.unit(), ends);
        let scaled = |value: f64| short(factor * value);
        let (mut conditions, mut medians) = (Vec::new(), Vec::new());
        for ConditionRow { condition, statistics: s, .. } in &rows {
            let (values, labels) = values(report.trials, condition, quantity, per);
            medians.push(format!("{condition} {}", figure(factor * s.median)));
            conditions.push(json!({
                "name": condition,
                "q1": scaled(s.q1),
                "median": scaled(s.median),
                "q3": scaled(s.q3),
                "low": scaled(s.whisker_low),
                "high": scaled(s.whisker_high),
                "mean": scaled(s.mean),
                "values": values.into_iter().map(scaled).collect::<Vec<_>>(),
                "labels": labels,
            }));
        }
        let (name, per_name, medians) = (quantity.name(), per.name(), medians.join(", "));
        let in_unit = if unit.is_empty() { String::new() } else { format!(" in {unit}") };
        let plot = Plot {
            alt: format!(
                "Box plot of {name} per {per_name} by condition; medians{in_unit}: {medians}"
            ),
            caption: format!("{} per {per_name}", capital(name)),
            numbers: json!({ "quantity": name, "unit": unit, "per": per, "conditions": conditions }),
        };
        (!rows.is_empty()).then_some(plot)
    };
    plots.filter_map(plot).collect()
}

fn values<'a>(
    trials: &'a [TrialResult],
    condition: &str,
    quantity: Quantity,
    per: Per,
) -> (Vec<f64>, Vec<String>) {
    let of_condition = trials.iter().filter(|trial| trial.row.condition == condition);
    let of_trial = |TrialResult { row, .. }: &'a TrialResult| {
        Some((quantity.of(&row.measures)?, row.file.clone()))
    };
    let of_strides = |TrialResult { row, stride_rows, .. }: &'a TrialResult| {
        stride_rows.iter().filter_map(move |stride| {
            let label = format!("{}, stride {}", row.file, stride.stride);
            Some((quantity.of(&stride.measures)?, label))
        })
    };
    match per {
        Per::Trial => of_condition.filter_map(of_trial).unzip(),
        Per::Stride => of_condition.flat_map(of_strides).unzip(),
    }
}

fn phases(report: &Report<'_>) -> Vec<Plot> {
    if report.phases.is_empty() {
        return Vec::new();
    }
    let column = |values: &[f64]| values.iter().map(|&value| short(value)).collect::<Vec<_>>();
    let strides = report.phases.iter().map(|(name, of)| format!("{name} {} strides", of.strides));
    let strides = strides.collect::<Vec<_>>().join(", ");
    let plot = |quantity: &str, force: fn(&PhaseProfile) -> &PhaseForce| {
        let condition = |(name, profile): &(String, PhaseProfile)| {
            json!({
                "name": name,
                "strides": profile.strides,
                "phase_rad": column(&profile.phase_rad),
                "mean": column(&force(profile).mean_n),
                "sd": column(&force(profile).sd_n),
            })
        };
        let conditions: Vec<Value> = report.phases.iter().map(condition).collect();
        let name = capital(quantity);
        Plot {
            numbers: json!({ "quantity": quantity, "conditions": conditions }),
            alt: format!("{name} in N over a turn of the right leg: {strides}"),
            caption: format!(
                "{name} against the right leg's angle while the robot is fully inside: mean over strides, with \
                 one standard deviation from stride to stride"
            ),
        }
    };
    vec![plot("drag", |profile| &profile.drag), plot("lift", |profile| &profile.lift)]
}

fn of_trial(trace: &Trace, passage: &Passage) -> Value {
    let at = |column: &[f64], of: fn(f64) -> f64| -> Option<Vec<Value>> {
        (!column.is_empty()).then(|| column.iter().map(|&value| short(of(value))).collect())
    };
    let (same, negated) = (|value: f64| value, |value: f64| -value);
    let within_a_turn = |angle: f64| angle.rem_euclid(TAU);
    let stride_mean = |column: &[f64], of| {
        let width_s = stride_s(trace).filter(|_| !column.is_empty())?;
        at(&smoothed(&trace.t_s, column, width_s), of)
    };
    let [fx, fy, fz, ..] = &trace.wrench;
    json!({
        "t_s": at(&trace.t_s, same),
        // Drag is −Fx, and lift is Fz.
        "drag_n": at(fx, negated),
        "lift_n": at(fz, same),
        "drag_stride_n": stride_mean(fx, negated),
        "lift_stride_n": stride_mean(fz, same),
        "fy_n": at(fy, same),
        "right_leg_rad": at(&trace.right_leg_rad, within_a_turn),
        "left_leg_rad": at(&trace.left_leg_rad, within_a_turn),
        "right_power_w": at(&trace.right_power_w, same),
        "left_power_w": at(&trace.left_power_w, same),
        // The power of both motors together, if the log has no separate columns.
        "power_w": at(&trace.power_w, same),
        "partly": passage.partly_s,
        "wholly": passage.wholly_s,
    })
}
