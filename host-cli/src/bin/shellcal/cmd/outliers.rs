//! How rows that do not belong are named, by `fit` and `info` alike.

use log_file::Log;
use output_file::AtomicFile;
use serde::Serialize;
use shell_data::wrench::{Axes, Axis, PerAxis};
use shellcal::workflow::outliers::{Outlier, OutlierColumn, Outliers, Reason};

use super::quality::significant;
use crate::printer::Printer;

/// More rows would hide what else is said; `--json` and `--dropped` have all.
const SHOWN: usize = 10;

/// What `--json` prints of a row.
#[derive(Debug, Serialize)]
pub(super) struct OutlierReport {
    file: String,
    line: u64,
    reason: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    axis: Option<&'static str>,
    /// Predicted less measured, N or N·m.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<f64>,
    /// In standard deviations.
    #[serde(skip_serializing_if = "Option::is_none")]
    size: Option<f64>,
    columns: Vec<ColumnReport>,
}

#[derive(Debug, Serialize)]
struct ColumnReport {
    name: String,
    value: f64,
    before: Option<f64>,
    after: Option<f64>,
}

impl OutlierReport {
    fn of(row: &Outlier, logs: &[Log]) -> Self {
        let (reason, axis, error, size) = match row.reason {
            Reason::OutOfRange => ("out_of_range", None, None, None),
            Reason::Error { axis, size, error } => {
                ("error", Some(axis.column()), Some(error), Some(size))
            }
        };
        let column = |of: &OutlierColumn| ColumnReport {
            name: of.name.clone(),
            value: of.value,
            before: of.before,
            after: of.after,
        };
        Self {
            file: logs[row.log].path().display().to_string(),
            line: row.line,
            reason,
            axis,
            error,
            size,
            columns: row.columns.iter().map(column).collect(),
        }
    }
}

/// All rows, for `--json`.
pub(super) fn report(found: &Outliers, logs: &[Log]) -> Vec<OutlierReport> {
    found.rows.iter().map(|row| OutlierReport::of(row, logs)).collect()
}

/// As many rows as a report lists: more would hide what else is said.
const LISTED: usize = 100;

/// The rows for a report.
pub(super) fn rows(found: &Outliers, logs: &[Log], left_out: bool) -> report::Outliers {
    let row = |row: &Outlier| report::OutlierRow {
        file: logs[row.log].path().display().to_string(),
        line: row.line,
        what: why(row),
    };
    let rows = found.rows.iter().take(LISTED).map(row).collect();
    report::Outliers { rows, count: found.rows.len(), left_out }
}

/// Names the rows and says what they do to the fit, and, where they were kept, what to do.
pub(super) fn warn(printer: &mut Printer, found: &Outliers, logs: &[Log]) {
    for row in found.rows.iter().take(SHOWN) {
        printer.warning(in_words(row, logs));
    }
    if let Some(rows) = found.too_many {
        printer.warning(format!(
            "{rows} rows stand out by an error or a reading, too many for slips of single rows: the \
             model does not follow them, or columns are not what they are taken for (`shellcal info`)"
        ));
    }
    let count = found.rows.len();
    if count == 0 {
        return;
    }
    let others = if count > SHOWN { format!(" ({} of them above)", SHOWN) } else { String::new() };
    let worth = found.rms.as_ref().map_or_else(String::new, |rms| {
        let axes = logs.first().map_or(Axes::ALL, Log::axes);
        format!("; on the other rows the RMS error is, with → without them, {}", errors(rms, axes))
    });
    let s = if count == 1 { " does" } else { "s do" };
    printer.warning(format!("{count} row{s} not belong{others}{worth}"));
}

fn errors([with, without]: &[PerAxis<f64>; 2], axes: Axes) -> String {
    let of = |axis: Axis| {
        let [with, without] = [with, without].map(|rms| significant(rms[axis.index()], 3));
        format!("{} {with} → {without} {}", axis.name(), axis.unit())
    };
    axes.iter().map(of).collect::<Vec<_>>().join(", ")
}

fn in_words(row: &Outlier, logs: &[Log]) -> String {
    format!("`{}` line {} does not belong: {}", logs[row.log].path().display(), row.line, why(row))
}

/// Which of a row's columns stand out, and by how much it is off.
fn why(row: &Outlier) -> String {
    let columns = row.columns.iter().take(3).map(|column| {
        let beside: Vec<String> =
            [column.before, column.after].into_iter().flatten().map(|x| x.to_string()).collect();
        let beside = match beside.len() {
            0 => String::new(),
            _ => format!(" (beside it {})", beside.join(" and ")),
        };
        format!("`{}` is {}{beside}", column.name, column.value)
    });
    let more = match row.columns.len().saturating_sub(3) {
        0 => String::new(),
        more => format!(" and {more} columns more"),
    };
    let why = match row.reason {
        Reason::OutOfRange => "outside the valid range".to_owned(),
        Reason::Error { axis, size, error } => format!(
            "{} is predicted {} {} off, {} standard deviations",
            axis.name(),
            significant(error, 3),
            axis.unit(),
            significant(size, 2)
        ),
    };
    format!("{}{more}; {why}", columns.collect::<Vec<_>>().join(", "))
}

/// Lists the rows with why they were left out.
pub(super) fn write(output: &mut AtomicFile, found: &Outliers, logs: &[Log]) -> anyhow::Result<()> {
    let mut table = csv::Writer::from_writer(output);
    let header = [
        "file",
        "line",
        "reason",
        "axis",
        "error_n_or_nm",
        "error_in_sd",
        "column",
        "value",
        "before",
        "after",
    ];
    table.write_record(header)?;
    let number = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
    for row in report(found, logs) {
        let column = row.columns.first();
        table.write_record([
            row.file,
            row.line.to_string(),
            row.reason.to_owned(),
            row.axis.unwrap_or_default().to_owned(),
            number(row.error),
            number(row.size),
            column.map_or_else(String::new, |column| column.name.clone()),
            number(column.map(|column| column.value)),
            number(column.and_then(|column| column.before)),
            number(column.and_then(|column| column.after)),
        ])?;
    }
    table.flush()?;
    Ok(())
}
