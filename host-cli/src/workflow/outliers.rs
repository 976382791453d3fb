//! Suspicious rows by file and line.

use std::io::Write;

use super::remark::Remark;
use calibration::fit::{Outlier, OutlierColumn, Outliers, Reason, RowName};
use log_file::{Column, Log, Meaning};
use serde::Serialize;
use shell_data::dataset::Dataset;
use shell_data::unit::Scale;
use shell_data::wrench::{Axes, Axis};

/// Number of rows that a report lists: more would bury the rest of the report.
const LISTED: usize = 100;

const HEADER: &str = "file,line,reason,axis,error_n_or_nm,error_in_sd,column,value,before,after";

/// A row in the output of `--json`.
#[derive(Debug, Serialize)]
pub struct OutlierReport {
    file: String,
    line: u64,
    reason: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    axis: Option<&'static str>,
    /// Predicted minus measured, N or N·m.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<f64>,
    /// Error in standard deviations.
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

#[derive(Debug)]
pub struct NamedOutliers {
    found: Outliers,
    names: Vec<RowName>,
    axes: Axes,
}

impl NamedOutliers {
    /// Names the rows `found` in `logs`; `read` is the data read from them.
    pub fn new(found: Outliers, logs: &[Log], read: &Dataset) -> Self {
        let name = |row: &Outlier| RowName {
            file: logs[row.log].path().display().to_string(),
            line: read.logs[row.log].lines[&row.offset].line(row.row),
            columns: column_names(&logs[row.log]),
        };
        let names = found.rows.iter().map(name).collect();
        let axes = logs.first().map_or(Axes::ALL, Log::axes);
        Self { found, names, axes }
    }

    pub fn remarks(&self) -> Vec<Remark> {
        self.found.warnings(self.axes, &self.names).into_iter().map(Remark::Warning).collect()
    }

    pub fn count(&self) -> usize {
        self.found.rows.len()
    }

    pub fn report(&self) -> Vec<OutlierReport> {
        self.found.rows.iter().zip(&self.names).map(report_of).collect()
    }

    pub fn rows(&self, left_out: bool) -> report::OutlierTable {
        let row = |(row, name): (&Outlier, &RowName)| report::OutlierRow {
            file: name.file.clone(),
            line: name.line,
            what: row.why(&name.columns),
        };
        let rows = self.found.rows.iter().zip(&self.names).take(LISTED).map(row).collect();
        report::OutlierTable { rows, count: self.count(), left_out }
    }

    /// Writes the rows with the reason why each was left out.
    pub fn write(&self, output: &mut dyn Write) -> csv::Result<()> {
        let mut table = csv::Writer::from_writer(output);
        table.write_record(HEADER.split(','))?;
        let number = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
        for row in self.report() {
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
}

/// The names of the channels, followed by all axes of the wrench; empty for missing axes.
fn column_names(log: &Log) -> Vec<String> {
    let mut names = log.value_names().into_iter();
    let mut all: Vec<String> = names.by_ref().take(log.channels()).map(str::to_owned).collect();
    let axis = |axis: Axis| match log.axes().contains(axis) {
        true => in_si_units(axis, names.next().unwrap_or_default(), log),
        false => String::new(),
    };
    all.extend(Axis::ALL.map(axis));
    all
}

/// Name of an axis's column, with the unit that its values were converted to.
fn in_si_units(axis: Axis, name: &str, log: &Log) -> String {
    let is_converted = |column: &Column| match column.meaning {
        Meaning::Load(of, scale) => of == axis && scale != Scale::ONE,
        _ => false,
    };
    match log.columns().iter().any(is_converted) {
        true => format!("{name} in {}", axis.unit()),
        false => name.to_owned(),
    }
}

fn report_of((row, name): (&Outlier, &RowName)) -> OutlierReport {
    let (reason, axis, error, size) = match row.reason {
        Reason::OutOfRange => ("out_of_range", None, None, None),
        Reason::Error { axis, size, error, is_possible } => {
            ("error", Some(axis.column()), is_possible.then_some(error), Some(size))
        }
    };
    let column = |of: &OutlierColumn| ColumnReport {
        name: name.columns.get(of.column).cloned().unwrap_or_default(),
        value: of.value,
        before: of.before,
        after: of.after,
    };
    let columns = row.columns.iter().map(column).collect();
    let (file, line) = (name.file.clone(), name.line);
    OutlierReport { file, line, reason, axis, error, size, columns }
}
