//! What `shellcal simulate` says of a channel, and of measured trials beside the model: tables and warnings.

use anyhow::{bail, ensure};
use beam_channel::{Model, Setup};
use serde::Serialize;
use shellcal::workflow::simulate::{MeasuredCondition, read_trials};
use simulation::channel_study::{
    BeamRow, ChannelDiagnostic, ChannelSummary, DrawStatistics, MonteCarlo, beam_rows,
};

use super::args::{SimulateArgs, cm, length, of_deflection, of_width, percent};
use super::model;
use crate::printer::{Printer, TableColumn};
use crate::tables::{NOTHING, or_dash, shown};

/// What was found of a channel, and how sure that is.
pub(super) type ChannelStudy = (ChannelSummary, Option<MonteCarlo>);

/// "5–6", and both walls where they differ.
fn contacts(least: Option<[u32; 2]>, greatest: Option<[u32; 2]>) -> String {
    let (Some(least), Some(greatest)) = (least, greatest) else { return NOTHING.to_owned() };
    let wall = |i: usize| match (least[i], greatest[i]) {
        (least, greatest) if least == greatest => format!("{least}"),
        (least, greatest) => format!("{least}–{greatest}"),
    };
    if wall(0) == wall(1) { wall(0) } else { format!("{}, {}", wall(0), wall(1)) }
}

pub(super) fn print_channels(printer: &Printer, studies: &[ChannelStudy]) {
    let columns: [TableColumn<'_, &ChannelSummary>; 7] = [
        ("width (cm)", &|of| cm(of.width_m)),
        ("deflection (cm)", &|of| cm(of.deflection_m)),
        ("beams per side", &|of| contacts(of.min_contacts, of.max_contacts)),
        ("mean drag (N)", &|of| or_dash(of.mean_drag_n, 4)),
        ("minimum (N)", &|of| or_dash(of.minimum_drag_n, 4)),
        ("peak (N)", &|of| or_dash(of.peak_drag_n, 4)),
        ("energy (mJ)", &|of| format!("{:.3}", 1e3 * of.energy_j)),
    ];
    printer.records(&columns, studies.iter().map(|(summary, _)| summary))
}

pub(super) fn print_uncertainty(printer: &Printer, studies: &[ChannelStudy]) {
    let with = || studies.iter().filter_map(|(summary, of)| Some((summary, of.as_ref()?)));
    let Some((_, first)) = with().next() else { return };
    let mut rows = Vec::new();
    for (summary, result) in with() {
        let figures = [
            ("mean drag (N)", result.mean_drag_n, 1.0, 4),
            ("minimum (N)", result.minimum_drag_n, 1.0, 4),
            ("peak (N)", result.peak_drag_n, 1.0, 4),
            ("energy (mJ)", result.energy_j, 1e3, 3),
        ];
        for (name, interval, scale, decimals) in figures {
            let statistics: [fn(&DrawStatistics) -> f64; 4] =
                [|of| of.median, |of| of.low, |of| of.high, |of| of.sd];
            let mut row = vec![format!("{} cm: {name}", cm(summary.width_m))];
            row.extend(statistics.map(|of| {
                or_dash(interval.as_ref().map(|interval| scale * of(interval)), decimals)
            }));
            rows.push(row);
        }
    }
    printer.line("");
    printer.line(format!(
        "{} draws; intervals hold {} % of them",
        first.draws,
        percent(first.level)
    ));
    printer.table(&["channel", "median", "from", "to", "s.d."], rows);
    for (summary, result) in with() {
        for (count, what) in [
            (result.refused, "make no sense or jam, and are left out"),
            (result.without_plateau, "have no plateau, and count for the energy alone"),
        ] {
            if count > 0 {
                let (width, draws) = (cm(summary.width_m), result.draws);
                printer.warning(format!("channel of {width} cm: {count} of {draws} draws {what}"));
            }
        }
    }
}

pub(super) fn warn(printer: &Printer, summary: &ChannelSummary) {
    let ChannelSummary { width_m, deflection_m, ref remarks, .. } = *summary;
    for remark in remarks {
        printer.warning(format!("channel of {} cm: {remark}", cm(width_m)));
    }
    // Half the width of the body, and what is left on either side of it.
    let (half_m, gap_m) = (deflection_m + width_m / 2.0, -deflection_m);
    if gap_m > half_m {
        printer.warning(format!(
            "channel of {} cm: the body passes {} cm away from the beams; lengths without a unit are in m",
            cm(width_m),
            cm(gap_m)
        ));
    }
}

/// The forces of a channel on the body at one position.
pub(super) fn print_beams(printer: &Printer, model: &Model, x_m: f64) {
    let total = model.total(x_m);
    printer.line("");
    printer.line(format!(
        "channel of {} cm, body at {} cm: drag {:.5} N, Fy {:.5} N, Mz {:.6} N·m",
        cm(model.setup().channel.width_m),
        cm(x_m),
        0.0 - total.fx_n,
        total.fy_n,
        total.mz_nm
    ));
    let columns: [TableColumn<'_, BeamRow>; 6] = [
        ("beam", &|beam| format!("{} {}", beam.wall, beam.beam)),
        ("base (cm)", &|beam| cm(beam.base_m)),
        ("φ (°)", &|beam| format!("{:.2}", beam.phi_rad.to_degrees())),
        ("Δθ (°)", &|beam| format!("{:.2}", beam.deflection_rad.to_degrees())),
        ("Fx (N)", &|beam| format!("{:.6}", beam.fx_n)),
        ("Fy (N)", &|beam| format!("{:.6}", beam.fy_n)),
    ];
    printer.records(&columns, beam_rows(model, x_m))
}

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

pub(super) fn print_comparison(printer: &Printer, comparison: &[ConditionComparison]) {
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
    printer.line("");
    printer.records(&columns, comparison)
}

/// What to know before trusting the comparison.
pub(super) fn warn_of_conditions(printer: &Printer, comparison: &[ConditionComparison]) {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn walls_are_told_apart_only_where_they_differ() {
        let said = |least, greatest| contacts(Some(least), Some(greatest));
        assert_eq!(said([4, 4], [5, 5]), "4–5");
        assert_eq!(said([5, 4], [5, 5]), "5, 4–5");
        assert_eq!(contacts(None, None), "–");
    }
}
