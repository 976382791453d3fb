//! Figures over time with the robot's passage shaded: drag and lift; forces, leg angles and power;
//! a proposed window over its drag.

use std::f64::consts::TAU;
use std::ops::Range;

use trial::{NoWindow, Proposal, Trace};

use super::{
    BOTTOM_MARGIN, Colour, CurvePen, DASHED, Figure, LegendKey, PALE, Panel, Pen, PlotAxis, SOLID,
    Size, Style, TOP, TraceCurve, ValueRange, draw_curves, draw_legend, empty_figure, line, number,
    palette, point, range_with_zero, smoothed, stride_s, titled, top_below, wide_area,
};

const HEIGHT: f64 = 230.0;

/// Draws drag (−Fx) and lift (Fz) in N against time in s: means over a stride, with all values pale
/// in the background. Without strides only the values are drawn.
pub fn drag_lift_figure(size: Size, title: &str, trace: &Trace, passage: &Passage) -> Figure {
    let (Some(&low), Some(&high)) = (trace.t_s.first(), trace.t_s.last()) else {
        return empty_figure(size, title, "no rows");
    };
    let [fx, _, fz, ..] = &trace.wrench;
    if fx.is_empty() || fz.is_empty() {
        let reason = "no forces: the log has no sensors, or no calibration was given";
        return empty_figure(size, title, reason);
    }
    let drag: Vec<f64> = fx.iter().map(|force| -force).collect();
    let lift = fz;
    let width_s = stride_s(trace);
    let raw = [&drag, lift].map(|force| line(&trace.t_s, force.iter().copied()));
    let means = width_s.map(|width_s| {
        [&drag, lift].map(|force| line(&trace.t_s, smoothed(&trace.t_s, force, width_s)))
    });
    let x = PlotAxis::linear("time", "s", ValueRange { low, high });
    let [drag_text, lift_text] = match &means {
        Some(_) => ["drag −Fx, stride mean", "lift Fz, stride mean"],
        None => ["drag (−Fx)", "lift (Fz)"],
    };
    let mut keys = vec![LegendKey::Line(drag_text, SOLID), LegendKey::Line(lift_text, DASHED)];
    keys.extend(passage.keys(x.range));
    let top = top_below(size, &keys);
    let panel = Panel {
        area: wide_area(size, top, HEIGHT),
        x,
        y: PlotAxis::linear("force", "N", range_with_zero(&raw)).padded(0.06),
    };
    let mut canvas = titled(size, top + HEIGHT + BOTTOM_MARGIN + 4.0, title);
    passage.draw(&mut canvas, &panel);
    panel.draw_grid(&mut canvas);
    let [drag, lift] = &raw;
    let lines = match &means {
        Some([mean_drag, mean_lift]) => {
            vec![(lift, PALE[1]), (drag, PALE[0]), (mean_lift, DASHED), (mean_drag, SOLID)]
        }
        None => vec![(lift, DASHED), (drag, SOLID)],
    };
    draw_curves(&mut canvas, &panel, &lines);
    panel.draw_frame(&mut canvas);
    draw_legend(&mut canvas, panel.area, &keys);
    canvas
}

const STACK_HEIGHT: f64 = 92.0;
const GAP: f64 = 12.0;
const LEGEND: f64 = 20.0;

struct StackRow {
    axis: (&'static str, &'static str),
    lines: Vec<(TraceCurve, CurvePen)>,
    keys: Vec<LegendKey<'static>>,
}

