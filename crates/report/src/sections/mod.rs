//! The sections of a report, from top to bottom.

pub(super) mod calibration;
mod conditions;
mod trials;

use std::fmt::Write;

use calibration::calibration;
use conditions::{conditions, effect, side_by_side};
use trials::trials;

use super::Report;
use super::markup::{Column, PageSection, escape, facts_table, reproduction, table};
use super::numbers::Plots;
use trial::{Severity, TrialResult};

pub(super) fn of(report: &Report<'_>, plots: &Plots) -> Vec<PageSection> {
    vec![
        ("effect", "What came out", effect(report, plots)),
        ("warnings", "Warnings", warnings(report)),
        ("conditions", "By condition", conditions(report, plots)),
        ("phase", "Over a stride", side_by_side("phase", &plots.phases)),
        ("trials", "Trials", trials(report, plots)),
        ("doubtful", "Readings that cannot be trusted", doubtful(report)),
        ("calibration", "Calibration", report.calibration.map(calibration).unwrap_or_default()),
        ("origin", "To make it again", origin(report)),
    ]
}

pub(super) fn subtitle(report: &Report<'_>) -> String {
    let count = report.trials.len();
    let s = if count == 1 { "" } else { "s" };
    let failed = match report.failed.len() {
        0 => String::new(),
        failed => format!(", {failed} that could not be evaluated"),
    };
    format!("{} {count} trial{s}{failed}.", report.heading.made())
}

fn warnings(report: &Report<'_>) -> String {
    let mut items = String::new();
    let mut item = |class: &str, word: &str, text: &str| {
        let text = escape(text);
        let _ = writeln!(items, "<li class=\"{class}\"><strong>{word}:</strong> {text}</li>");
    };
    report.warnings.iter().for_each(|warning| item("warning", "Warning", warning));
    for (file, reason) in report.failed {
        item("warning", "Not evaluated", &format!("{file}: {reason}"));
    }
    let trials = report.trials.iter().map(|trial| (trial.row.file.as_str(), trial));
    let kinds: Vec<_> = TrialResult::diagnostics_of_each_kind(trials).collect();
    for (severity, text) in kinds.into_iter().rev() {
        let (class, word) = match severity {
            Severity::Warning => ("warning", "Warning"),
            Severity::Note => ("note", "Note"),
        };
        item(class, word, &text);
    }
    match items.is_empty() {
        true => "<p>None.</p>\n".to_owned(),
        false => format!("<ul>\n{items}</ul>\n"),
    }
}

fn doubtful(report: &Report<'_>) -> String {
    let Some(doubtful) = &report.doubtful else { return String::new() };
    let sentence = format!(
        "{} frames in the windows have a reading outside the range of the training data, or at an end of the \
         converter, and were used all the same: forces are less certain there than their intervals say.",
        doubtful.count
    );
    doubtful.html(&sentence, "Readings that cannot be trusted")
}

fn origin(report: &Report<'_>) -> String {
    let mut html = reproduction(report.heading.command);
    if !report.settings.is_empty() {
        html += &facts_table("Settings", report.settings);
    }
    let columns = [
        Column::text("used as", report.inputs.iter().map(|input| &input.role)),
        Column::text("file", report.inputs.iter().map(|input| &input.path)),
        Column::numbers("bytes", report.inputs.iter().map(|input| input.bytes)),
        Column::long("checksum", report.inputs.iter().map(|input| &input.checksum)),
    ];
    html + &table("What went in", &columns)
}
