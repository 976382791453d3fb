//! The report of a calibration: how far it can be trusted, and what for.

mod certificate;
mod content;
mod limits;

use std::fmt::Write;

pub use certificate::{Certificate, CheckedLoad, Contribution, EvaluationType};
pub use content::CalibrationReport;
use limits::limits;

use super::markup::{Column, escape, figure, table};
use super::page::page;
use super::sections::calibration::{errors_table, sources_table};
use super::sections::parts::{drawing, facts_table, folded};
use super::units::{AxisUnits, axis_names};
use calibration::fit::GroupErrors;
use calibration::validation::excitation::{AxisExcitation, Excitation};
use calibration::validation::selection::Selection;
use shell_data::wrench::{Axes, Axis};

/// Groups that are shown at once: those with the largest errors.
const WORST: usize = 10;

/// Groups that are listed at all: a report is to stay readable.
const MOST_GROUPS: usize = 1000;

impl CalibrationReport<'_> {
    /// The report as the content of an HTML file.
    pub fn html(&self) -> String {
        let groups = match self.train_groups.len() + self.test_groups.len() {
            0 | 1 => String::new(),
            _ => by_group(self),
        };
        let sections = [
            ("answer", "How far it can be trusted", answer(self)),
            ("limits", "What it must not be used for", list(&limits(self))),
            ("figure", "Predicted against measured", predicted(self)),
            ("coverage", "Which loads were calibrated", coverage(self)),
            ("groups", "By pose", groups),
            ("model", "Which model, and why", model(self)),
            ("outliers", "Suspicious rows", outliers(self)),
            ("origin", "To make it again", origin(self)),
        ];
        page(self.heading, &self.heading.made(), &sections, None)
    }
}

fn list(sentences: &[String]) -> String {
    let items: String =
        sentences.iter().map(|sentence| format!("<li>{}</li>\n", escape(sentence))).collect();
    if items.is_empty() { items } else { format!("<ul>\n{items}</ul>\n") }
}

/// What it is worth, and the errors behind that.
fn answer(report: &CalibrationReport<'_>) -> String {
    let mut html = list(report.verdict);
    for warning in report.warnings {
        let _ = writeln!(
            html,
            "<p class=\"warning\"><strong>Warning:</strong> {}</p>",
            escape(warning)
        );
    }
    html + &errors_table(&report.calibration)
}

fn predicted(report: &CalibrationReport<'_>) -> String {
    let of = if report.calibration.test.is_some() { "test" } else { "training" };
    let caption = format!(
        "For each axis: predicted against measured load of the {of} rows, the residual (predicted less \
         measured) against the prediction, and how residuals are distributed"
    );
    let rms = |axis: Axis| {
        let quality = report.calibration.test.or(report.calibration.train);
        let rms = quality.map_or(f64::NAN, |axes| axes[axis.index()].rms);
        format!("{} {} {}", axis.name(), figure(rms), axis.unit())
    };
    let axes = report.calibration.axes.iter();
    let alt = format!("{caption}. RMS: {}", axes.map(rms).collect::<Vec<_>>().join(", "));
    drawing("predicted", &report.figure.svg(), &alt, &caption)
}

fn coverage(report: &CalibrationReport<'_>) -> String {
    let Some(excitation) = report.excitation else { return String::new() };
    let axes = report.calibration.axes;
    let caption = "Loads of the training rows and of the test rows, a sample of each: where it is empty, \
                   the calibration guesses";
    let range = |axis: Axis| {
        let of = &excitation.axes[axis.index()];
        format!("{} {} to {} {}", axis.name(), figure(of.min), figure(of.max), axis.unit())
    };
    let alt = format!("{caption}. {}", axes.iter().map(range).collect::<Vec<_>>().join(", "));
    let html = drawing("loads", &report.coverage.svg(), &alt, caption);
    let share = |name: &str, of: fn(&AxisExcitation) -> f64| {
        let shares = axes.iter().map(|axis| of(&excitation.axes[axis.index()]));
        Column::numbers(name, shares.map(|share| format!("{:.0}", 100.0 * share)))
    };
    let mut columns = loads(excitation, axes);
    columns.push(share("rows above zero (%)", |of| of.rows_positive));
    columns.push(share("rows below zero (%)", |of| of.rows_negative));
    let training = table("Training loads", &columns);
    let correlations = axes.iter().map(|with| {
        let values = axes.iter().map(|axis| excitation.correlation[axis.index()][with.index()]);
        let texts = values.map(|value| format!("{value:.2}").replace('-', "\u{2212}"));
        Column::numbers(with.name(), texts)
    });
    let columns: Vec<_> = [axis_names(axes)].into_iter().chain(correlations).collect();
    let correlation = table("Correlation of training loads", &columns);
    html + &training + &folded("Which loads came together", &correlation)
}

/// The axes, and the loads of the training rows on each.
fn loads(excitation: &Excitation, axes: Axes) -> Vec<Column> {
    let range = |axis: Axis| &excitation.axes[axis.index()];
    let units = AxisUnits::new(|axis| vec![range(axis).min, range(axis).max]);
    vec![
        axis_names(axes),
        units.column("least", axes, |axis| Some(range(axis).min)),
        units.column("most", axes, |axis| Some(range(axis).max)),
        units.column("RMS", axes, |axis| Some(range(axis).rms)),
        units.units(axes),
    ]
}

