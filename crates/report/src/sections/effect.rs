//! What the trials were made for, before all else: the effect of each condition, with its interval.

use std::fmt::Write;

use super::super::Report;
use super::super::markup::{TableCell, escape, table};
use super::super::numbers::{EffectPlot, ReportNumbers};
use super::super::units::ColumnUnit;
use super::parts::{capital, plot_figure};
use trial::{ConditionRow, MeanDifference, Per, Quantity};

pub(super) fn effect(report: &Report<'_>, numbers: &ReportNumbers) -> String {
    let rows = |quantity: Quantity| -> Vec<&ConditionRow> {
        let per_trial = |row: &&ConditionRow| row.quantity == quantity && row.per == Per::Trial;
        report.conditions.iter().filter(per_trial).collect()
    };
    let quantities: Vec<Quantity> =
        Quantity::COMPARED.into_iter().filter(|&quantity| !rows(quantity).is_empty()).collect();
    let mut names: Vec<&str> = Vec::new();
    for row in quantities.iter().flat_map(|&quantity| rows(quantity)) {
        if !names.contains(&row.condition.as_str()) {
            names.push(&row.condition);
        }
    }
    if names.is_empty() {
        return String::new();
    }
    let reference = report.conditions.iter().find_map(|row| row.difference.as_ref());
    let mut html = String::new();
    if let Some(reference) = reference {
        html += &answers(&quantities, rows, reference);
    }
    for (at, plot) in numbers.effects.iter().enumerate() {
        html += &plot_figure(&format!("effect-{at}"), " effect", &alt(plot), &caption(plot));
    }
    let mut header = vec!["condition".to_owned(), "trials".to_owned()];
    let mut columns: Vec<Vec<String>> = Vec::new();
    for &quantity in &quantities {
        let rows = rows(quantity);
        let scale = scale_of(&rows, quantity);
        let of = |name: &str| rows.iter().find(|row| row.condition == name);
        header.push(scale.name(quantity.name()));
        let mean = |name: &&str| {
            of(name).map_or("–".to_owned(), |row| {
                scale.estimate(Some(row.statistics.mean), row.statistics.mean_95)
            })
        };
        columns.push(names.iter().map(mean).collect());
        if let Some(reference) = reference {
            header.push(format!("difference from {}", reference.reference));
            let less = |name: &&str| match of(name).and_then(|row| row.difference.as_ref()) {
                Some(difference) => scale.estimate(Some(difference.mean), difference.mean_95),
                None => "–".to_owned(),
            };
            columns.push(names.iter().map(less).collect());
        }
    }
    let trials = |name: &str| {
        let of_condition = |row: &&&ConditionRow| row.condition == name;
        let all: Vec<&ConditionRow> =
            quantities.iter().flat_map(|&quantity| rows(quantity)).collect();
        all.iter().filter(of_condition).map(|row| row.statistics.n as u64).max()
    };
    let cells = names.iter().enumerate().map(|(at, name)| {
        let mut row =
            vec![TableCell::Text((*name).to_owned()), TableCell::from(trials(name).unwrap_or(0))];
        row.extend(columns.iter().map(|column| TableCell::Figure(column[at].clone())));
        row
    });
    html + &table("Mean per trial, with the half width of its 95 % interval", &header, cells)
}

fn scale_of(rows: &[&ConditionRow], quantity: Quantity) -> ColumnUnit {
    ColumnUnit::new(quantity.unit(), rows.iter().map(|row| row.statistics.mean))
}

/// A sentence for every quantity: how conditions differ from the reference.
fn answers<'a>(
    quantities: &[Quantity],
    rows: impl Fn(Quantity) -> Vec<&'a ConditionRow>,
    reference: &MeanDifference,
) -> String {
    let mut html = String::new();
    for &quantity in quantities {
        let rows = rows(quantity);
        let scale = scale_of(&rows, quantity);
        let differs = |row: &&ConditionRow| {
            let interval = row.difference.as_ref().and_then(|difference| difference.mean_95);
            interval.is_some_and(|interval| interval.low > 0.0 || interval.high < 0.0)
        };
        let compared: Vec<&ConditionRow> =
            rows.iter().copied().filter(|row| row.difference.is_some()).collect();
        if compared.is_empty() {
            continue;
        }
        let said = |row: &ConditionRow| {
            let difference = row.difference.as_ref()?;
            let by = scale.estimate(Some(difference.mean), difference.mean_95);
            let unit = if scale.unit.is_empty() { "" } else { " " };
            Some(format!("<strong>{}</strong> by {by}{unit}{}", escape(&row.condition), scale.unit))
        };
        let known = compared.iter().filter(|row| {
            row.difference.as_ref().is_some_and(|difference| difference.mean_95.is_some())
        });
        let known: Vec<&ConditionRow> = known.copied().collect();
        let _ = write!(html, "<p>{} per trial ", capital(quantity.name()));
        let from = escape(&reference.reference);
        if known.is_empty() {
            let _ = writeln!(
                html,
                "cannot be compared with that of {from}: an interval takes five trials of each.</p>"
            );
            continue;
        }
        let differing: Vec<_> = known.iter().copied().filter(|row| differs(row)).collect();
        let listed: Vec<String> = differing.iter().filter_map(|row| said(row)).collect();
        let _ = match listed.is_empty() {
            true => write!(html, "differs from that of {from} in no condition"),
            false => write!(html, "differs from that of {from}: {}", listed.join(", ")),
        };
        let _ = match (listed.is_empty(), known.len() - differing.len()) {
            (true, _) | (_, 0) => writeln!(html, ".</p>"),
            (_, alike) => writeln!(html, "; of {alike} more it cannot be told.</p>"),
        };
    }
    html
}

fn alt(plot: &EffectPlot) -> String {
    let values: Vec<String> = plot.conditions.iter().map(|one| one.text.clone()).collect();
    format!("{}: {}", caption(plot), values.join("; "))
}

fn caption(plot: &EffectPlot) -> String {
    let EffectPlot { quantity, reference, .. } = plot;
    match reference {
        Some(reference) => format!(
            "{} per trial less that of {reference}: mean and 95 % interval; zero is no effect",
            capital(quantity)
        ),
        None => format!("{} per trial: mean and 95 % interval", capital(quantity)),
    }
}
