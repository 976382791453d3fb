//! Forces, leg angles and power over one time axis.

use std::f64::consts::TAU;

use super::super::panel::{BOTTOM_MARGIN, Panel};
use super::super::scale::{PlotAxis, Spacing};
use super::super::size::Size;
use super::super::svg::Figure;
use super::{
    CurvePen, DASHED, LegendKey, Passage, SOLID, TraceCurve, canvas, draw_legend, draw_lines,
    draw_title, empty_figure, line, range_with_zero, top_below, wide_area,
};
use trial::Trace;

const HEIGHT: f64 = 92.0;
const GAP: f64 = 12.0;
/// Room for a legend above a panel.
const LEGEND: f64 = 20.0;

struct StackRow<'a> {
    axis: (&'a str, &'a str),
    lines: Vec<(TraceCurve, CurvePen)>,
    keys: Vec<LegendKey<'a>>,
}

/// Draws Fx, Fy, Fz in N, the angles of both legs in rad within a turn, and the electrical power of
/// both motors in W, between two times in s, with the passage shaded. What the trace does not have
/// is left out.
pub fn stack_figure(
    size: Size,
    title: &str,
    trace: &Trace,
    passage: &Passage,
    range_s: [f64; 2],
) -> Figure {
    let rows = trace.t_s.partition_point(|&t| t < range_s[0])
        ..trace.t_s.partition_point(|&t| t <= range_s[1]);
    let time_s = &trace.t_s[rows.clone()];
    let part =
        |column: &'_ [f64]| -> Option<Vec<f64>> { column.get(rows.clone()).map(<[f64]>::to_vec) };
    let panels = stack_rows(trace, time_s, part);
    if panels.is_empty() || time_s.is_empty() {
        return empty_figure(size, title, "nothing to draw: neither forces nor telemetry");
    }

    let time = PlotAxis::new("time", "s", Spacing::Linear, range_s[0], range_s[1]);
    // The first panel's row also says what the shading is.
    let shading = passage.keys(time.range);
    let mut bottom = top_below(size, panels[0].keys.iter().chain(&shading)) - GAP;
    let mut tops = Vec::new();
    for (i, row) in panels.iter().enumerate() {
        let legend = if i == 0 || row.keys.is_empty() { 0.0 } else { LEGEND };
        tops.push(bottom + GAP + legend);
        bottom += GAP + legend + HEIGHT;
    }
    let mut canvas = canvas(size, bottom + BOTTOM_MARGIN + 4.0);
    draw_title(&mut canvas, title);
    for (i, (row, &top)) in panels.iter().zip(&tops).enumerate() {
        let area = wide_area(size, top, HEIGHT);
        let panel = Panel { area, x: time.clone(), y: row.y_axis() };
        passage.draw(&mut canvas, &panel);
        panel.draw_grid(&mut canvas);
        let lines: Vec<_> = row.lines.iter().rev().map(|(line, pen)| (line, *pen)).collect();
        draw_lines(&mut canvas, &panel, &lines);
        canvas.frame(area, super::super::palette::INK);
        panel.draw_y_labels(&mut canvas);
        if i + 1 == panels.len() {
            panel.draw_x_labels(&mut canvas);
        }
        let shading = if i == 0 { &shading[..] } else { &[] };
        draw_legend(&mut canvas, area, row.keys.iter().chain(shading));
    }
    canvas.finish()
}

impl StackRow<'_> {
    /// A whole turn for angles; else what the lines cover, with zero.
    fn y_axis(&self) -> PlotAxis {
        let (name, unit) = self.axis;
        let (low, high) = range_with_zero(self.lines.iter().map(|(line, _)| line));
        match unit == "rad" {
            true => PlotAxis::new(name, unit, Spacing::Linear, 0.0, TAU),
            false => PlotAxis::new(name, unit, Spacing::Linear, low, high).padded(0.06),
        }
    }
}

/// One row for each force, for the legs and for the power, as far as the trace has them; `part` cuts a
/// column to `time_s`.
fn stack_rows<'a>(
    trace: &Trace,
    time_s: &[f64],
    part: impl Fn(&[f64]) -> Option<Vec<f64>>,
) -> Vec<StackRow<'a>> {
    let mut panels = Vec::new();
    for (axis, name) in ["Fx", "Fy", "Fz"].into_iter().enumerate() {
        if let Some(force) = part(&trace.wrench[axis]).filter(|force| !force.is_empty()) {
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
        if let Some(angle) = part(angle).filter(|angle| !angle.is_empty()) {
            legs.lines.extend(turns(time_s, &angle).into_iter().map(|turn| (turn, pen)));
            legs.keys.push(LegendKey::Line(side, pen));
        }
        if let Some(watts) = part(watts).filter(|watts| !watts.is_empty()) {
            power.lines.push((line(time_s, watts), pen));
            power.keys.push(LegendKey::Line(side, pen));
        }
    }
    if let Some(watts) = part(&trace.power_w).filter(|watts| !watts.is_empty()) {
        power.lines.push((line(time_s, watts), SOLID));
    }
    panels.extend([legs, power].into_iter().filter(|row| !row.lines.is_empty()));
    panels
}

/// Angles within a turn, one line for each, so that none leads back from its end to its start.
fn turns(time_s: &[f64], angle_rad: &[f64]) -> Vec<TraceCurve> {
    let turn = |i: usize| (angle_rad[i] / TAU).floor();
    let mut lines = Vec::new();
    let mut start = 0;
    for i in 1..=angle_rad.len() {
        if i == angle_rad.len() || turn(i) != turn(start) {
            let within = angle_rad[start..i].iter().map(|angle| angle.rem_euclid(TAU));
            lines.push(line(&time_s[start..i], within));
            start = i;
        }
    }
    lines
}
