//! The sections of a report, from top to bottom.

use std::fmt::Write;

use super::markup::{Cell, escape, figure, significant, table};
use super::numbers::{BoxPlot, Numbers, PhasePlot};
use super::{MOST_TRACES, Report};
use crate::calibration::quality::AxisQuality;
use crate::calibration_file::CalibrationFile;
use crate::trial::{Interval, Per, Quantity, Severity, StrideRow, TrialResult};
use crate::wrench::{Axis, PerAxis};

/// All of it.
pub(super) fn body(report: &Report<'_>, numbers: &Numbers) -> String {
    let mut html = String::new();
    let count = report.trials.len();
    let _ = write!(
        html,
        "<a class=\"skip\" href=\"#main\">Skip to the results</a>\n<header>\n<h1>{}</h1>\n\
         <p class=\"quiet\">{}, {}. {count} trial{}{}.</p>\n<nav aria-label=\"Sections\"><ul>\n",
        escape(report.title),
        escape(report.made_by),
        escape(report.date),
        if count == 1 { "" } else { "s" },
        match report.failed.len() {
            0 => String::new(),
            failed => format!(", {failed} that could not be evaluated"),
        },
    );
    let sections: Vec<(&str, &str, String)> = [
        ("warnings", "Warnings", warnings(report)),
        ("conditions", "By condition", conditions(report, numbers)),
        ("phase", "Over a stride", phase(numbers)),
        ("trials", "Trials", trials(report, numbers)),
        ("calibration", "Calibration", calibration(report)),
        ("origin", "To make it again", origin(report)),
    ]
    .into_iter()
    .filter(|(_, _, content)| !content.is_empty())
    .collect();
    for (id, name, _) in &sections {
        let _ = writeln!(html, "<li><a href=\"#{id}\">{name}</a></li>");
    }
    html.push_str(
        "</ul></nav>\n<noscript><p>The plots need JavaScript; the tables do not.</p></noscript>\n\
         </header>\n<main id=\"main\">\n",
    );
    for (id, name, content) in sections {
        let _ = write!(
            html,
            "<section aria-labelledby=\"{id}\">\n<h2 id=\"{id}\">{name}</h2>\n{content}</section>\n"
        );
    }
    html.push_str("</main>");
    html
}

fn warnings(report: &Report<'_>) -> String {
    let mut html = String::new();
    let mut items = String::new();
    for warning in report.warnings {
        let _ = writeln!(
            items,
            "<li class=\"warning\"><strong>Warning:</strong> {}</li>",
            escape(warning)
        );
    }
    for (file, reason) in report.failed {
        let (file, reason) = (escape(file), escape(reason));
        let _ = writeln!(
            items,
            "<li class=\"warning\"><strong>Not evaluated:</strong> {file}: {reason}</li>"
        );
    }
    // A line for each kind of remark: its first, and how many more there are.
    let mut kinds: Vec<(Severity, &str, String, usize)> = Vec::new();
    for trial in report.trials {
        for remark in &trial.remarks {
            match kinds
                .iter_mut()
                .find(|known| (known.0, known.1) == (remark.severity(), remark.code()))
            {
                Some((_, _, _, more)) => *more += 1,
                None => {
                    let text = format!("{}: {remark}", trial.row.file);
                    kinds.push((remark.severity(), remark.code(), text, 0));
                }
            }
        }
    }
    kinds.sort_by_key(|kind| std::cmp::Reverse(kind.0));
    for (severity, _, text, more) in kinds {
        let (class, word) = match severity {
            Severity::Warning => ("warning", "Warning:"),
            Severity::Note => ("note", "Note:"),
        };
        let more = match more {
            0 => String::new(),
            more => format!(" (and the like in {more} more)"),
        };
        let text = escape(&text);
        let _ = writeln!(items, "<li class=\"{class}\"><strong>{word}</strong> {text}{more}</li>");
    }
    match items.is_empty() {
        true => html.push_str("<p>None.</p>\n"),
        false => {
            let _ = write!(html, "<ul>\n{items}</ul>\n");
        }
    }
    html
}