/// Draws Fx, Fy, Fz in N, both leg angles in rad within a turn, and the electrical power of both
/// motors in W, between two times in s. Omits columns that the trace lacks.
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
    // The legend of the first panel also explains the shading.
    let shading = passage.keys(time.range);
    let mut bottom = top_below(size, panels[0].keys.iter().chain(&shading)) - GAP;
    let mut tops = Vec::new();
    for (i, row) in panels.iter().enumerate() {
        let legend = if i == 0 || row.keys.is_empty() { 0.0 } else { LEGEND };
        tops.push(bottom + GAP + legend);
        bottom += GAP + legend + STACK_HEIGHT;
    }
    let mut canvas = titled(size, bottom + BOTTOM_MARGIN + 4.0, title);
    for (i, (row, &top)) in panels.iter().zip(&tops).enumerate() {
        let area = wide_area(size, top, STACK_HEIGHT);
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
    /// A whole turn for angles; otherwise the range of the lines, including zero.
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

/// A separate line per turn, so that no line runs back.
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

const THIN: CurvePen = (Colour(0x6b8fa8), Pen::Round(0.8));
const MODEL: CurvePen = (Colour(0x000000), Pen::Round(2.0));

pub fn window_figure(
    size: Size,
    title: &str,
    time_s: &[f64],
    drag_n: &[f64],
    found: Result<&Proposal, &NoWindow>,
) -> Figure {
    let (Some(&low), Some(&high)) = (time_s.first(), time_s.last()) else {
        return empty_figure(size, title, "no forces");
    };
    let drag = line(time_s, drag_n.iter().copied());
    let panel = Panel {
        area: wide_area(size, TOP, HEIGHT),
        x: PlotAxis::linear("time", "s", ValueRange { low, high }),
        y: PlotAxis::linear("drag (−Fx)", "N", range_with_zero([&drag])).padded(0.06),
    };
    let mut canvas = titled(size, TOP + HEIGHT + BOTTOM_MARGIN + 4.0, title);
    let proposal = match found {
        Ok(proposal) => proposal,
        Err(reason) => {
            panel.draw_grid(&mut canvas);
            draw_curves(&mut canvas, &panel, &[(&drag, THIN)]);
            panel.draw_frame(&mut canvas);
            let at = (panel.area.left, panel.area.top - 10.0);
            canvas.text(at, &format!("no window: {reason}"), Style::START);
            return canvas;
        }
    };
    let (t_enter_s, t_exit_s) = (proposal.t_enter_s, proposal.t_exit_s);
    Passage::new([t_enter_s, t_exit_s], None, 0.0).draw(&mut canvas, &panel);
    panel.draw_grid(&mut canvas);
    let model = line(time_s, time_s.iter().map(|&t| proposal.drag_at(t)));
    draw_curves(&mut canvas, &panel, &[(&drag, THIN), (&model, MODEL)]);
    let (colour, pen) = DASHED;
    for (time_s, style, shift) in [(t_enter_s, Style::START, 4.0), (t_exit_s, Style::END, -4.0)] {
        let (x, _) = panel.place(time_s, 0.0);
        let [left, top, bottom] = [x, panel.area.top, panel.area.bottom()].map(number);
        canvas.stroke(format!("M{left} {top}V{bottom}"), colour, pen);
        canvas.text((x + shift, panel.area.top + 14.0), &format!("{time_s:.3} s"), style);
    }
    let confidence = format!("window, confidence {:.2}", proposal.confidence);
    let keys = [
        LegendKey::Line("drag", THIN),
        LegendKey::Line("fitted", MODEL),
        LegendKey::Line(&confidence, DASHED),
    ];
    panel.draw_frame(&mut canvas);
    draw_legend(&mut canvas, panel.area, &keys);
    canvas
}

/// Passage through a channel, s on the log's clock, from first contact of the front to last contact
/// of the rear. In that time the front covers the length of channel plus robot; entry, and exit,
/// each take the robot's share of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Passage {
    /// Times partly within the channel; without `wholly_s`, the whole time of the passage.
    pub partly_s: Vec<[f64; 2]>,
    /// `None` if the robot's length is unknown, or longer than the channel.
    pub wholly_s: Option<[f64; 2]>,
    partly_name: &'static str,
}

impl Passage {
    pub fn new([enter, exit]: [f64; 2], robot_m: Option<f64>, channel_m: f64) -> Self {
        let entering_s = robot_m.map(|robot_m| robot_m / (robot_m + channel_m) * (exit - enter));
        let wholly_s = entering_s.map(|entering_s| [enter + entering_s, exit - entering_s]);
        let wholly_s = wholly_s.filter(|[from, to]| from < to);
        let around = |[from, to]: [f64; 2]| vec![[enter, from], [to, exit]];
        let partly_s = wholly_s.map_or_else(|| vec![[enter, exit]], around);
        let both = robot_m.is_some();
        let partly_name = if both { "entering, leaving" } else { "in the channel" };
        Self { partly_s, wholly_s, partly_name }
    }

    pub(super) fn draw(&self, canvas: &mut Figure, panel: &Panel) {
        let partly = self.partly_s.iter().map(|span| (span, palette::PARTLY_INSIDE));
        let wholly = self.wholly_s.iter().map(|span| (span, palette::INSIDE));
        for (&[from, to], colour) in partly.chain(wholly) {
            let ValueRange { low, high } = panel.x.range;
            let (from, to) = (from.max(low), to.min(high));
            if from < to {
                let [left, right] = [from, to].map(|time_s| panel.place(time_s, 0.0).0);
                let [right, top, bottom] = [right, panel.area.top, panel.area.bottom()].map(number);
                let corner = point(left, panel.area.top);
                canvas.fill(format!("M{corner}V{bottom}H{right}V{top}Z"), colour);
            }
        }
    }

    pub(super) fn keys(&self, ValueRange { low, high }: ValueRange) -> Vec<LegendKey<'static>> {
        let is_seen = |span: &[f64; 2]| span[0] < high && span[1] > low;
        let partly = LegendKey::Area(self.partly_name, palette::PARTLY_INSIDE);
        let wholly = LegendKey::Area("fully inside", palette::INSIDE);
        let keys = [
            (self.partly_s.iter().any(is_seen), partly),
            (self.wholly_s.iter().any(is_seen), wholly),
        ];
        keys.into_iter().filter_map(|(is_seen, key)| is_seen.then_some(key)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_paper_s_robot_is_wholly_within_its_channel_for_the_middle_of_the_window() {
        // 18 cm of robot, 28 cm of channel, 46 cm of path.
        let passage = Passage::new([1.0, 5.6], Some(0.18), 0.28);
        let (partly, wholly) = (passage.partly_s, passage.wholly_s);
        let near =
            |[a, b]: [f64; 2], [c, d]: [f64; 2]| (a - c).abs() < 1e-12 && (b - d).abs() < 1e-12;
        assert!(near(partly[0], [1.0, 2.8]) && near(partly[1], [3.8, 5.6]));
        assert!(near(wholly.unwrap(), [2.8, 3.8]));
    }

    #[test]
    fn a_robot_that_is_too_long_or_unknown_is_never_wholly_within() {
        for robot_m in [Some(0.4), None] {
            let passage = Passage::new([1.0, 2.0], robot_m, 0.28);
            assert_eq!((passage.partly_s, passage.wholly_s), (vec![[1.0, 2.0]], None));
        }
    }
}
