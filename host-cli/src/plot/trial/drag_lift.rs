//! Drag and lift against time.

use super::super::figure::Figure;
use super::super::panel::{BOTTOM_MARGIN, Panel};
use super::super::scale::{Axis, Spacing};
use super::super::svg::Canvas;
use super::{
    DASHED, Key, Passage, SOLID, TOP, WIDTH, draw_legend, draw_lines, draw_title, empty_figure,
    line, range_with_zero, wide_area,
};
use crate::trial::Trace;

const HEIGHT: f64 = 230.0;

/// Draws drag (−Fx) and lift (Fz) in N against time in s, with the passage shaded.
pub fn drag_lift_figure(title: &str, trace: &Trace, passage: &Passage) -> Figure {
    let (Some(&first), Some(&last)) = (trace.t_s.first(), trace.t_s.last()) else {
        return empty_figure(title, "no rows");
    };
    let [fx, _, fz, ..] = &trace.wrench;
    if fx.is_empty() || fz.is_empty() {
        return empty_figure(
            title,
            "no forces: the log has no sensors, or no calibration was given",
        );
    }
    let drag = line(&trace.t_s, fx.iter().map(|force| -force));
    let lift = line(&trace.t_s, fz.iter().copied());
    let (low, high) = range_with_zero([&drag, &lift]);
    let panel = Panel {
        area: wide_area(TOP, HEIGHT),
        x: Axis::new("time", "s", Spacing::Linear, first, last),
        y: Axis::new("force", "N", Spacing::Linear, low, high).padded(0.06),
    };
    let mut canvas = Canvas::new(WIDTH, TOP + HEIGHT + BOTTOM_MARGIN + 4.0);
    draw_title(&mut canvas, title);
    passage.draw(&mut canvas, &panel);
    panel.draw_grid(&mut canvas);
    draw_lines(&mut canvas, &panel, &[(&lift, DASHED), (&drag, SOLID)]);
    panel.draw_frame(&mut canvas);
    let mut keys = vec![Key::Line("drag (−Fx)", SOLID), Key::Line("lift (Fz)", DASHED)];
    keys.extend(passage.keys());
    draw_legend(&mut canvas, panel.area, &keys);
    Figure::new(canvas.finish())
}