fn conditions(report: &Report<'_>, numbers: &Numbers) -> String {
    let mut html = String::new();
    html.push_str("<div class=\"plots\">\n");
    for (at, plot) in numbers.boxes.iter().enumerate() {
        let caption = format!("{} per {}", capital(plot.quantity), plot.per.name());
        html += &plot_figure(&format!("box-{at}"), "", &box_alt(plot), &caption);
    }
    html.push_str("</div>\n");
    for quantity in Quantity::ALL {
        let rows: Vec<Vec<Cell>> = report
            .conditions
            .iter()
            .filter(|row| row.quantity == quantity)
            .map(|row| {
                let s = &row.statistics;
                let difference = row.difference.as_ref();
                vec![
                    Cell::Text(row.condition.clone()),
                    Cell::from(row.per.name()),
                    Cell::from(s.n as u64),
                    short(s.mean),
                    range(s.mean_95),
                    short(s.sd),
                    short(s.median),
                    range(Some(Interval { low: s.q1, high: s.q3 })),
                    range(Some(Interval { low: s.whisker_low, high: s.whisker_high })),
                    Cell::from(s.outliers.len() as u64),
                    short(difference.map(|difference| difference.mean)),
                    range(difference.and_then(|difference| difference.mean_95)),
                ]
            })
            .collect();
        if rows.is_empty() {
            continue;
        }
        let unit = if quantity.unit().is_empty() {
            String::new()
        } else {
            format!(" ({})", quantity.unit())
        };
        let reference = report.conditions.iter().find_map(|row| row.difference.as_ref());
        let against = reference
            .map_or("difference".to_owned(), |difference| format!("less {}", difference.reference));
        let caption = format!("{}{unit}", capital(quantity.name()));
        let header = [
            ("condition", true),
            ("per", true),
            ("n", false),
            ("mean", false),
            ("95 % of mean", false),
            ("sd", false),
            ("median", false),
            ("quartiles", false),
            ("whiskers", false),
            ("outliers", false),
            (against.as_str(), false),
            ("95 % of it", false),
        ];
        // Without a reference there is nothing to show in the last two.
        let shown = if reference.is_some() { header.len() } else { header.len() - 2 };
        let rows: Vec<_> = rows
            .into_iter()
            .map(|mut row| {
                row.truncate(shown);
                row
            })
            .collect();
        html += &table(&caption, &header[..shown], &rows);
    }
    html
}

fn phase(numbers: &Numbers) -> String {
    if numbers.phases.is_empty() {
        return String::new();
    }
    let mut html = String::from("<div class=\"plots\">\n");
    for (at, plot) in numbers.phases.iter().enumerate() {
        let caption = format!(
            "{} against the right leg's angle while the robot is fully inside: mean over strides, with \
             one standard deviation from stride to stride",
            capital(plot.quantity)
        );
        html += &plot_figure(&format!("phase-{at}"), "", &phase_alt(plot), &caption);
    }
    html.push_str("</div>\n");
    html
}

fn trials(report: &Report<'_>, numbers: &Numbers) -> String {
    if report.trials.is_empty() {
        return String::new();
    }
    let header = [
        ("log", true),
        ("condition", true),
        ("entry (s)", false),
        ("exit (s)", false),
        ("speed (m/s)", false),
        ("drag (N)", false),
        ("lift (N)", false),
        ("drag energy (J)", false),
        ("95 % of it (J)", false),
        ("electrical energy (J)", false),
        ("specific resistance", false),
        ("strides", false),
        ("strides/s", false),
    ];
    let rows: Vec<Vec<Cell>> = report.trials.iter().map(trial_cells).collect();
    let mut html = table("One row for each trial", &header, &rows);
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
        }
        html += &strides(&trial.stride_rows);
        html.push_str("</details>\n");
    }
    html
}

fn trial_cells(trial: &TrialResult) -> Vec<Cell> {
    let row = &trial.row;
    vec![
        Cell::Text(row.file.clone()),
        Cell::Text(row.condition.clone()),
        Cell::from(row.t_enter_s),
        Cell::from(row.t_exit_s),
        Cell::from(row.velocity_m_s),
        Cell::from(row.drag_mean_n),
        Cell::from(row.lift_mean_n),
        Cell::from(row.drag_energy_j),
        interval(row.drag_energy_95_j),
        Cell::from(row.electrical_energy_j),
        Cell::from(row.specific_resistance),
        Cell::Figure(row.strides.map_or("–".to_owned(), |strides| strides.to_string())),
        Cell::from(row.stride_frequency_hz),
    ]
}

fn strides(strides: &[StrideRow]) -> String {
    if strides.is_empty() {
        return String::new();
    }
    let header = [
        ("stride", false),
        ("start (s)", false),
        ("end (s)", false),
        ("drag (N)", false),
        ("lift (N)", false),
        ("drag energy (J)", false),
        ("electrical energy (J)", false),
        ("specific resistance", false),
    ];
    let rows: Vec<Vec<Cell>> = strides
        .iter()
        .map(|row| {
            vec![
                Cell::from(row.stride),
                Cell::Figure(format!("{:.4}", row.t_start_s)),
                Cell::Figure(format!("{:.4}", row.t_end_s)),
                Cell::from(row.drag_mean_n),
                Cell::from(row.lift_mean_n),
                Cell::from(row.drag_energy_j),
                Cell::from(row.electrical_energy_j),
                Cell::from(row.specific_resistance),
            ]
        })
        .collect();
    let table = table("One row for each stride", &header, &rows);
    format!("<details><summary>{} strides</summary>\n{table}</details>\n", strides.len())
}

