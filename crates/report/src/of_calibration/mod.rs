//! The report of a calibration: how far it can be trusted, and what for.

mod certificate;
mod content;
mod limits;

use std::fmt::Write;

pub use certificate::{Certificate, CheckedLoad, Contribution, EvaluationType};
pub use content::CalibrationReport;
use limits::limits;

use super::markup::{TableCell, escape, figure, table};
use super::page::page;
use super::sections::calibration::{errors_table, scales, sources_table};
use super::sections::parts::{drawing, facts_table, folded};
use calibration::fit::GroupErrors;
use calibration::validation::excitation::Excitation;
use calibration::validation::selection::{Candidate, Selection};
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
    let mut header = LOADS.to_vec();
    header.extend(["rows above zero (%)", "rows below zero (%)"]);
    let row = |(axis, mut cells): (Axis, Vec<TableCell>)| {
        let of = &excitation.axes[axis.index()];
        let shares = [of.rows_positive, of.rows_negative];
        cells.extend(shares.map(|share| TableCell::Figure(format!("{:.0}", 100.0 * share))));
        cells
    };
    let rows = axes.iter().zip(loads(excitation, axes)).map(row);
    let mut html = html + &table("Training loads", &header, rows);
    let mut header = vec!["axis"];
    header.extend(axes.iter().map(Axis::name));
    let row = |axis: Axis| {
        let mut row = vec![TableCell::from(axis.name())];
        let with = axes.of(&excitation.correlation[axis.index()]);
        row.extend(
            with.iter()
                .map(|value| TableCell::Figure(format!("{value:.2}").replace('-', "\u{2212}"))),
        );
        row
    };
    let rows: Vec<_> = axes.iter().map(row).collect();
    let correlation = table("Correlation of training loads", &header, rows);
    html += &folded("Which loads came together", &correlation);
    html
}

/// The header of the table of [`loads`].
const LOADS: [&str; 5] = ["axis", "least", "most", "RMS", "unit"];

/// The cells of each axis on the loads of the training rows.
fn loads(excitation: &Excitation, axes: Axes) -> impl Iterator<Item = Vec<TableCell>> {
    let range = |axis: Axis| &excitation.axes[axis.index()];
    let scales = scales(|axis| vec![range(axis).min, range(axis).max]);
    axes.iter().map(move |axis| {
        let (of, scale) = (range(axis), &scales[axis.index() / 3]);
        let mut cells = vec![TableCell::from(axis.name())];
        cells.extend([of.min, of.max, of.rms].map(|x| TableCell::Figure(scale.value(Some(x)))));
        cells.push(TableCell::Text(scale.unit.clone()));
        cells
    })
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
    let values = |of: fn(&GroupErrors, Axis) -> f64| {
        scales(|axis| groups.iter().map(|(_, row)| of(row, axis)).collect())
    };
    let (errors, loads) = (values(rms), values(|row, axis| row.load[axis.index()]));
    let name = |axis: Axis| errors[axis.index() / 3].name(axis.name());
    let names: Vec<String> = axes.iter().map(name).collect();
    let text = |(set, row): &(&str, &GroupErrors)| {
        let error =
            |axis: Axis| TableCell::Figure(errors[axis.index() / 3].value(Some(rms(row, axis))));
        let load = |axis: Axis| loads[axis.index() / 3].value(Some(row.load[axis.index()]));
        let mut cells =
            vec![TableCell::Text((*set).to_owned()), TableCell::Text(row.label.clone())];
        cells.push(TableCell::from(row.rows));
        cells.extend(axes.iter().map(error));
        cells.push(TableCell::Text(axes.iter().map(load).collect::<Vec<_>>().join(" ")));
        cells
    };
    let load = format!("mean load ({}; {})", loads[0].unit, loads[1].unit);
    let mut header = vec!["data", "group", "rows"];
    header.extend(names.iter().map(String::as_str));
    header.push(&load);
    table(caption, &header, groups.iter().map(text))
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
    let header =
        ["model", "features", "ridge", "squared error of the variance", "± standard error", "note"];
    let row = |(at, candidate): (usize, &Candidate)| {
        let mark = match at {
            at if at == selection.chosen => "chosen",
            at if at == selection.best => "best",
            _ => "",
        };
        vec![
            TableCell::from(candidate.basis.name()),
            TableCell::from(candidate.features as u64),
            TableCell::from(candidate.ridge),
            TableCell::from(candidate.errors.map(|errors| errors.score)),
            TableCell::from(candidate.errors.map(|errors| errors.standard_error)),
            TableCell::from(mark),
        ]
    };
    let rows = selection.candidates.iter().enumerate().map(row);
    table("Errors on groups that were held out", &header, rows)
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
