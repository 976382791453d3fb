//! The numbers behind a report's interactive plots.
//!
//! Traces are shown frame by frame ([`Trace::thinned`]), some 60 kB a trial. Numbers have five digits:
//! more than a screen shows.

use std::f64::consts::TAU;

use serde::{Serialize, Serializer};

use super::units::ColumnUnit;
use super::{MOST_TRACES, Report};
use figures::trial::{Passage, smoothed, stride_s};
use trial::{ConditionRow, Per, PhaseForce, PhaseProfile, Quantity, Trace, TrialResult};

#[derive(Serialize)]
pub(super) struct ReportNumbers {
    /// One at most.
    pub(super) effects: Vec<EffectPlot>,
    pub(super) boxes: Vec<BoxPlot>,
    pub(super) phases: Vec<PhasePlot>,
    /// One for each trial, `null` where there is no trace.
    pub(super) trials: Vec<Option<TrialPlot>>,
}

/// Means with their intervals, of the conditions or of how they differ from the reference.
#[derive(Serialize)]
pub(super) struct EffectPlot {
    pub(super) quantity: &'static str,
    pub(super) unit: String,
    pub(super) reference: Option<String>,
    pub(super) conditions: Vec<EffectNumbers>,
}

#[derive(Serialize)]
pub(super) struct EffectNumbers {
    pub(super) name: String,
    trials: usize,
    mean: Short,
    low: Option<Short>,
    high: Option<Short>,
    /// The same for people.
    pub(super) text: String,
}

#[derive(Serialize)]
pub(super) struct BoxPlot {
    pub(super) quantity: &'static str,
    pub(super) unit: String,
    pub(super) per: Per,
    pub(super) conditions: Vec<BoxNumbers>,
}

#[derive(Serialize)]
pub(super) struct BoxNumbers {
    pub(super) name: String,
    q1: Short,
    pub(super) median: Short,
    q3: Short,
    low: Short,
    high: Short,
    mean: Short,
    values: Vec<Short>,
    /// What each value is of.
    labels: Vec<String>,
}

#[derive(Serialize)]
pub(super) struct PhasePlot {
    pub(super) quantity: &'static str,
    pub(super) conditions: Vec<PhaseNumbers>,
}

#[derive(Serialize)]
pub(super) struct PhaseNumbers {
    pub(super) name: String,
    pub(super) strides: usize,
    phase_rad: Vec<Short>,
    mean: Vec<Short>,
    sd: Vec<Short>,
}

#[derive(Serialize)]
pub(super) struct TrialPlot {
    t_s: Vec<Short>,
    pub(super) drag_n: Option<Vec<Short>>,
    lift_n: Option<Vec<Short>>,
    drag_stride_n: Option<Vec<Short>>,
    lift_stride_n: Option<Vec<Short>>,
    /// Fx is the drag turned round, and Fz the lift.
    fy_n: Option<Vec<Short>>,
    right_leg_rad: Option<Vec<Short>>,
    left_leg_rad: Option<Vec<Short>>,
    right_power_w: Option<Vec<Short>>,
    left_power_w: Option<Vec<Short>>,
    /// Of both motors together, where the log has no more.
    power_w: Option<Vec<Short>>,
    partly: Vec<[f64; 2]>,
    wholly: Option<[f64; 2]>,
}

/// A number in five digits; `null` if it is not finite.
#[derive(Clone, Copy, Debug)]
pub(super) struct Short(pub(super) f64);

impl Serialize for Short {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if !self.0.is_finite() {
            return serializer.serialize_none();
        }
        let digits = 4 - self.0.abs().max(1e-9).log10().floor() as i32;
        let factor = 10_f64.powi(digits.clamp(-12, 12));
        serializer.serialize_f64((self.0 * factor).round() / factor)
    }
}

impl ReportNumbers {
    pub(super) fn new(report: &Report<'_>) -> Self {
        let drawn = |(at, trial): (usize, &TrialResult)| {
            let trace =
                trial.trace.as_ref().filter(|trace| at < MOST_TRACES && !trace.t_s.is_empty())?;
            let window = [trial.row.t_enter_s, trial.row.t_exit_s];
            let passage = Passage::new(window, report.robot_length_m, report.channel_length_m);
            Some(TrialPlot::new(trace, &passage))
        };
        Self {
            effects: effect(report).into_iter().collect(),
            boxes: boxes(report),
            phases: phases(report),
            trials: report.trials.iter().enumerate().map(drawn).collect(),
        }
    }
}

