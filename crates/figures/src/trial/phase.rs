//! Drag and lift against the phase of the leg.

use std::f64::consts::{PI, TAU};

use super::{
    BOTTOM_MARGIN, CurvePen, DASHED, Figure, LEFT_MARGIN, LegendKey, Panel, PlotAxis, Rect, SOLID,
    Size, Style, ValueRange, WIDTH, draw_legend, empty_figure, palette, point, titled, top_below,
    wide_area,
};
use trial::{PhaseForce, PhaseProfile};

const HEIGHT: f64 = 104.0;
const PITCH: f64 = 134.0;
const GAP: f64 = 12.0;

/// Draws drag (left) and lift (right) in N over a turn of the right leg, one row per condition:
/// mean and one standard deviation between strides, on one scale.
pub fn phase_figure(size: Size, title: &str, conditions: &[(String, PhaseProfile)]) -> Figure {
    if conditions.is_empty() {
        return empty_figure(size, title, "no strides with forces");
    }
    let forces = conditions.iter().flat_map(|(_, profile)| [&profile.drag, &profile.lift]);
    let ends = forces.flat_map(|force| {
        let both = force.mean_n.iter().zip(&force.sd_n);
        both.flat_map(|(mean, sd)| [mean - sd, mean + sd])
    });
    let range = ValueRange::over(ends).including(0.0);
    let rows = conditions.len() as f64;
    let keys = [
        LegendKey::Line("drag (−Fx), mean", SOLID),
        LegendKey::Line("lift (Fz), mean", DASHED),
        LegendKey::Area("± 1 sd, stride to stride", palette::SPREAD),
    ];
    let top = top_below(size, &keys);
    let height = top + 14.0 + PITCH * rows - 30.0 + BOTTOM_MARGIN + 4.0;
    let mut canvas = titled(size, height, title);
    let width = (size.width(WIDTH) - 2.0 * (LEFT_MARGIN + 8.0) - GAP - 16.0) / 2.0;
    for (row, (name, profile)) in conditions.iter().enumerate() {
        let columns = [("drag", &profile.drag, SOLID), ("lift", &profile.lift, DASHED)];
        for (column, (quantity, force, pen)) in columns.into_iter().enumerate() {
            let left = LEFT_MARGIN + 8.0 + (width + LEFT_MARGIN + GAP) * column as f64;
            let top = top + 14.0 + PITCH * row as f64;
            let area = Rect { left, top, width, height: HEIGHT };
            let panel = Panel {
                area,
                x: PlotAxis::linear("right leg angle", "rad", ValueRange { low: 0.0, high: TAU }),
                y: PlotAxis::linear(quantity, "N", range).padded(0.04),
            };
            draw_panel(&mut canvas, &panel, &profile.phase_rad, (force, pen));
            let label = format!("{name}: {} strides", profile.strides);
            canvas.text((area.left, area.top - 6.0), &label, Style::START);
            draw_turn(&mut canvas, &panel, row + 1 == conditions.len());
        }
    }
    draw_legend(&mut canvas, wide_area(size, top - 4.0, HEIGHT), &keys);
    canvas
}

fn draw_panel(
    canvas: &mut Figure,
    panel: &Panel,
    phase_rad: &[f64],
    (force, (colour, pen)): (&PhaseForce, CurvePen),
) {
    let placed = |sign: f64| -> Vec<String> {
        let values: Vec<f64> =
            force.mean_n.iter().zip(&force.sd_n).map(|(mean, sd)| mean + sign * sd).collect();
        // Repeat the values at both ends, so that the curve reaches both edges.
        let n = values.len();
        let turn = (0..n).map(|i| (i, 0.0));
        let around = [(n - 1, -TAU)].into_iter().chain(turn).chain([(0, TAU)]);
        let positions = around.map(|(i, turn)| panel.place(phase_rad[i] + turn, values[i]));
        positions.map(|(x, y)| point(x, y)).collect()
    };
    let (below, mean, mut above) = (placed(-1.0), placed(0.0), placed(1.0));
    above.reverse();
    canvas.clipped(panel.area, |canvas| {
        canvas.fill(format!("M{}L{}Z", below.join("L"), above.join("L")), palette::SPREAD);
        panel.draw_zero(canvas);
        canvas.stroke(format!("M{}", mean.join("L")), colour, pen);
    });
    panel.draw_stacked_frame(canvas, false);
}

fn draw_turn(canvas: &mut Figure, panel: &Panel, labelled: bool) {
    let bottom = panel.area.bottom();
    for (quarter, label) in ["0", "π/2", "π", "3π/2", "2π"].into_iter().enumerate() {
        let (x, _) = panel.place(0.5 * PI * quarter as f64, 0.0);
        canvas.line((x, bottom), (x, bottom + 4.0), palette::INK, 1.0);
        if labelled {
            canvas.text((x, bottom + 16.0), label, Style::LABEL);
        }
    }
    if labelled {
        let middle = panel.area.left + panel.area.width / 2.0;
        canvas.text((middle, bottom + 33.0), &panel.x.title(), Style::LABEL);
    }
}
