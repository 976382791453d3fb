//! Drag and lift against time.

use super::{
    BOTTOM_MARGIN, DASHED, Figure, LegendKey, PALE, Panel, Passage, PlotAxis, SOLID, Size,
    ValueRange, draw_curves, draw_legend, empty_figure, line, range_with_zero, smoothed, stride_s,
    titled, top_below, wide_area,
};
use trial::Trace;

const HEIGHT: f64 = 230.0;

/// Draws drag (−Fx) and lift (Fz) in N against time in s, with the passage shaded: their means over a
/// stride, and pale behind them all values. Without strides the values are all there is.
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
    let mut keys = match &means {
        Some(_) => vec![
            LegendKey::Line("drag −Fx, stride mean", SOLID),
            LegendKey::Line("lift Fz, stride mean", DASHED),
        ],
        None => vec![LegendKey::Line("drag (−Fx)", SOLID), LegendKey::Line("lift (Fz)", DASHED)],
    };
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
