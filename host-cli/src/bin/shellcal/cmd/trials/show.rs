//! Results on the terminal.

use std::collections::BTreeMap;

use trial::{
    ConditionRow, Diagnostic, Interval, MeanDifference, Per, Quantity, Severity, Statistics,
    StrideRow, TrialResult, TrialRow,
};

use crate::printer::Printer;
use crate::tables::{NOTHING, or_dash};

/// One row a trial.
pub(super) fn trials(printer: &mut Printer, results: &[&TrialResult]) -> anyhow::Result<()> {
    let header = [
        "trial",
        "condition",
        "window (s)",
        "v (m/s)",
        "drag (N)",
        "lift (N)",
        "drag energy (mJ)",
        "95 % interval",
        "electrical (J)",
        "spec. resistance",
        "strides",
    ];
    let rows = results.iter().map(|result| trial(&result.row)).collect::<Vec<_>>();
    printer.table(&header, rows)
}

fn trial(row: &TrialRow) -> Vec<String> {
    vec![
        row.file.clone(),
        row.condition.clone(),
        format!("{:.3} to {:.3}", row.t_enter_s, row.t_exit_s),
        format!("{:.3}", row.velocity_m_s),
        or_dash(row.drag_mean_n, 4),
        or_dash(row.lift_mean_n, 4),
        or_dash(row.drag_energy_j.map(|energy| 1e3 * energy), 2),
        interval(row.drag_energy_95_j, 1e3, 2),
        or_dash(row.electrical_energy_j, 3),
        or_dash(row.specific_resistance, 2),
        row.strides.map_or_else(|| NOTHING.to_owned(), |strides| strides.to_string()),
    ]
}

/// One row a stride.
pub(super) fn strides(printer: &mut Printer, strides: &[StrideRow]) -> anyhow::Result<()> {
    let header = [
        "stride",
        "start (s)",
        "period (s)",
        "drag (N)",
        "lift (N)",
        "drag energy (mJ)",
        "electrical (J)",
        "spec. resistance",
    ];
    let row = |stride: &StrideRow| {
        vec![
            stride.stride.to_string(),
            format!("{:.4}", stride.t_start_s),
            format!("{:.4}", stride.period_s),
            or_dash(stride.drag_mean_n, 4),
            or_dash(stride.lift_mean_n, 4),
            or_dash(stride.drag_energy_j.map(|energy| 1e3 * energy), 3),
            or_dash(stride.electrical_energy_j, 4),
            or_dash(stride.specific_resistance, 2),
        ]
    };
    printer.table(&header, strides.iter().map(row))
}

/// One table a quantity, per trial and per stride.
pub(super) fn conditions(printer: &mut Printer, rows: &[ConditionRow]) -> anyhow::Result<()> {
    for quantity in Quantity::COMPARED {
        for per in Per::ALL {
            let wanted = |row: &&ConditionRow| row.quantity == quantity && row.per == per;
            let rows: Vec<_> = rows.iter().filter(wanted).collect();
            if rows.is_empty() {
                continue;
            }
            let (unit, factor) = match quantity.unit() {
                "J" if quantity == Quantity::DragEnergy => (" (mJ)", 1e3),
                "J" => (" (J)", 1.0),
                _ => ("", 1.0),
            };
            printer.line("")?;
            printer.line(format!("{}{unit} per {}", quantity.name(), per.name()))?;
            let numbers: Vec<_> = rows
                .iter()
                .map(|row| (&*row.condition, &row.statistics, row.difference.as_ref()))
                .collect();
            statistics(printer, &numbers, factor)?;
        }
    }
    Ok(())
}

/// The numbers of a condition.
pub(super) type ConditionNumbers<'a> = (&'a str, &'a Statistics, Option<&'a MeanDifference>);

/// The numbers of some conditions, times `factor`.
pub(super) fn statistics(
    printer: &mut Printer,
    rows: &[ConditionNumbers<'_>],
    factor: f64,
) -> anyhow::Result<()> {
    let mut header = vec![
        "condition",
        "n",
        "mean",
        "95 % interval",
        "sd",
        "quartiles",
        "median",
        "whiskers",
        "outliers",
    ];
    let reference = rows.iter().find_map(|(_, _, difference)| *difference);
    let name = reference.map(|difference| format!("minus {}", difference.reference));
    if let Some(name) = &name {
        header.extend([name.as_str(), "95 % CI"]);
    }
    let decimals = decimals(rows.iter().map(|(_, s, _)| factor * s.mean));
    let row = |(condition, s, difference): &ConditionNumbers<'_>| {
        let range = |low, high| interval(Some(Interval { low, high }), factor, decimals);
        let mut cells = vec![
            (*condition).to_owned(),
            s.n.to_string(),
            or_dash(Some(factor * s.mean), decimals),
            interval(s.mean_95, factor, decimals),
            or_dash(s.sd.map(|sd| factor * sd), decimals),
            range(s.q1, s.q3),
            or_dash(Some(factor * s.median), decimals),
            range(s.whisker_low, s.whisker_high),
            s.outliers.len().to_string(),
        ];
        if name.is_some() {
            cells.push(or_dash(difference.map(|d| factor * d.mean), decimals));
            cells.push(interval(difference.and_then(|d| d.mean_95), factor, decimals));
        }
        cells
    };
    printer.table(&header, rows.iter().map(row))
}

/// Three digits or so of the largest of some values.
fn decimals(values: impl Iterator<Item = f64>) -> usize {
    let largest = values.fold(0.0, |largest: f64, value| largest.max(value.abs()));
    (1..=6).find(|&decimals| largest * 10_f64.powi(decimals) >= 1000.0).unwrap_or(6) as usize
}

/// Says what to know about the results on stderr: diagnostics of a kind once, for the first trial that
/// has it, and in how many others it is the same. `positions` are where the trials are said.
pub(super) fn diagnostics(printer: &mut Printer, results: &[(String, &TrialResult)]) {
    let mut kinds: BTreeMap<(Severity, &str), Vec<(&str, &Diagnostic)>> = BTreeMap::new();
    for (position, result) in results {
        for diagnostic in &result.diagnostics {
            kinds
                .entry((diagnostic.severity(), diagnostic.code()))
                .or_default()
                .push((position, diagnostic));
        }
    }
    for ((severity, _), diagnostics) in kinds {
        let (position, first) = diagnostics[0];
        let more = match diagnostics.len() {
            1 => String::new(),
            2 => " (also in another trial)".to_owned(),
            trials => format!(" (also in {} other trials)", trials - 1),
        };
        let text = format!("{position}: {first}{more}");
        match severity {
            Severity::Note => printer.note(text),
            Severity::Warning => printer.warning(text),
        }
    }
}

fn interval(interval: Option<Interval>, factor: f64, decimals: usize) -> String {
    interval.map_or_else(
        || NOTHING.to_owned(),
        |Interval { low, high }| {
            format!("{:.decimals$} to {:.decimals$}", factor * low, factor * high)
        },
    )
}
