//! The results by trial: tables, plots, strides.

use std::fmt::Write;

use super::super::markup::{Column, escape, figure, folded, plot_figure, table};
use super::super::numbers::Plots;
use super::super::units::ColumnUnit;
use super::super::{MOST_TRACES, Report};
use trial::{StrideRow, TrialResult, TrialRow};

pub(super) fn trials(report: &Report<'_>, plots: &Plots) -> String {
    if report.trials.is_empty() {
        return String::new();
    }
    let mut html = trial_tables(report.trials);
    let drawn = plots.trials.iter().filter(|plot| !plot.is_null()).count();
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
        if !plots.trials[at].is_null() {
            html += &trial_plots(at, row, !plots.trials[at]["drag_n"].is_null());
        }
        html += &strides(&trial.stride_rows);
        html.push_str("</details>\n");
    }
    html
}

fn trial_plots(at: usize, row: &TrialRow, has_forces: bool) -> String {
    let mut html = String::new();
    if has_forces {
        let alt = format!(
            "Drag and lift over time of {}: mean drag {} N, mean lift {} N in the window",
            row.file,
            figure(row.measures.drag_mean_n),
            figure(row.measures.lift_mean_n)
        );
        let caption = "Drag (−Fx) and lift (Fz); grey: the robot gets into the channel or out of \
                       it; pink: it is fully inside";
        html += &plot_figure(&format!("forces-{at}"), "", &alt, caption);
    }
    let alt = format!(
        "Forces, leg angles and power over time of {}: mean power {} W in the window",
        row.file,
        figure(row.measures.mean_power_w)
    );
    let caption = "Forces, leg angles within a turn, and electrical power of both motors";
    html += &plot_figure(&format!("stack-{at}"), " stack", &alt, caption);
    html
}

fn trial_tables(trials: &[TrialResult]) -> String {
    let rows = || trials.iter().map(|trial| &trial.row);
    let energies = rows().filter_map(|row| row.measures.drag_energy_j);
    let energy = ColumnUnit::new("J", energies);
    let estimate =
        |row: &TrialRow| energy.estimate(row.measures.drag_energy_j, row.drag_energy_95_j);
    let results = [
        Column::text("log", rows().map(|row| &row.file)),
        Column::text("condition", rows().map(|row| &row.condition)),
        Column::measured("drag", "N", rows().map(|row| row.measures.drag_mean_n)),
        Column::measured("lift", "N", rows().map(|row| row.measures.lift_mean_n)),
        Column::numbers(&energy.name("drag energy"), rows().map(estimate)),
        Column::measured(
            "electrical energy",
            "J",
            rows().map(|row| row.measures.electrical_energy_j),
        ),
        Column::figures("specific resistance", rows().map(|row| row.measures.specific_resistance)),
    ];
    let html = table("One row for each trial", &results);
    let strides = |row: &TrialRow| row.strides.map_or("–".to_owned(), |count| count.to_string());
    let times = [
        Column::text("log", rows().map(|row| &row.file)),
        Column::figures("entry (s)", rows().map(|row| row.t_enter_s)),
        Column::figures("exit (s)", rows().map(|row| row.t_exit_s)),
        Column::figures("speed (m/s)", rows().map(|row| row.velocity_m_s)),
        Column::numbers("strides", rows().map(strides)),
        Column::figures("strides/s", rows().map(|row| row.stride_frequency_hz)),
    ];
    let caption = "Times, speed and strides of each trial";
    html + &folded(caption, &table(caption, &times))
}

fn strides(rows: &[StrideRow]) -> String {
    if rows.is_empty() {
        return String::new();
    }
    let time = |time_s: f64| format!("{time_s:.4}");
    let rows = rows.iter();
    let columns = [
        Column::numbers("stride", rows.clone().map(|row| row.stride)),
        Column::numbers("start (s)", rows.clone().map(|row| time(row.t_start_s))),
        Column::numbers("end (s)", rows.clone().map(|row| time(row.t_end_s))),
        Column::figures("drag (N)", rows.clone().map(|row| row.measures.drag_mean_n)),
        Column::figures("lift (N)", rows.clone().map(|row| row.measures.lift_mean_n)),
        Column::measured("drag energy", "J", rows.clone().map(|row| row.measures.drag_energy_j)),
        Column::measured(
            "electrical energy",
            "J",
            rows.clone().map(|row| row.measures.electrical_energy_j),
        ),
        Column::figures(
            "specific resistance",
            rows.clone().map(|row| row.measures.specific_resistance),
        ),
    ];
    let table = table("One row for each stride", &columns);
    format!("<details><summary>{} strides</summary>\n{table}</details>\n", rows.len())
}
