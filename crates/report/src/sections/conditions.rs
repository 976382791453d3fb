//! Comparison of conditions: effects with intervals, then statistics, and forces over a stride.

use std::fmt::Write;

use super::super::Report;
use super::super::markup::{Column, capital, escape, folded, plot_figure, table};
use super::super::numbers::{Plot, Plots};
use super::super::units::ColumnUnit;
use trial::{ConditionRow, Interval, Per, Quantity};

struct Compared<'a> {
    quantity: Quantity,
    rows: Vec<&'a ConditionRow>,
    scale: ColumnUnit,
}

impl<'a> Compared<'a> {
    fn new(quantity: Quantity, rows: Vec<&'a ConditionRow>) -> Option<Self> {
        let scale = ColumnUnit::new(quantity.unit(), rows.iter().map(|row| row.statistics.mean));
        (!rows.is_empty()).then_some(Self { quantity, rows, scale })
    }
}

pub(super) fn effect(report: &Report<'_>, plots: &Plots) -> String {
    let of = |quantity| Compared::new(quantity, report.of(quantity, Per::Trial));
    let compared: Vec<Compared<'_>> = Quantity::COMPARED.into_iter().filter_map(of).collect();
    let all = || compared.iter().flat_map(|of| &of.rows);
    let mut names: Vec<&str> = Vec::new();
    for row in all() {
        if !names.contains(&row.condition.as_str()) {
            names.push(&row.condition);
        }
    }
    if names.is_empty() {
        return String::new();
    }
    let mut html = String::new();
    if let Some(reference) = report.reference() {
        html += &answers(&compared, reference);
    }
    for plot in &plots.effects {
        html += &plot_figure("effect-0", " effect", &plot.alt, &plot.caption);
    }
    let trials = |name: &&str| {
        all().filter(|row| row.condition == *name).map(|row| row.statistics.n).max().unwrap_or(0)
    };
    let mut columns = vec![
        Column::text("condition", &names),
        Column::numbers("trials", names.iter().map(trials)),
    ];
    for Compared { quantity, rows, scale } in &compared {
        let cells = |text: fn(&ColumnUnit, &ConditionRow) -> String| {
            let of = |name: &&str| rows.iter().find(|row| row.condition == *name);
            let cells = names.iter().map(move |name| of(name).map(|row| text(scale, row)));
            cells.map(|cell| cell.unwrap_or_else(|| "–".to_owned())).collect::<Vec<_>>()
        };
        columns.push(Column::numbers(&scale.name(quantity.name()), cells(ColumnUnit::mean)));
        if let Some(reference) = report.reference() {
            let name = format!("difference from {reference}");
            columns.push(Column::numbers(&name, cells(ColumnUnit::difference)));
        }
    }
    html + &table("Mean per trial, with the half width of its 95 % interval", &columns)
}

/// A sentence for every quantity on the differences of conditions from the reference.
fn answers(compared: &[Compared<'_>], reference: &str) -> String {
    let mut html = String::new();
    for Compared { quantity, rows, scale } in compared {
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
        let from = escape(reference);
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
            (_, alike) => writeln!(html, "; no significant difference in {alike} more.</p>"),
        };
    }
    html
}

pub(super) fn conditions(report: &Report<'_>, plots: &Plots) -> String {
    let mut html = side_by_side("box", &plots.boxes);
    for quantity in Quantity::ALL {
        let rows = report.conditions.iter().filter(|row| row.quantity == quantity).collect();
        let Some(Compared { rows, scale, .. }) = Compared::new(quantity, rows) else { continue };
        let statistics = || rows.iter().map(|row| &row.statistics);
        let names = || {
            let conditions = rows.iter().map(|row| &row.condition);
            let pers = rows.iter().map(|row| row.per.name());
            vec![Column::text("condition", conditions), Column::text("per", pers)]
        };
        let mut means = names();
        means.push(Column::numbers("n", statistics().map(|s| s.n)));
        means.push(Column::numbers("mean", rows.iter().map(|row| scale.mean(row))));
        if let Some(reference) = report.reference() {
            let name = format!("difference from {reference}");
            let less = rows.iter().map(|row| scale.difference(row));
            means.push(Column::numbers(&name, less));
        }
        html += &table(&scale.name(&capital(quantity.name())), &means);
        let mut spread = names();
        spread.extend([
            Column::numbers("sd", statistics().map(|s| scale.value(s.sd))),
            Column::numbers("median", statistics().map(|s| scale.value(Some(s.median)))),
            Column::numbers("quartiles", statistics().map(|s| scale.range(s.q1, s.q3))),
            Column::numbers(
                "whiskers",
                statistics().map(|s| scale.range(s.whisker_low, s.whisker_high)),
            ),
            Column::numbers("outliers", statistics().map(|s| s.outliers.len())),
        ]);
        let caption = format!("Spread of {}", scale.name(quantity.name()));
        html += &folded(&caption, &table(&caption, &spread));
    }
    html
}

pub(super) fn side_by_side(name: &str, plots: &[Plot]) -> String {
    let figure = |(at, plot): (usize, &Plot)| {
        plot_figure(&format!("{name}-{at}"), "", &plot.alt, &plot.caption)
    };
    let figures: String = plots.iter().enumerate().map(figure).collect();
    if figures.is_empty() { figures } else { format!("<div class=\"plots\">\n{figures}</div>\n") }
}
