//! The sections of a report, from top to bottom.

mod calibration;
mod conditions;
mod effect;
mod parts;
mod trials;

use std::fmt::Write;

use calibration::calibration;
use conditions::{conditions, phase};
use effect::effect;
use parts::facts_table;
use trials::trials;

use super::Report;
use super::markup::{Cell, escape, table};
use super::numbers::ReportNumbers;
use crate::trial::Severity;

/// All of it.
pub(super) fn body(report: &Report<'_>, numbers: &ReportNumbers) -> String {
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
        ("effect", "What came out", effect(report, numbers)),
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
