//! The sections of a report, from top to bottom.

pub(super) mod calibration;
mod conditions;
mod effect;
pub(super) mod parts;
mod trials;

use std::fmt::Write;

use calibration::calibration;
use conditions::{conditions, phase};
use effect::effect;
use parts::facts_table;
use trials::trials;

use super::Report;
use super::markup::{TableCell, escape, table};
use super::numbers::ReportNumbers;
use super::page::PageSection;
use trial::Severity;

/// All of them, from top to bottom.
pub(super) fn of(report: &Report<'_>, numbers: &ReportNumbers) -> Vec<PageSection> {
    vec![
        PageSection::new("effect", "What came out", effect(report, numbers)),
        PageSection::new("warnings", "Warnings", warnings(report)),
        PageSection::new("conditions", "By condition", conditions(report, numbers)),
        PageSection::new("phase", "Over a stride", phase(numbers)),
        PageSection::new("trials", "Trials", trials(report, numbers)),
        PageSection::new("doubtful", "Readings that cannot be trusted", doubtful(report)),
        PageSection::new("calibration", "Calibration", calibration(report)),
        PageSection::new("origin", "To make it again", origin(report)),
    ]
}

/// Who made it, when, and of how many trials.
pub(super) fn subtitle(report: &Report<'_>) -> String {
    let count = report.trials.len();
    let s = if count == 1 { "" } else { "s" };
    let failed = match report.failed.len() {
        0 => String::new(),
        failed => format!(", {failed} that could not be evaluated"),
    };
    format!("{}, {}. {count} trial{s}{failed}.", report.heading.made_by, report.heading.date)
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
    // A line for each kind of diagnostic: its first, and how many more there are.
    let mut kinds: Vec<(Severity, &str, String, usize)> = Vec::new();
    for trial in report.trials {
        for diagnostic in &trial.diagnostics {
            match kinds
                .iter_mut()
                .find(|known| (known.0, known.1) == (diagnostic.severity(), diagnostic.code()))
            {
                Some((_, _, _, more)) => *more += 1,
                None => {
                    let text = format!("{}: {diagnostic}", trial.row.file);
                    kinds.push((diagnostic.severity(), diagnostic.code(), text, 0));
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
            1 => " (also in another trial)".to_owned(),
            more => format!(" (also in {more} other trials)"),
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
    let mut html = format!("<pre><code>{}</code></pre>\n", escape(report.heading.command));
    let settings: Vec<_> =
        report.settings.iter().map(|(name, value)| (name.as_str(), value.clone())).collect();
    if !settings.is_empty() {
        html += &facts_table("Settings", &settings);
    }
    let header = ["used as", "file", "bytes", "checksum"];
    let rows = report.inputs.iter().map(|input| {
        vec![
            TableCell::Text(input.role.clone()),
            TableCell::Text(input.path.clone()),
            TableCell::from(input.bytes),
            TableCell::Long(input.checksum.clone()),
        ]
    });
    html += &table("What went in", &header, rows);
    html
}
