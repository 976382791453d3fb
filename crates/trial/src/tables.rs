//! Results as tables, to be written as CSV or Parquet.

use super::diagnostic::Diagnostic;
use super::results::{ConditionRow, StrideRow, TrialResult, TrialRow};
use super::trace::Trace;
use shell_data::wrench::Axis;
use table_file::named_table::{NamedColumn, NamedTable};

/// One row a trial.
pub fn trials_table<'a>(results: impl Iterator<Item = &'a TrialResult> + Clone) -> NamedTable {
    let rows = || results.clone().map(|result| &result.row);
    let text =
        |of: fn(&TrialRow) -> &str| NamedColumn::Text(rows().map(|r| of(r).to_owned()).collect());
    let number = |of: fn(&TrialRow) -> Option<f64>| NamedColumn::Number(rows().map(of).collect());
    let count = |of: fn(&TrialRow) -> Option<u64>| NamedColumn::Count(rows().map(of).collect());
    let warnings = results.clone().map(|result| joined(&result.diagnostics)).collect();
    NamedTable::new([
        ("file", text(|r| &r.file)),
        ("condition", text(|r| &r.condition)),
        ("t_enter_s", number(|r| Some(r.t_enter_s))),
        ("t_exit_s", number(|r| Some(r.t_exit_s))),
        ("duration_s", number(|r| Some(r.duration_s))),
        ("velocity_m_s", number(|r| Some(r.velocity_m_s))),
        ("rows", count(|r| Some(r.rows))),
        ("fresh_frames", count(|r| r.fresh_frames)),
        ("drag_mean_n", number(|r| r.drag_mean_n)),
        ("drag_mean_low_n", number(|r| Some(r.drag_mean_95_n?.low))),
        ("drag_mean_high_n", number(|r| Some(r.drag_mean_95_n?.high))),
        ("lift_mean_n", number(|r| r.lift_mean_n)),
        ("lift_mean_low_n", number(|r| Some(r.lift_mean_95_n?.low))),
        ("lift_mean_high_n", number(|r| Some(r.lift_mean_95_n?.high))),
        ("drag_energy_j", number(|r| r.drag_energy_j)),
        ("drag_energy_low_j", number(|r| Some(r.drag_energy_95_j?.low))),
        ("drag_energy_high_j", number(|r| Some(r.drag_energy_95_j?.high))),
        ("electrical_energy_j", number(|r| r.electrical_energy_j)),
        ("mean_power_w", number(|r| r.mean_power_w)),
        ("specific_resistance", number(|r| r.specific_resistance)),
        ("strides", count(|r| r.strides)),
        ("stride_frequency_hz", number(|r| r.stride_frequency_hz)),
        ("warnings", NamedColumn::Text(warnings)),
    ])
}

/// One row a stride.
pub fn strides_table<'a>(results: impl Iterator<Item = &'a TrialResult> + Clone) -> NamedTable {
    let rows = || {
        let of_trial = |result: &'a TrialResult| {
            result.stride_rows.iter().map(move |stride| (&result.row, stride))
        };
        results.clone().flat_map(of_trial)
    };
    let text = |of: fn(&TrialRow) -> &str| {
        NamedColumn::Text(rows().map(|(trial, _)| of(trial).to_owned()).collect())
    };
    let number = |of: fn(&StrideRow) -> Option<f64>| {
        NamedColumn::Number(rows().map(|(_, stride)| of(stride)).collect())
    };
    let count = |of: fn(&StrideRow) -> u64| {
        NamedColumn::Count(rows().map(|(_, stride)| Some(of(stride))).collect())
    };
    let enter = rows().map(|(trial, _)| Some(trial.t_enter_s)).collect();
    NamedTable::new([
        ("file", text(|r| &r.file)),
        ("condition", text(|r| &r.condition)),
        // Which trial it is, where a log has several.
        ("t_enter_s", NamedColumn::Number(enter)),
        ("stride", count(|r| r.stride)),
        ("t_start_s", number(|r| Some(r.t_start_s))),
        ("t_end_s", number(|r| Some(r.t_end_s))),
        ("period_s", number(|r| Some(r.period_s))),
        ("rows", count(|r| r.rows)),
        ("drag_mean_n", number(|r| r.drag_mean_n)),
        ("lift_mean_n", number(|r| r.lift_mean_n)),
        ("drag_energy_j", number(|r| r.drag_energy_j)),
        ("electrical_energy_j", number(|r| r.electrical_energy_j)),
        ("mean_power_w", number(|r| r.mean_power_w)),
        ("specific_resistance", number(|r| r.specific_resistance)),
    ])
}

/// One row for each quantity of each condition.
pub fn conditions_table(rows: &[ConditionRow]) -> NamedTable {
    let text =
        |of: &dyn Fn(&ConditionRow) -> String| NamedColumn::Text(rows.iter().map(of).collect());
    let number =
        |of: fn(&ConditionRow) -> Option<f64>| NamedColumn::Number(rows.iter().map(of).collect());
    let count = |of: fn(&ConditionRow) -> usize| {
        NamedColumn::Count(rows.iter().map(|row| Some(of(row) as u64)).collect())
    };
    let outliers = |row: &ConditionRow| {
        let outliers = row.statistics.outliers.iter().map(f64::to_string);
        outliers.collect::<Vec<_>>().join(" ")
    };
    let reference = |row: &ConditionRow| {
        row.difference.as_ref().map(|difference| difference.reference.clone()).unwrap_or_default()
    };
    NamedTable::new([
        ("condition", text(&|row| row.condition.clone())),
        ("per", text(&|row| row.per.name().to_owned())),
        ("quantity", text(&|row| row.quantity.column().to_owned())),
        ("n", count(|row| row.statistics.n)),
        ("trials", count(|row| row.statistics.trials)),
        ("mean", number(|row| Some(row.statistics.mean))),
        ("sd", number(|row| row.statistics.sd)),
        ("mean_low", number(|row| row.statistics.mean_95.map(|interval| interval.low))),
        ("mean_high", number(|row| row.statistics.mean_95.map(|interval| interval.high))),
        ("q1", number(|row| Some(row.statistics.q1))),
        ("median", number(|row| Some(row.statistics.median))),
        ("q3", number(|row| Some(row.statistics.q3))),
        ("whisker_low", number(|row| Some(row.statistics.whisker_low))),
        ("whisker_high", number(|row| Some(row.statistics.whisker_high))),
        ("outliers", text(&outliers)),
        ("reference", text(&reference)),
        ("difference", number(|row| row.difference.as_ref().map(|d| d.mean))),
        ("difference_low", number(|row| Some(row.difference.as_ref()?.mean_95?.low))),
        ("difference_high", number(|row| Some(row.difference.as_ref()?.mean_95?.high))),
    ])
}

/// One row for each row of the log.
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
    NamedTable::new(columns.map(|(name, column)| (name, NamedColumn::Full(column.clone()))))
}

fn joined(diagnostics: &[Diagnostic]) -> String {
    let texts = diagnostics.iter().map(|remark| format!("{}: {remark}", remark.code()));
    texts.collect::<Vec<_>>().join("; ")
}
