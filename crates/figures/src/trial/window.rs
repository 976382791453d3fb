//! A proposed window over the drag that it was found in, for review.

use super::{
    BOTTOM_MARGIN, Colour, CurvePen, DASHED, Figure, LegendKey, Panel, Passage, Pen, PlotAxis,
    Size, Style, TOP, ValueRange, draw_curves, draw_legend, empty_figure, line, number,
    range_with_zero, titled, wide_area,
};
use trial::{NoWindow, Proposal};

const HEIGHT: f64 = 230.0;
const THIN: CurvePen = (Colour(0x6b8fa8), Pen::Round(0.8));
const MODEL: CurvePen = (Colour(0x000000), Pen::Round(2.0));

/// Draws the drag in N over time in s, and what was found in it, or why nothing was.
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
    Passage { t_enter_s, t_exit_s, entering_s: None }.draw(&mut canvas, &panel);
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