/// Of drag energy or, without it, of the first quantity that there is.
fn effect(report: &Report<'_>) -> Option<EffectPlot> {
    let mut found = Quantity::COMPARED.into_iter().map(|of| (of, report.of(of, Per::Trial)));
    let (quantity, rows) = found.find(|(_, rows)| !rows.is_empty())?;
    let reference = rows.iter().find_map(|row| Some(row.difference.as_ref()?.reference.clone()));
    let of = |row: &ConditionRow| match (&reference, &row.difference) {
        (None, _) => Some((row.statistics.mean, row.statistics.mean_95)),
        (Some(_), less) => less.as_ref().map(|less| (less.mean, less.mean_95)),
    };
    let means = rows.iter().filter_map(|row| Some(of(row)?.0));
    let scale = ColumnUnit::new(quantity.unit(), means);
    let numbers = |row: &&ConditionRow| {
        let (mean, interval) = of(row)?;
        let scaled = |value: f64| Short(scale.factor * value);
        let estimate = scale.estimate(Some(mean), interval);
        let text = format!("{} {estimate} {}", row.condition, scale.unit);
        Some(EffectNumbers {
            name: row.condition.clone(),
            trials: row.statistics.n,
            mean: scaled(mean),
            low: interval.map(|interval| scaled(interval.low)),
            high: interval.map(|interval| scaled(interval.high)),
            text: text.trim_end().to_owned(),
        })
    };
    let conditions = rows.iter().filter_map(numbers).collect();
    Some(EffectPlot { quantity: quantity.name(), unit: scale.unit.clone(), reference, conditions })
}

fn boxes(report: &Report<'_>) -> Vec<BoxPlot> {
    let plots = Quantity::COMPARED.into_iter().flat_map(|of| Per::ALL.map(|per| (of, per)));
    let plot = |(quantity, per): (Quantity, Per)| {
        let rows = report.of(quantity, per);
        let ends = rows.iter().map(|row| &row.statistics);
        let ends = ends.flat_map(|statistics| [statistics.whisker_low, statistics.whisker_high]);
        let ColumnUnit { factor, unit } = ColumnUnit::new(quantity.unit(), ends);
        let scaled = |value: f64| Short(factor * value);
        let numbers = |row: &&ConditionRow| {
            let (s, name) = (&row.statistics, row.condition.clone());
            let (values, labels) = values(report.trials, &name, quantity, per);
            BoxNumbers {
                name,
                q1: scaled(s.q1),
                median: scaled(s.median),
                q3: scaled(s.q3),
                low: scaled(s.whisker_low),
                high: scaled(s.whisker_high),
                mean: scaled(s.mean),
                values: values.into_iter().map(scaled).collect(),
                labels,
            }
        };
        let conditions = rows.iter().map(numbers).collect();
        BoxPlot { quantity: quantity.name(), unit, per, conditions }
    };
    plots.map(plot).filter(|plot| !plot.conditions.is_empty()).collect()
}

/// The values behind a box, and what each is of.
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

fn phases(report: &Report<'_>) -> Vec<PhasePlot> {
    if report.phases.is_empty() {
        return Vec::new();
    }
    let short = |values: &[f64]| values.iter().map(|&value| Short(value)).collect();
    let plot = |quantity, force: fn(&PhaseProfile) -> &PhaseForce| PhasePlot {
        quantity,
        conditions: (report.phases.iter())
            .map(|(name, profile)| PhaseNumbers {
                name: name.clone(),
                strides: profile.strides,
                phase_rad: short(&profile.phase_rad),
                mean: short(&force(profile).mean_n),
                sd: short(&force(profile).sd_n),
            })
            .collect(),
    };
    vec![plot("drag", |profile| &profile.drag), plot("lift", |profile| &profile.lift)]
}

impl TrialPlot {
    fn new(trace: &Trace, passage: &Passage) -> Self {
        let at = |column: &[f64], of: fn(f64) -> f64| -> Option<Vec<Short>> {
            (!column.is_empty()).then(|| column.iter().map(|&value| Short(of(value))).collect())
        };
        let (same, negated) = (|value: f64| value, |value: f64| -value);
        let within_a_turn = |angle: f64| angle.rem_euclid(TAU);
        let stride_mean = |column: &[f64], of| {
            let width_s = stride_s(trace).filter(|_| !column.is_empty())?;
            at(&smoothed(&trace.t_s, column, width_s), of)
        };
        let [fx, fy, fz, ..] = &trace.wrench;
        let (partly, wholly) = passage.stretches();
        Self {
            t_s: trace.t_s.iter().map(|&time_s| Short(time_s)).collect(),
            drag_n: at(fx, negated),
            lift_n: at(fz, same),
            drag_stride_n: stride_mean(fx, negated),
            lift_stride_n: stride_mean(fz, same),
            fy_n: at(fy, same),
            right_leg_rad: at(&trace.right_leg_rad, within_a_turn),
            left_leg_rad: at(&trace.left_leg_rad, within_a_turn),
            right_power_w: at(&trace.right_power_w, same),
            left_power_w: at(&trace.left_power_w, same),
            power_w: at(&trace.power_w, same),
            partly,
            wholly,
        }
    }
}