/// The groups with the largest errors, and all of them, folded.
fn by_group(report: &CalibrationReport<'_>) -> String {
    let mut rows: Vec<(&str, &GroupErrors)> = Vec::new();
    rows.extend(report.train_groups.iter().map(|group| ("training", group)));
    rows.extend(report.test_groups.iter().map(|group| ("test", group)));
    let axes = report.calibration.axes;
    let typical: Vec<f64> = axes
        .iter()
        .map(|axis| {
            let squares = rows.iter().map(|(_, row)| rms(row, axis).powi(2));
            (squares.sum::<f64>() / rows.len() as f64).sqrt().max(f64::MIN_POSITIVE)
        })
        .collect();
    let size = |row: &GroupErrors| {
        let relative = axes.iter().zip(&typical).map(|(axis, typical)| rms(row, axis) / typical);
        relative.fold(0.0, f64::max)
    };
    let mut worst = rows.clone();
    worst.sort_by(|a, b| size(b.1).total_cmp(&size(a.1)));
    let is_all = worst.len() <= WORST;
    worst.truncate(WORST);
    let caption = match is_all {
        true => "Errors (RMS) by group of rows, the largest first".to_owned(),
        false => format!("Errors (RMS) of the {WORST} groups of rows with the largest"),
    };
    let mut html = group_table(&caption, &worst, axes);
    if !is_all {
        let shown = &rows[..rows.len().min(MOST_GROUPS)];
        let caption = match shown.len() == rows.len() {
            true => format!("All {} groups", rows.len()),
            false => format!("The first {MOST_GROUPS} of {} groups", rows.len()),
        };
        html += &folded(&caption, &group_table(&caption, shown, axes));
    }
    html
}

/// The root mean square of predicted less measured.
fn rms(group: &GroupErrors, axis: Axis) -> f64 {
    group.errors[axis.index()].quality().map_or(f64::NAN, |quality| quality.rms)
}

fn group_table(caption: &str, groups: &[(&str, &GroupErrors)], axes: Axes) -> String {
    let rows = || groups.iter().map(|(_, row)| *row);
    let units = |of: fn(&GroupErrors, Axis) -> f64| {
        AxisUnits::new(|axis| rows().map(|row| of(row, axis)).collect())
    };
    let (errors, loads) = (units(rms), units(|row, axis| row.load[axis.index()]));
    let load = |row: &GroupErrors| {
        let values = axes.iter().map(|axis| loads.of(axis).value(Some(row.load[axis.index()])));
        values.collect::<Vec<_>>().join(" ")
    };
    let mut columns = vec![
        Column::text("data", groups.iter().map(|(set, _)| set)),
        Column::text("group", rows().map(|row| &row.label)),
        Column::numbers("rows", rows().map(|row| row.rows)),
    ];
    columns.extend(axes.iter().map(|axis| {
        let unit = errors.of(axis);
        let values = rows().map(|row| unit.value(Some(rms(row, axis))));
        Column::numbers(&unit.name(axis.name()), values)
    }));
    let [force, moment] = [Axis::Fx, Axis::Mx].map(|axis| &loads.of(axis).unit);
    columns.push(Column::text(&format!("mean load ({force}; {moment})"), rows().map(load)));
    table(caption, &columns)
}

fn model(report: &CalibrationReport<'_>) -> String {
    let mut html = facts_table("The calibration", &report.calibration.facts);
    html += &list(report.reasons);
    if let Some(selection) = report.selection {
        html += &folded("Models that were compared", &compared(selection));
    }
    html
}

fn compared(selection: &Selection) -> String {
    let candidates = || selection.candidates.iter();
    let score = candidates().map(|candidate| candidate.errors.map(|errors| errors.score));
    let error = candidates().map(|candidate| candidate.errors.map(|errors| errors.standard_error));
    let note = |at| match at {
        at if at == selection.chosen => "chosen",
        at if at == selection.best => "best",
        _ => "",
    };
    let columns = [
        Column::text("model", candidates().map(|candidate| candidate.basis.name())),
        Column::numbers("features", candidates().map(|candidate| candidate.features)),
        Column::figures("ridge", candidates().map(|candidate| candidate.ridge)),
        Column::figures("squared error of the variance", score),
        Column::figures("± standard error", error),
        Column::text("note", (0..candidates().len()).map(note)),
    ];
    table("Errors on groups that were held out", &columns)
}

fn outliers(report: &CalibrationReport<'_>) -> String {
    let Some(outliers) = &report.outliers else { return String::new() };
    let done = if outliers.left_out { "were left out" } else { "were used all the same" };
    outliers
        .html(&format!("{} rows are suspicious, and {done}.", outliers.count), "Suspicious rows")
}

fn origin(report: &CalibrationReport<'_>) -> String {
    let command = escape(report.heading.command);
    format!("<pre><code>{command}</code></pre>\n") + &sources_table(&report.calibration)
}
