//! Statistics by condition, and forces over a stride.

use super::super::Report;
use super::super::markup::{Column, figure, table};
use super::super::numbers::{BoxPlot, PhasePlot, ReportNumbers};
use super::super::units::ColumnUnit;
use super::parts::{capital, folded, plot_figure};
use trial::{ConditionRow, Quantity};

pub(super) fn conditions(report: &Report<'_>, numbers: &ReportNumbers) -> String {
    let mut html = plots("box", &numbers.boxes, |plot| {
        (box_alt(plot), format!("{} per {}", capital(plot.quantity), plot.per.name()))
    });
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

pub(super) fn phase(numbers: &ReportNumbers) -> String {
    if numbers.phases.is_empty() {
        return String::new();
    }
    plots("phase", &numbers.phases, |plot| {
        let caption = format!(
            "{} against the right leg's angle while the robot is fully inside: mean over strides, with \
             one standard deviation from stride to stride",
            capital(plot.quantity)
        );
        (phase_alt(plot), caption)
    })
}

/// Plots side by side; `texts` are what one shows, in words, and its caption.
fn plots<P>(name: &str, plots: &[P], texts: impl Fn(&P) -> (String, String)) -> String {
    let figures = plots.iter().enumerate().map(|(at, plot)| {
        let (alt, caption) = texts(plot);
        plot_figure(&format!("{name}-{at}"), "", &alt, &caption)
    });
    format!("<div class=\"plots\">\n{}</div>\n", figures.collect::<String>())
}

fn box_alt(plot: &BoxPlot) -> String {
    let BoxPlot { quantity, unit, per, conditions } = plot;
    let medians: Vec<_> =
        conditions.iter().map(|c| format!("{} {}", c.name, figure(c.median.0))).collect();
    let unit = if unit.is_empty() { String::new() } else { format!(" in {unit}") };
    let per = per.name();
    format!("Box plot of {quantity} per {per} by condition; medians{unit}: {}", medians.join(", "))
}

fn phase_alt(plot: &PhasePlot) -> String {
    let strides: Vec<_> =
        plot.conditions.iter().map(|c| format!("{} {} strides", c.name, c.strides)).collect();
    format!("{} in N over a turn of the right leg: {}", capital(plot.quantity), strides.join(", "))
}