fn calibration(report: &Report<'_>) -> String {
    let Some((path, file)) = report.calibration else { return String::new() };
    let mut html = String::new();
    let CalibrationFile { calibration, origin } = file;
    let mut facts = vec![
        ("file", path.to_owned()),
        ("made by", origin.made_by.clone()),
        ("date", origin.date.clone()),
        ("model", calibration.model().name()),
    ];
    if let Some(serial) = &origin.sensor_serial {
        facts.push(("sensor", serial.clone()));
    }
    if let Some(solver) = &origin.solver {
        facts.push(("solver", format!("{}, ridge {}", solver.name.name(), figure(solver.ridge))));
    }
    if let Some(diagnostics) = &origin.diagnostics {
        facts.push(("rows fitted", diagnostics.rows.to_string()));
        facts.push(("rank", diagnostics.rank.to_string()));
        facts.push(("condition number", figure(diagnostics.condition)));
    }
    html += &facts_table("The calibration", &facts);
    if let Some(diagnostics) = &origin.diagnostics {
        html += &quality_table("Errors on the training data", &diagnostics.train);
        if let Some(test) = &diagnostics.test {
            html += &quality_table("Errors on test data", test);
        }
    }
    if !origin.sources.is_empty() {
        let header = [("file", true), ("rows", false), ("checksum", true)];
        let rows: Vec<Vec<Cell>> = origin
            .sources
            .iter()
            .map(|source| {
                vec![
                    Cell::Text(source.path.display().to_string()),
                    Cell::from(source.rows),
                    Cell::Long(source.checksum.clone().unwrap_or_default()),
                ]
            })
            .collect();
        html += &table("What the calibration was made from", &header, &rows);
    }
    html
}

fn quality_table(caption: &str, axes: &PerAxis<AxisQuality>) -> String {
    let header = [
        ("axis", true),
        ("RMS", false),
        ("max", false),
        ("bias", false),
        ("R²", false),
        ("unit", false),
    ];
    let row = |(axis, quality): (Axis, &AxisQuality)| {
        vec![
            Cell::from(axis.name()),
            Cell::from(quality.rms),
            Cell::from(quality.max),
            Cell::from(quality.bias),
            Cell::from(quality.r_squared),
            Cell::Figure(axis.unit().to_owned()),
        ]
    };
    let rows: Vec<_> = Axis::ALL.into_iter().zip(axes).map(row).collect();
    table(caption, &header, &rows)
}

fn origin(report: &Report<'_>) -> String {
    let mut html = format!("<pre><code>{}</code></pre>\n", escape(report.command));
    let settings: Vec<_> =
        report.settings.iter().map(|(name, value)| (name.as_str(), value.clone())).collect();
    if !settings.is_empty() {
        html += &facts_table("Settings", &settings);
    }
    let header = [("used as", true), ("file", true), ("bytes", false), ("checksum", true)];
    let rows: Vec<Vec<Cell>> = report
        .inputs
        .iter()
        .map(|input| {
            vec![
                Cell::Text(input.role.clone()),
                Cell::Text(input.path.clone()),
                Cell::from(input.bytes),
                Cell::Long(input.checksum.clone()),
            ]
        })
        .collect();
    html += &table("What went in", &header, &rows);
    html
}

fn facts_table(caption: &str, facts: &[(&str, String)]) -> String {
    let rows: Vec<Vec<Cell>> = facts
        .iter()
        .map(|(name, value)| vec![Cell::from(*name), Cell::Long(value.clone())])
        .collect();
    table(caption, &[("", true), ("", true)], &rows)
}

fn plot_figure(id: &str, class: &str, alt: &str, caption: &str) -> String {
    let (alt, caption) = (escape(alt), escape(caption));
    format!(
        "<figure>\n<div id=\"{id}\" class=\"plot{class}\" role=\"img\" aria-label=\"{alt}\"></div>\n\
         <div class=\"keys\" role=\"group\" aria-label=\"Show and hide\"></div>\n\
         <figcaption>{caption}</figcaption>\n</figure>\n"
    )
}

fn box_alt(plot: &BoxPlot) -> String {
    let BoxPlot { quantity, unit, per, conditions } = plot;
    let medians: Vec<_> =
        conditions.iter().map(|c| format!("{} {}", c.name, figure(c.median.0))).collect();
    let unit = if unit.is_empty() { String::new() } else { format!(" in {unit}") };
    let per = match per {
        Per::Trial => "trial",
        Per::Stride => "stride",
    };
    format!("Box plot of {quantity} per {per} by condition; medians{unit}: {}", medians.join(", "))
}

fn phase_alt(plot: &PhasePlot) -> String {
    let strides: Vec<_> =
        plot.conditions.iter().map(|c| format!("{} {} strides", c.name, c.strides)).collect();
    format!("{} in N over a turn of the right leg: {}", capital(plot.quantity), strides.join(", "))
}

fn interval(interval: Option<Interval>) -> Cell {
    digits_of(interval, 4)
}

/// In three digits: wide tables are to be short.
fn range(interval: Option<Interval>) -> Cell {
    digits_of(interval, 3)
}

fn digits_of(interval: Option<Interval>, digits: i32) -> Cell {
    Cell::Figure(interval.map_or("–".to_owned(), |Interval { low, high }| {
        format!("{} … {}", significant(low, digits), significant(high, digits))
    }))
}

fn short(value: impl Into<Option<f64>>) -> Cell {
    Cell::Figure(significant(value, 3))
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}
