//! A proposed window over the drag that it was found in, for review.

use super::super::panel::{BOTTOM_MARGIN, Panel};
use super::super::scale::{PlotAxis, Spacing};
use super::super::size::Size;
use super::super::svg::{Anchor, Figure, Style, number};
use super::{
    CurvePen, DASHED, LegendKey, Passage, TOP, canvas, draw_legend, draw_lines, draw_title,
    empty_figure, line, range_with_zero, wide_area,
};
use trial::{NoWindow, Proposal};

const HEIGHT: f64 = 230.0;
const THIN: CurvePen = CurvePen { colour: "#6b8fa8", width: 0.8, dashed: false };
const MODEL: CurvePen = CurvePen { colour: "#000000", width: 2.0, dashed: false };

/// Draws the drag in N over time in s, and what was found in it, or why nothing was.
pub fn window_figure(
    size: Size,
    title: &str,
    time_s: &[f64],
    drag_n: &[f64],
    found: Result<&Proposal, &NoWindow>,
) -> Figure {
    let (Some(&first), Some(&last)) = (time_s.first(), time_s.last()) else {
        return empty_figure(size, title, "no forces");
    };
    let drag = line(time_s, drag_n.iter().copied());
    let (low, high) = range_with_zero([&drag]);
    let panel = Panel {
        area: wide_area(size, TOP, HEIGHT),
        x: PlotAxis::new("time", "s", Spacing::Linear, first, last),
        y: PlotAxis::new("drag (−Fx)", "N", Spacing::Linear, low, high).padded(0.06),
    };
    let mut canvas = canvas(size, TOP + HEIGHT + BOTTOM_MARGIN + 4.0);
    draw_title(&mut canvas, title);
    match found {
        Ok(proposal) => {
            let [enter, exit] = [proposal.t_enter_s, proposal.t_exit_s];
            let passage = Passage { t_enter_s: enter, t_exit_s: exit, entering_s: None };
            passage.draw(&mut canvas, &panel);
            panel.draw_grid(&mut canvas);
            let model = line(time_s, time_s.iter().map(|&t| proposal.drag_at(t)));
            draw_lines(&mut canvas, &panel, &[(&drag, THIN), (&model, MODEL)]);
            for (time_s, anchor, shift) in [(enter, Anchor::Start, 4.0), (exit, Anchor::End, -4.0)]
            {
                let (x, _) = panel.place(time_s, 0.0);
                let (top, bottom) = (number(panel.area.top), number(panel.area.bottom()));
                canvas.dashes(&format!("M{} {top}V{bottom}", number(x)), DASHED.colour, 1.6);
                let label = format!("{time_s:.3} s");
                let at = (x + shift, panel.area.top + 14.0);
                canvas.text(at, &label, Style::LABEL.anchored(anchor));
            }
            let confidence = format!("window, confidence {:.2}", proposal.confidence);
            let keys = [
                LegendKey::Line("drag", THIN),
                LegendKey::Line("fitted", MODEL),
                LegendKey::Line(&confidence, CurvePen { width: 1.6, ..DASHED }),
            ];
            panel.draw_frame(&mut canvas);
            draw_legend(&mut canvas, panel.area, &keys);
        }
        Err(reason) => {
            panel.draw_grid(&mut canvas);
            draw_lines(&mut canvas, &panel, &[(&drag, THIN)]);
            panel.draw_frame(&mut canvas);
            let at = (panel.area.left, panel.area.top - 10.0);
            let text = format!("no window: {reason}");
            canvas.text(at, &text, Style::LABEL.anchored(Anchor::Start));
        }
    }
    canvas.finish()
}
