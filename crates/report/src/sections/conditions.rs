//! Statistics by condition, and forces over a stride.

use super::super::Report;
use super::super::markup::{TableCell, figure, table};
use super::super::numbers::{BoxPlot, PhasePlot, ReportNumbers};
use super::super::units::ColumnUnit;
use super::parts::{capital, folded, plot_figure};
use trial::{ConditionRow, Quantity};

pub(super) fn conditions(report: &Report<'_>, numbers: &ReportNumbers) -> String {
    let mut html = String::new();
    html.push_str("<div class=\"plots\">\n");
    for (at, plot) in numbers.boxes.iter().enumerate() {
        let caption = format!("{} per {}", capital(plot.quantity), plot.per.name());
        html += &plot_figure(&format!("box-{at}"), "", &box_alt(plot), &caption);
    }
    html.push_str("</div>\n");
    for quantity in Quantity::ALL {
        let of_quantity: Vec<&ConditionRow> =
            report.conditions.iter().filter(|row| row.quantity == quantity).collect();
        if of_quantity.is_empty() {
            continue;
        }
        let scale =
            ColumnUnit::new(quantity.unit(), of_quantity.iter().map(|row| row.statistics.mean));
        let has_reference = report.conditions.iter().any(|row| row.difference.is_some());
        let cells = |row: &&ConditionRow| condition_cells(row, &scale, has_reference);
        let rows: Vec<Vec<TableCell>> = of_quantity.iter().map(cells).collect();
        let reference = report.conditions.iter().find_map(|row| row.difference.as_ref());
        let less = reference.map(|difference| format!("difference from {}", difference.reference));
        let mut header = vec!["condition", "per", "n", "mean"];
        header.extend(less.as_deref());
        html += &table(&scale.name(&capital(quantity.name())), &header, rows);
        let spread = of_quantity.iter().map(|row| spread_cells(row, &scale));
        let header = ["condition", "per", "sd", "median", "quartiles", "whiskers", "outliers"];
        let caption = format!("Spread of {}", scale.name(quantity.name()));
        html += &folded(&caption, &table(&caption, &header, spread));
    }
    html
}

/// What answers, with intervals.
fn condition_cells(row: &ConditionRow, scale: &ColumnUnit, has_reference: bool) -> Vec<TableCell> {
    let s = &row.statistics;
    let mut cells = vec![
        TableCell::Text(row.condition.clone()),
        TableCell::from(row.per.name()),
        TableCell::from(s.n as u64),
        TableCell::Figure(scale.estimate(Some(s.mean), s.mean_95)),
    ];
    if has_reference {
        let difference = row.difference.as_ref();
        let (mean, interval) = (difference.map(|d| d.mean), difference.and_then(|d| d.mean_95));
        cells.push(TableCell::Figure(scale.estimate(mean, interval)));
    }
    cells
}

/// How the values lie.
fn spread_cells(row: &ConditionRow, scale: &ColumnUnit) -> Vec<TableCell> {
    let s = &row.statistics;
    vec![
        TableCell::Text(row.condition.clone()),
        TableCell::from(row.per.name()),
        TableCell::Figure(scale.value(s.sd)),
        TableCell::Figure(scale.value(Some(s.median))),
        TableCell::Figure(scale.range(s.q1, s.q3)),
        TableCell::Figure(scale.range(s.whisker_low, s.whisker_high)),
        TableCell::from(s.outliers.len() as u64),
    ]
}

pub(super) fn phase(numbers: &ReportNumbers) -> String {
    if numbers.phases.is_empty() {
        return String::new();
    }
    let mut html = String::from("<div class=\"plots\">\n");
    for (at, plot) in numbers.phases.iter().enumerate() {
        let caption = format!(
            "{} against the right leg's angle while the robot is fully inside: mean over strides, with \
             one standard deviation from stride to stride",
            capital(plot.quantity)
        );
        html += &plot_figure(&format!("phase-{at}"), "", &phase_alt(plot), &caption);
    }
    html.push_str("</div>\n");
    html
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
