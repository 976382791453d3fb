//! Statistics by condition, and forces over a stride.

use super::super::Report;
use super::super::markup::{Column, capital, folded, plot_figure, table};
use super::super::numbers::{Plot, Plots};
use super::super::units::ColumnUnit;
use trial::{ConditionRow, Quantity};

pub(super) fn conditions(report: &Report<'_>, plots: &Plots) -> String {
    let mut html = side_by_side("box", &plots.boxes);
    for quantity in Quantity::ALL {
        let rows: Vec<&ConditionRow> =
            report.conditions.iter().filter(|row| row.quantity == quantity).collect();
        if rows.is_empty() {
            continue;
        }
        let scale = ColumnUnit::new(quantity.unit(), rows.iter().map(|row| row.statistics.mean));
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

pub(super) fn phase(plots: &Plots) -> String {
    match plots.phases.is_empty() {
        true => String::new(),
        false => side_by_side("phase", &plots.phases),
    }
}

/// Plots side by side.
fn side_by_side(name: &str, plots: &[Plot]) -> String {
    let figures = plots
        .iter()
        .enumerate()
        .map(|(at, plot)| plot_figure(&format!("{name}-{at}"), "", &plot.alt, &plot.caption));
    format!("<div class=\"plots\">\n{}</div>\n", figures.collect::<String>())
}
