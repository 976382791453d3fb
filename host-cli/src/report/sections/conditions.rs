//! Statistics by condition, and forces over a stride.

use super::super::Report;
use super::super::markup::{Cell, figure, table};
use super::super::numbers::{BoxPlot, PhasePlot, ReportNumbers};
use super::parts::{capital, plot_figure, range, short};
use crate::trial::{ConditionRow, Interval, Per, Quantity};

pub(super) fn conditions(report: &Report<'_>, numbers: &ReportNumbers) -> String {
    let mut html = String::new();
    html.push_str("<div class=\"plots\">\n");
    for (at, plot) in numbers.boxes.iter().enumerate() {
        let caption = format!("{} per {}", capital(plot.quantity), plot.per.name());
        html += &plot_figure(&format!("box-{at}"), "", &box_alt(plot), &caption);
    }
    html.push_str("</div>\n");
    for quantity in Quantity::ALL {
        let of_quantity = report.conditions.iter().filter(|row| row.quantity == quantity);
        let rows: Vec<Vec<Cell>> = of_quantity.map(condition_cells).collect();
        if rows.is_empty() {
            continue;
        }
        let unit = if quantity.unit().is_empty() {
            String::new()
        } else {
            format!(" ({})", quantity.unit())
        };
        let reference = report.conditions.iter().find_map(|row| row.difference.as_ref());
        let against = reference
            .map_or("difference".to_owned(), |difference| format!("less {}", difference.reference));
        let caption = format!("{}{unit}", capital(quantity.name()));
        let header = [
            ("condition", true),
            ("per", true),
            ("n", false),
            ("mean", false),
            ("95 % of mean", false),
            ("sd", false),
            ("median", false),
            ("quartiles", false),
            ("whiskers", false),
            ("outliers", false),
            (against.as_str(), false),
            ("95 % of it", false),
        ];
        // Without a reference there is nothing to show in the last two.
        let shown = if reference.is_some() { header.len() } else { header.len() - 2 };
        let rows: Vec<_> = rows
            .into_iter()
            .map(|mut row| {
                row.truncate(shown);
                row
            })
            .collect();
        html += &table(&caption, &header[..shown], &rows);
    }
    html
}

fn condition_cells(row: &ConditionRow) -> Vec<Cell> {
    let s = &row.statistics;
    let difference = row.difference.as_ref();
    vec![
        Cell::Text(row.condition.clone()),
        Cell::from(row.per.name()),
        Cell::from(s.n as u64),
        short(s.mean),
        range(s.mean_95),
        short(s.sd),
        short(s.median),
        range(Some(Interval { low: s.q1, high: s.q3 })),
        range(Some(Interval { low: s.whisker_low, high: s.whisker_high })),
        Cell::from(s.outliers.len() as u64),
        short(difference.map(|difference| difference.mean)),
        range(difference.and_then(|difference| difference.mean_95)),
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
    let per = match per {
        Per::Trial => "trial",
        Per::Stride => "stride",
    };
    format!("Box plot of {quantity} per {per} by condition; medians{unit}: {}", medians.join(", "))
}

fn phase_alt(plot: &PhasePlot) -> String {
    let strides: Vec<_> =
        plot.conditions.iter().map(|c| format!("{} {} strides", c.name, c.strides)).collect();
    format!("{} in N over a turn of the right leg: {}", capital(plot.quantity), strides.join(", "))
}
