//! Measured trials beside the model.

use anyhow::{bail, ensure};
use beam_channel::Setup;
use serde::Serialize;
use shellcal::workflow::simulate::{MeasuredCondition, read_trials};
use simulation::channel_study::{ChannelDiagnostic, ChannelSummary};

use super::args::{SimulateArgs, of_deflection, of_width};
use super::model;
use super::quantity::{cm, length};
use crate::printer::{Printer, TableColumn};
use crate::tables::{or_dash, shown};

/// One condition, measured and simulated.
#[derive(Debug, Serialize)]
pub(super) struct ConditionComparison {
    #[serde(flatten)]
    measured: MeasuredCondition,
    /// None where the robot runs free.
    width_m: Option<f64>,
    /// Mean from the first contact to the last.
    simulated_drag_n: f64,
    over_prediction_n: f64,
    /// Simulated over measured; none where either is not positive.
    ratio: Option<f64>,
    remarks: Vec<ChannelDiagnostic>,
}

impl SimulateArgs {
    /// The comparison, if one is asked for.
    pub(super) fn compare(&self) -> anyhow::Result<Option<Vec<ConditionComparison>>> {
        let Some(path) = &self.compare else { return Ok(None) };
        let conditions = read_trials(path)?;
        for (name, _) in &self.condition {
            let is_there = conditions.iter().any(|condition| condition.name == *name);
            ensure!(is_there, "`{}` has no condition `{name}`", path.display());
        }
        let compared = conditions.into_iter().map(|condition| self.simulate(condition));
        compared.collect::<Result<_, _>>().map(Some)
    }

    fn simulate(&self, measured: MeasuredCondition) -> anyhow::Result<ConditionComparison> {
        let setup = self.setup_of(&measured.name)?;
        let summary = setup
            .map(|setup| model(&setup).map(|model| ChannelSummary::new(&model)))
            .transpose()?;
        // A trial's mean is over its window, from the first contact to the last, not over the plateau.
        let simulated_drag_n = summary.as_ref().map_or(0.0, |summary| summary.crossing_drag_n);
        let over_prediction_n = simulated_drag_n - measured.mean_drag_n;
        let is_drag = simulated_drag_n > 0.0 && measured.mean_drag_n > 0.0;
        let ratio = is_drag.then(|| simulated_drag_n / measured.mean_drag_n);
        let width_m = setup.map(|setup| setup.channel.width_m);
        let remarks = summary.map_or_else(Vec::new, |summary| summary.remarks);
        Ok(ConditionComparison {
            measured,
            width_m,
            simulated_drag_n,
            over_prediction_n,
            ratio,
            remarks,
        })
    }

    /// The channel that a condition's name stands for; `None` where the robot runs free.
    fn setup_of(&self, name: &str) -> anyhow::Result<Option<Setup>> {
        let base = self.setup();
        let given = self.condition.iter().find(|(given, _)| given == name);
        if let Some(&(_, width)) = given {
            return Ok(Some(of_width(&base, width)));
        }
        if name.eq_ignore_ascii_case("free") {
            return Ok(None);
        }
        // A bare number could be anything.
        match length(name) {
            Ok(depth) if name.ends_with('m') => Ok(Some(of_deflection(&base, depth))),
            _ => bail!(
                "condition `{name}` is neither `free` nor a deflection with its unit, such as \
                 `3 cm`: give its channel with `--condition \"{name}=WIDTH\"`"
            ),
        }
    }
}

pub(super) fn print(printer: &Printer, comparison: &[ConditionComparison]) -> anyhow::Result<()> {
    let columns: [TableColumn<'_, &ConditionComparison>; 8] = [
        ("condition", &|row| row.measured.name.clone()),
        ("width (cm)", &|row| shown(row.width_m, cm)),
        ("trials", &|row| row.measured.trials.to_string()),
        ("measured (N)", &|row| format!("{:.4}", row.measured.mean_drag_n)),
        ("s.d. (N)", &|row| or_dash(row.measured.sd_drag_n, 4)),
        ("simulated (N)", &|row| format!("{:.4}", row.simulated_drag_n)),
        ("over-prediction (N)", &|row| format!("{:.4}", row.over_prediction_n)),
        ("ratio", &|row| or_dash(row.ratio, 2)),
    ];
    printer.line("")?;
    printer.records(&columns, comparison)
}

/// What to know before trusting the comparison.
pub(super) fn warn(printer: &Printer, comparison: &[ConditionComparison]) {
    for row in comparison {
        for remark in &row.remarks {
            printer.warning(format!("condition `{}`: {remark}", row.measured.name));
        }
    }
    for row in comparison.iter().filter(|row| row.measured.without_drag > 0) {
        let (name, count) = (&row.measured.name, row.measured.without_drag);
        printer.warning(format!("condition `{name}`: {count} trials without a drag left out"));
    }
}
