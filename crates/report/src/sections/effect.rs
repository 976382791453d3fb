//! What the trials were made for, before all else: the effect of each condition, with its interval.

use std::fmt::Write;

use super::super::Report;
use super::super::markup::{TableCell, escape, table};
use super::super::numbers::{EffectPlot, ReportNumbers};
use super::super::units::ColumnUnit;
use super::parts::{capital, plot_figure};
use trial::{ConditionRow, Interval, MeanDifference, Quantity};

pub(super) fn effect(report: &Report<'_>, numbers: &ReportNumbers) -> String {
    let rows = |quantity: Quantity| report.of_trials(quantity);
    let quantities: Vec<Quantity> =
        Quantity::COMPARED.into_iter().filter(|&quantity| !rows(quantity).is_empty()).collect();
    let all = || quantities.iter().flat_map(|&quantity| rows(quantity));
    let mut names: Vec<&str> = Vec::new();
    for row in all() {
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
        html += &answers(&quantities, report, reference);
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
            let of = of(name).map(|row| &row.statistics);
            scale.estimate(of.map(|of| of.mean), of.and_then(|of| of.mean_95))
        };
        columns.push(names.iter().map(mean).collect());
        if let Some(reference) = reference {
            header.push(format!("difference from {}", reference.reference));
            let less = |name: &&str| {
                let less = of(name).and_then(|row| row.difference.as_ref());
                scale.estimate(less.map(|less| less.mean), less.and_then(|less| less.mean_95))
            };
            columns.push(names.iter().map(less).collect());
        }
    }
    let trials = |name: &str| {
        all().filter(|row| row.condition == name).map(|row| row.statistics.n as u64).max()
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
fn answers(quantities: &[Quantity], report: &Report<'_>, reference: &MeanDifference) -> String {
    let mut html = String::new();
    for &quantity in quantities {
        let rows = report.of_trials(quantity);
        let scale = scale_of(&rows, quantity);
        if rows.iter().all(|row| row.difference.is_none()) {
            continue;
        }
        // Conditions with a confidence interval: name, difference, interval.
        let known = rows.iter().filter_map(|row| {
            let difference = row.difference.as_ref()?;
            Some((&row.condition, difference.mean, difference.mean_95?))
        });
        let known: Vec<(&String, f64, Interval)> = known.collect();
        let said = |(condition, mean, interval): &(&String, f64, Interval)| {
            let by = scale.estimate(Some(*mean), Some(*interval));
            let unit = if scale.unit.is_empty() { "" } else { " " };
            format!("<strong>{}</strong> by {by}{unit}{}", escape(condition), scale.unit)
        };
        let _ = write!(html, "<p>{} per trial ", capital(quantity.name()));
        let from = escape(&reference.reference);
        if known.is_empty() {
            let _ = writeln!(
                html,
                "cannot be compared with that of {from}: an interval takes five trials of each.</p>"
            );
            continue;
        }
        let differing = known.iter().filter(|(.., of)| of.low > 0.0 || of.high < 0.0);
        let listed: Vec<String> = differing.map(said).collect();
        let _ = match listed.is_empty() {
            true => write!(html, "differs from that of {from} in no condition"),
            false => write!(html, "differs from that of {from}: {}", listed.join(", ")),
        };
        let _ = match (listed.is_empty(), known.len() - listed.len()) {
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
