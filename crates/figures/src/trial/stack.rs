//! Forces, leg angles and power over one time axis.

use std::f64::consts::TAU;
use std::ops::Range;

use super::{
    BOTTOM_MARGIN, CurvePen, DASHED, Figure, LegendKey, Panel, Passage, PlotAxis, SOLID, Size,
    TraceCurve, ValueRange, draw_curves, draw_legend, empty_figure, line, range_with_zero, titled,
    top_below, wide_area,
};
use trial::Trace;

const HEIGHT: f64 = 92.0;
const GAP: f64 = 12.0;
/// Room for a legend above a panel.
const LEGEND: f64 = 20.0;

struct StackRow {
    axis: (&'static str, &'static str),
    lines: Vec<(TraceCurve, CurvePen)>,
    keys: Vec<LegendKey<'static>>,
}

/// Draws Fx, Fy, Fz in N, the angles of both legs in rad within a turn, and the electrical power of
/// both motors in W, between two times in s, with the passage shaded. What the trace does not have
/// is left out.
pub fn stack_figure(
    size: Size,
    title: &str,
    trace: &Trace,
    passage: &Passage,
    [low, high]: [f64; 2],
) -> Figure {
    let rows = trace.t_s.partition_point(|&t| t < low)..trace.t_s.partition_point(|&t| t <= high);
    let panels = stack_rows(trace, rows);
    if panels.is_empty() {
        return empty_figure(size, title, "nothing to draw: neither forces nor telemetry");
    }

    let time = PlotAxis::linear("time", "s", ValueRange { low, high });
    // The first panel's row also says what the shading is.
    let shading = passage.keys(time.range);
    let mut bottom = top_below(size, panels[0].keys.iter().chain(&shading)) - GAP;
    let mut tops = Vec::new();
    for (i, row) in panels.iter().enumerate() {
        let legend = if i == 0 || row.keys.is_empty() { 0.0 } else { LEGEND };
        tops.push(bottom + GAP + legend);
        bottom += GAP + legend + HEIGHT;
    }
    let mut canvas = titled(size, bottom + BOTTOM_MARGIN + 4.0, title);
    for (i, (row, &top)) in panels.iter().zip(&tops).enumerate() {
        let area = wide_area(size, top, HEIGHT);
        let panel = Panel { area, x: time.clone(), y: row.y_axis() };
        passage.draw(&mut canvas, &panel);
        panel.draw_grid(&mut canvas);
        let lines: Vec<_> = row.lines.iter().rev().map(|(line, pen)| (line, *pen)).collect();
        draw_curves(&mut canvas, &panel, &lines);
        panel.draw_stacked_frame(&mut canvas, i + 1 == panels.len());
        let shading = if i == 0 { &shading[..] } else { &[] };
        draw_legend(&mut canvas, area, row.keys.iter().chain(shading));
    }
    canvas
}

impl StackRow {
    /// A whole turn for angles; else what the lines cover, with zero.
    fn y_axis(&self) -> PlotAxis {
        let (name, unit) = self.axis;
        match unit {
            "rad" => PlotAxis::linear(name, unit, ValueRange { low: 0.0, high: TAU }),
            _ => {
                let range = range_with_zero(self.lines.iter().map(|(line, _)| line));
                PlotAxis::linear(name, unit, range).padded(0.06)
            }
        }
    }
}

/// One panel for each force, for the legs and for the power, as far as the trace has them in these rows.
fn stack_rows(trace: &Trace, rows: Range<usize>) -> Vec<StackRow> {
    let time_s = &trace.t_s[rows.clone()];
    let part = |column: &'_ Vec<f64>| -> Option<Vec<f64>> {
        column.get(rows.clone()).filter(|part| !part.is_empty()).map(<[f64]>::to_vec)
    };
    let mut panels = Vec::new();
    for (force, name) in trace.wrench.iter().zip(["Fx", "Fy", "Fz"]) {
        if let Some(force) = part(force) {
            let lines = vec![(line(time_s, force), SOLID)];
            panels.push(StackRow { axis: (name, "N"), lines, keys: vec![] });
        }
    }
    let sides = [
        (&trace.right_leg_rad, &trace.right_power_w, SOLID, "right"),
        (&trace.left_leg_rad, &trace.left_power_w, DASHED, "left"),
    ];
    let mut legs = StackRow { axis: ("leg angle", "rad"), lines: vec![], keys: vec![] };
    let mut power = StackRow { axis: ("power", "W"), lines: vec![], keys: vec![] };
    for (angle, watts, pen, side) in sides {
        if let Some(angle) = part(angle) {
            legs.lines.extend(turns(time_s, &angle).into_iter().map(|turn| (turn, pen)));
            legs.keys.push(LegendKey::Line(side, pen));
        }
        if let Some(watts) = part(watts) {
            power.lines.push((line(time_s, watts), pen));
            power.keys.push(LegendKey::Line(side, pen));
        }
    }
    power.lines.extend(part(&trace.power_w).map(|watts| (line(time_s, watts), SOLID)));
    panels.extend([legs, power].into_iter().filter(|row| !row.lines.is_empty()));
    panels
}

/// Angles within a turn, one line for each, so that none leads back from its end to its start.
fn turns(time_s: &[f64], angle_rad: &[f64]) -> Vec<TraceCurve> {
    let turn = |angle: &f64| (angle / TAU).floor();
    let mut rest = time_s;
    let lines = angle_rad.chunk_by(|a, b| turn(a) == turn(b)).map(|angles| {
        let (time_s, later) = rest.split_at(angles.len());
        rest = later;
        line(time_s, angles.iter().map(|angle| angle.rem_euclid(TAU)))
    });
    lines.collect()
}
