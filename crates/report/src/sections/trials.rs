//! Trial by trial: tables, plots, strides.

use std::fmt::Write;

use super::super::markup::{TableCell, escape, figure, table};
use super::super::numbers::{ReportNumbers, TrialPlot};
use super::super::units::ColumnUnit;
use super::super::{MOST_TRACES, Report};
use super::parts::{folded, plot_figure};
use trial::{StrideRow, TrialResult, TrialRow};

pub(super) fn trials(report: &Report<'_>, numbers: &ReportNumbers) -> String {
    if report.trials.is_empty() {
        return String::new();
    }
    let mut html = trial_tables(report.trials);
    let drawn = numbers.trials.iter().flatten().count();
    if drawn < report.trials.len() && report.trials.len() > MOST_TRACES {
        let _ = writeln!(
            html,
            "<p class=\"quiet\">Traces of the first {drawn} trials are drawn, so that this file stays \
             readable.</p>"
        );
    }
    html.push_str(
        "<p class=\"all\"><button type=\"button\" data-all=\"open\">Open all</button> <button \
         type=\"button\" data-all=\"close\">Close all</button></p>\n",
    );
    for (at, trial) in report.trials.iter().enumerate() {
        let row = &trial.row;
        let (file, condition) = (escape(&row.file), escape(&row.condition));
        let open = if at == 0 { " open" } else { "" };
        let _ = writeln!(
            html,
            "<details data-trial=\"{at}\"{open}>\n<summary>{file} <span class=\"quiet\">{condition}, \
             {} s to {} s</span></summary>",
            figure(row.t_enter_s),
            figure(row.t_exit_s)
        );
        if let Some(plot) = &numbers.trials[at] {
            html += &trial_plots(at, row, plot);
        }
        html += &strides(&trial.stride_rows);
        html.push_str("</details>\n");
    }
    html
}

/// Where the plots of a trial are drawn.
fn trial_plots(at: usize, row: &TrialRow, plot: &TrialPlot) -> String {
    let mut html = String::new();
    if plot.drag_n.is_some() {
        let alt = format!(
            "Drag and lift over time of {}: mean drag {} N, mean lift {} N in the window",
            row.file,
            figure(row.drag_mean_n),
            figure(row.lift_mean_n)
        );
        let caption = "Drag (−Fx) and lift (Fz); grey: the robot gets into the channel or out of \
                       it; pink: it is fully inside";
        html += &plot_figure(&format!("forces-{at}"), "", &alt, caption);
    }
    let alt = format!(
        "Forces, leg angles and power over time of {}: mean power {} W in the window",
        row.file,
        figure(row.mean_power_w)
    );
    let caption = "Forces, leg angles within a turn, and electrical power of both motors";
    html += &plot_figure(&format!("stack-{at}"), " stack", &alt, caption);
    html
}

/// What answers, and, folded, what it was computed from. Every column has the unit that suits it.
fn trial_tables(trials: &[TrialResult]) -> String {
    let scale = |unit: &str, value: fn(&TrialRow) -> Option<f64>| {
        ColumnUnit::new(unit, trials.iter().filter_map(|trial| value(&trial.row)))
    };
    let drag = scale("N", |row| row.drag_mean_n);
    let lift = scale("N", |row| row.lift_mean_n);
    let energy = scale("J", |row| row.drag_energy_j);
    let electrical = scale("J", |row| row.electrical_energy_j);
    let names = [
        drag.name("drag"),
        lift.name("lift"),
        energy.name("drag energy"),
        electrical.name("electrical energy"),
    ];
    let mut header = vec!["log", "condition"];
    header.extend(names.iter().map(String::as_str));
    header.push("specific resistance");
    let results = |TrialResult { row, .. }: &TrialResult| {
        vec![
            TableCell::Text(row.file.clone()),
            TableCell::Text(row.condition.clone()),
            TableCell::Figure(drag.value(row.drag_mean_n)),
            TableCell::Figure(lift.value(row.lift_mean_n)),
            TableCell::Figure(energy.estimate(row.drag_energy_j, row.drag_energy_95_j)),
            TableCell::Figure(electrical.value(row.electrical_energy_j)),
            TableCell::from(row.specific_resistance),
        ]
    };
    let rows = trials.iter().map(results);
    let html = table("One row for each trial", &header, rows);
    let header = ["log", "entry (s)", "exit (s)", "speed (m/s)", "strides", "strides/s"];
    let times = |TrialResult { row, .. }: &TrialResult| {
        vec![
            TableCell::Text(row.file.clone()),
            TableCell::from(row.t_enter_s),
            TableCell::from(row.t_exit_s),
            TableCell::from(row.velocity_m_s),
            TableCell::Figure(row.strides.map_or("–".to_owned(), |strides| strides.to_string())),
            TableCell::from(row.stride_frequency_hz),
        ]
    };
    let rows = trials.iter().map(times);
    let caption = "Times, speed and strides of each trial";
    html + &folded(caption, &table(caption, &header, rows))
}

fn strides(strides: &[StrideRow]) -> String {
    if strides.is_empty() {
        return String::new();
    }
    let energy = ColumnUnit::new("J", strides.iter().filter_map(|row| row.drag_energy_j));
    let electrical = ColumnUnit::new("J", strides.iter().filter_map(|row| row.electrical_energy_j));
    let names = [energy.name("drag energy"), electrical.name("electrical energy")];
    let header = [
        "stride",
        "start (s)",
        "end (s)",
        "drag (N)",
        "lift (N)",
        &names[0],
        &names[1],
        "specific resistance",
    ];
    let rows = strides.iter().map(|row| {
        vec![
            TableCell::from(row.stride),
            TableCell::Figure(format!("{:.4}", row.t_start_s)),
            TableCell::Figure(format!("{:.4}", row.t_end_s)),
            TableCell::from(row.drag_mean_n),
            TableCell::from(row.lift_mean_n),
            TableCell::Figure(energy.value(row.drag_energy_j)),
            TableCell::Figure(electrical.value(row.electrical_energy_j)),
            TableCell::from(row.specific_resistance),
        ]
    });
    let table = table("One row for each stride", &header, rows);
    format!("<details><summary>{} strides</summary>\n{table}</details>\n", strides.len())
}
