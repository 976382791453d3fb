//! Results on the terminal.

use trial::{
    ConditionRow, Interval, MeanDifference, Per, Quantity, Severity, Statistics, StrideRow,
    TrialResult, TrialRow,
};

use crate::printer::{Printer, TableColumn};
use crate::tables::{or_dash, shown};

pub(super) fn trials(printer: &Printer, results: &[&TrialResult]) {
    let columns: [TableColumn<'_, &TrialRow>; 11] = [
        ("trial", &|row| row.file.clone()),
        ("condition", &|row| row.condition.clone()),
        ("window (s)", &|row| format!("{:.3} to {:.3}", row.t_enter_s, row.t_exit_s)),
        ("v (m/s)", &|row| format!("{:.3}", row.velocity_m_s)),
        ("drag (N)", &|row| or_dash(row.measures.drag_mean_n, 4)),
        ("lift (N)", &|row| or_dash(row.measures.lift_mean_n, 4)),
        ("drag energy (mJ)", &|row| {
            or_dash(row.measures.drag_energy_j.map(|energy| 1e3 * energy), 2)
        }),
        ("95 % interval", &|row| interval(row.drag_energy_95_j, 1e3, 2)),
        ("electrical (J)", &|row| or_dash(row.measures.electrical_energy_j, 3)),
        ("spec. resistance", &|row| or_dash(row.measures.specific_resistance, 2)),
        ("strides", &|row| shown(row.strides, |strides| strides.to_string())),
    ];
    printer.records(&columns, results.iter().map(|result| &result.row))
}

pub(super) fn strides(printer: &Printer, strides: &[StrideRow]) {
    let columns: [TableColumn<'_, &StrideRow>; 8] = [
        ("stride", &|row| row.stride.to_string()),
        ("start (s)", &|row| format!("{:.4}", row.t_start_s)),
        ("period (s)", &|row| format!("{:.4}", row.period_s)),
        ("drag (N)", &|row| or_dash(row.measures.drag_mean_n, 4)),
        ("lift (N)", &|row| or_dash(row.measures.lift_mean_n, 4)),
        ("drag energy (mJ)", &|row| {
            or_dash(row.measures.drag_energy_j.map(|energy| 1e3 * energy), 3)
        }),
        ("electrical (J)", &|row| or_dash(row.measures.electrical_energy_j, 4)),
        ("spec. resistance", &|row| or_dash(row.measures.specific_resistance, 2)),
    ];
    printer.records(&columns, strides)
}

/// Prints one table per quantity, per trial and per stride.
pub(super) fn conditions(printer: &Printer, rows: &[ConditionRow]) {
    for quantity in Quantity::COMPARED {
        for per in Per::ALL {
            let wanted = |row: &&ConditionRow| row.quantity == quantity && row.per == per;
            let rows: Vec<ConditionNumbers<'_>> = (rows.iter().filter(wanted))
                .map(|row| (&*row.condition, &row.statistics, row.difference.as_ref()))
                .collect();
            if rows.is_empty() {
                continue;
            }
            let (unit, factor) = match quantity.unit() {
                "J" if quantity == Quantity::DragEnergy => (" (mJ)", 1e3),
                "J" => (" (J)", 1.0),
                _ => ("", 1.0),
            };
            printer.line("");
            let title = format!("{}{unit} per {}", quantity.name(), per.name());
            printer.line(&title);
            statistics(printer, &title, &rows, factor);
        }
    }
}

pub(super) type ConditionNumbers<'a> = (&'a str, &'a Statistics, Option<&'a MeanDifference>);

/// Prints the numbers of a quantity in some conditions, times `factor`. CSV has no titles, so it names the quantity in
/// each row.
pub(super) fn statistics(
    printer: &Printer,
    quantity: &str,
    rows: &[ConditionNumbers<'_>],
    factor: f64,
) {
    let decimals = decimals(rows.iter().map(|(_, s, _)| factor * s.mean));
    let value = |value: Option<f64>| or_dash(value.map(|value| factor * value), decimals);
    let interval = |of: Option<Interval>| interval(of, factor, decimals);
    let range = |low, high| interval(Some(Interval { low, high }));
    let reference = rows.iter().find_map(|(.., difference)| *difference);
    let name = reference.map_or(String::new(), |of| format!("minus {}", of.reference));
    let columns: [TableColumn<'_, &ConditionNumbers<'_>>; 12] = [
        ("quantity", &|_| quantity.to_owned()),
        ("condition", &|(condition, ..)| (*condition).to_owned()),
        ("n", &|(_, s, _)| s.n.to_string()),
        ("mean", &|(_, s, _)| value(Some(s.mean))),
        ("95 % interval", &|(_, s, _)| interval(s.mean_95)),
        ("sd", &|(_, s, _)| value(s.sd)),
        ("quartiles", &|(_, s, _)| range(s.q1, s.q3)),
        ("median", &|(_, s, _)| value(Some(s.median))),
        ("whiskers", &|(_, s, _)| range(s.whisker_low, s.whisker_high)),
        ("outliers", &|(_, s, _)| s.outliers.len().to_string()),
        (&name, &|(.., difference)| value(difference.map(|of| of.mean))),
        ("95 % CI", &|(.., difference)| interval(difference.and_then(|of| of.mean_95))),
    ];
    let first = usize::from(!printer.is_csv());
    let last = if reference.is_some() { columns.len() } else { columns.len() - 2 };
    printer.records(&columns[first..last], rows)
}

/// Number of decimals that gives the largest value about three digits.
fn decimals(values: impl Iterator<Item = f64>) -> usize {
    let largest = values.fold(0.0, |largest: f64, value| largest.max(value.abs()));
    (1..=6).find(|&decimals| largest * 10_f64.powi(decimals) >= 1000.0).unwrap_or(6) as usize
}

/// Prints diagnostics of the results on stderr: each kind once, for the first trial that has it, with the
/// number of other trials that have it. The results come with the positions of the trials.
pub(super) fn diagnostics(printer: &Printer, results: &[(String, &TrialResult)]) {
    let trials = results.iter().map(|(position, result)| (position.as_str(), *result));
    for (severity, text) in TrialResult::diagnostics_of_each_kind(trials) {
        match severity {
            Severity::Note => printer.note(text),
            Severity::Warning => printer.warning(text),
        }
    }
}

fn interval(interval: Option<Interval>, factor: f64, decimals: usize) -> String {
    shown(interval, |Interval { low, high }| {
        format!("{:.decimals$} to {:.decimals$}", factor * low, factor * high)
    })
}
