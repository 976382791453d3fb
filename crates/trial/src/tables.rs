//! Results as tables, for CSV or Parquet.

use super::diagnostic::Diagnostic;
use super::results::{ConditionRow, StrideRow, TrialResult, TrialRow};
use super::trace::Trace;
use shell_data::wrench::Axis;
use table_file::write::{Cells, NamedTable};

struct TableRows<T>(Vec<T>);

impl<T> TableRows<T> {
    fn text(&self, of: impl Fn(&T) -> String) -> Cells<'static> {
        Cells::Text(self.0.iter().map(of).collect())
    }

    fn number(&self, of: impl Fn(&T) -> Option<f64>) -> Cells<'static> {
        Cells::Number(self.0.iter().map(of).collect())
    }

    fn count(&self, of: impl Fn(&T) -> Option<u64>) -> Cells<'static> {
        Cells::Count(self.0.iter().map(of).collect())
    }
}

pub fn trials_table<'a>(results: impl Iterator<Item = &'a TrialResult>) -> NamedTable {
    let results = TableRows(results.collect());
    let text = |of: fn(&TrialRow) -> &str| results.text(|result| of(&result.row).to_owned());
    let number = |of: fn(&TrialRow) -> Option<f64>| results.number(|result| of(&result.row));
    let count = |of: fn(&TrialRow) -> Option<u64>| results.count(|result| of(&result.row));
    NamedTable::new([
        ("file", text(|r| &r.file)),
        ("condition", text(|r| &r.condition)),
        ("t_enter_s", number(|r| Some(r.t_enter_s))),
        ("t_exit_s", number(|r| Some(r.t_exit_s))),
        ("duration_s", number(|r| Some(r.duration_s))),
        ("velocity_m_s", number(|r| Some(r.velocity_m_s))),
        ("rows", count(|r| Some(r.rows))),
        ("fresh_frames", count(|r| r.fresh_frames)),
        ("drag_mean_n", number(|r| r.measures.drag_mean_n)),
        ("drag_mean_low_n", number(|r| Some(r.drag_mean_95_n?.low))),
        ("drag_mean_high_n", number(|r| Some(r.drag_mean_95_n?.high))),
        ("lift_mean_n", number(|r| r.measures.lift_mean_n)),
        ("lift_mean_low_n", number(|r| Some(r.lift_mean_95_n?.low))),
        ("lift_mean_high_n", number(|r| Some(r.lift_mean_95_n?.high))),
        ("drag_energy_j", number(|r| r.measures.drag_energy_j)),
        ("drag_energy_low_j", number(|r| Some(r.drag_energy_95_j?.low))),
        ("drag_energy_high_j", number(|r| Some(r.drag_energy_95_j?.high))),
        ("electrical_energy_j", number(|r| r.measures.electrical_energy_j)),
        ("mean_power_w", number(|r| r.measures.mean_power_w)),
        ("specific_resistance", number(|r| r.measures.specific_resistance)),
        ("strides", count(|r| r.strides)),
        ("stride_frequency_hz", number(|r| r.stride_frequency_hz)),
        ("warnings", results.text(|result| joined(&result.diagnostics))),
    ])
}

pub fn strides_table<'a>(results: impl Iterator<Item = &'a TrialResult>) -> NamedTable {
    let of_trial = |result: &'a TrialResult| {
        result.stride_rows.iter().map(move |stride| (&result.row, stride))
    };
    let rows = TableRows(results.flat_map(of_trial).collect());
    let number = |of: fn(&StrideRow) -> Option<f64>| rows.number(|(_, stride)| of(stride));
    NamedTable::new([
        ("file", rows.text(|(trial, _)| trial.file.clone())),
        ("condition", rows.text(|(trial, _)| trial.condition.clone())),
        // Distinguishes several trials of one log.
        ("t_enter_s", rows.number(|(trial, _)| Some(trial.t_enter_s))),
        ("stride", rows.count(|(_, stride)| Some(stride.stride))),
        ("t_start_s", number(|r| Some(r.t_start_s))),
        ("t_end_s", number(|r| Some(r.t_end_s))),
        ("period_s", number(|r| Some(r.period_s))),
        ("rows", rows.count(|(_, stride)| Some(stride.rows))),
        ("drag_mean_n", number(|r| r.measures.drag_mean_n)),
        ("lift_mean_n", number(|r| r.measures.lift_mean_n)),
        ("drag_energy_j", number(|r| r.measures.drag_energy_j)),
        ("electrical_energy_j", number(|r| r.measures.electrical_energy_j)),
        ("mean_power_w", number(|r| r.measures.mean_power_w)),
        ("specific_resistance", number(|r| r.measures.specific_resistance)),
    ])
}

pub fn conditions_table(rows: &[ConditionRow]) -> NamedTable {
    let rows = TableRows(rows.iter().collect());
    let number = |of: fn(&ConditionRow) -> Option<f64>| rows.number(|row| of(row));
    let outliers = rows.text(|row| {
        let outliers = row.statistics.outliers.iter().map(f64::to_string);
        outliers.collect::<Vec<_>>().join(" ")
    });
    let reference = rows.text(|row| {
        row.difference.as_ref().map(|difference| difference.reference.clone()).unwrap_or_default()
    });
    NamedTable::new([
        ("condition", rows.text(|row| row.condition.clone())),
        ("per", rows.text(|row| row.per.name().to_owned())),
        ("quantity", rows.text(|row| row.quantity.column().to_owned())),
        ("n", rows.count(|row| Some(row.statistics.n as u64))),
        ("trials", rows.count(|row| Some(row.statistics.trials as u64))),
        ("mean", number(|row| Some(row.statistics.mean))),
        ("sd", number(|row| row.statistics.sd)),
        ("mean_low", number(|row| row.statistics.mean_95.map(|interval| interval.low))),
        ("mean_high", number(|row| row.statistics.mean_95.map(|interval| interval.high))),
        ("q1", number(|row| Some(row.statistics.q1))),
        ("median", number(|row| Some(row.statistics.median))),
        ("q3", number(|row| Some(row.statistics.q3))),
        ("whisker_low", number(|row| Some(row.statistics.whisker_low))),
        ("whisker_high", number(|row| Some(row.statistics.whisker_high))),
        ("outliers", outliers),
        ("reference", reference),
        ("difference", number(|row| row.difference.as_ref().map(|d| d.mean))),
        ("difference_low", number(|row| Some(row.difference.as_ref()?.mean_95?.low))),
        ("difference_high", number(|row| Some(row.difference.as_ref()?.mean_95?.high))),
    ])
}

pub fn trace_table(trace: &Trace) -> NamedTable {
    let axes = Axis::ALL.into_iter().map(|axis| (axis.column(), &trace.wrench[axis.index()]));
    let others = [
        ("right_leg_rad", &trace.right_leg_rad),
        ("left_leg_rad", &trace.left_leg_rad),
        ("right_power_w", &trace.right_power_w),
        ("left_power_w", &trace.left_power_w),
        ("power_w", &trace.power_w),
    ];
    let columns = std::iter::once(("t_s", &trace.t_s)).chain(axes).chain(others);
    let columns = columns.filter(|(_, column)| !column.is_empty());
    NamedTable::new(columns.map(|(name, column)| (name, Cells::Full(column.clone().into()))))
}

fn joined(diagnostics: &[Diagnostic]) -> String {
    let texts = diagnostics.iter().map(|remark| format!("{}: {}", remark.code, remark.text));
    texts.collect::<Vec<_>>().join("; ")
}
