//! The figure of a body in a channel of beams: drag over position, and the beams that touch below.

use super::canvas::{Figure, Pen, Rect, polyline};
use super::legend::Legend;
use super::palette;
use super::panel::Panel;
use super::scale::{PlotAxis, ValueRange};
use super::size::Size;

/// A line of the figure.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelCurve {
    /// What the legend calls it.
    pub label: String,
    /// Position in m and drag in N.
    pub drag: Vec<(f64, f64)>,
    /// Position in m and beams that touch, per side on average. Empty where not known.
    pub contacts: Vec<(f64, f64)>,
    /// Whether it was measured: it is then drawn below the others, and finer.
    pub measured: bool,
}

const WIDTH: f64 = 560.0;
const DRAG_HEIGHT: f64 = 260.0;
const CONTACTS_HEIGHT: f64 = 110.0;
const GAP: f64 = 18.0;

/// Draws drag over position, and contact counts below.
pub fn channel_figure(size: Size, title: &str, curves: &[ChannelCurve]) -> Figure {
    let labels: Vec<&str> = curves.iter().map(|curve| curve.label.as_str()).collect();
    let legend = Legend::new(size, &labels);
    let upper = legend.panel(WIDTH, DRAG_HEIGHT);
    let lower = Rect { top: upper.bottom() + GAP, height: CONTACTS_HEIGHT, ..upper };
    let mut canvas = legend.figure(title, [upper, lower]);

    let drags = || curves.iter().flat_map(|curve| &curve.drag);
    let counts = || curves.iter().flat_map(|curve| &curve.contacts);
    let most = ValueRange::over(counts().map(|point| point.1).chain([1.0])).high;
    let positions = ValueRange::over(drags().map(|point| point.0));
    let x = PlotAxis::linear("position of the body's middle past the first beam", "m", positions);
    let forces = ValueRange::over(drags().map(|point| point.1).chain([0.0]));
    let drag = PlotAxis::linear("drag", "N", forces).padded(0.04);
    let counts = ValueRange { low: 0.0, high: most + 0.5 };
    let contacts = PlotAxis::linear("beams per side", "", counts);
    let upper = Panel { area: upper, x: x.clone(), y: drag };
    let lower = Panel { area: lower, x, y: contacts };
    for (panel, of) in [(&upper, 0), (&lower, 1)] {
        panel.draw_grid(&mut canvas);
        canvas.clipped(panel.area, |canvas| {
            for measured in [true, false] {
                for (i, curve) in curves.iter().enumerate().filter(|c| c.1.measured == measured) {
                    let points = [&curve.drag, &curve.contacts][of].iter();
                    let path = polyline(points.map(|&(x, y)| panel.place(x, y)));
                    if !path.is_empty() {
                        canvas.stroke(path, palette::series(i), Pen::Round(width(measured)));
                    }
                }
            }
        });
    }
    upper.draw_y_labels(&mut canvas);
    canvas.frame(upper.area, palette::INK);
    lower.draw_frame(&mut canvas);
    legend.draw(&mut canvas, [upper.area, lower.area], |canvas, i, [from, to]| {
        canvas.line(from, to, palette::series(i), width(curves[i].measured));
    });
    canvas
}

/// How wide a curve is stroked.
fn width(measured: bool) -> f64 {
    if measured { 0.8 } else { 1.6 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_curve_is_drawn_once_in_each_panel_that_it_is_known_in() {
        let curve = |label: &str, measured| ChannelCurve {
            label: label.to_owned(),
            drag: vec![(0.0, 0.0), (0.1, 0.2)],
            contacts: if measured { Vec::new() } else { vec![(0.0, 0.0), (0.1, 5.0)] },
            measured,
        };
        let figure =
            channel_figure(Size::Screen, "drag", &[curve("3 cm", false), curve("run 1", true)]);
        let lines =
            |i| figure.svg().matches(&format!("stroke=\"{}\"", palette::series(i).hex())).count();
        // With the one in the legend.
        assert_eq!((lines(0), lines(1)), (3, 2));
        assert!(figure.svg().contains("run 1") && !figure.svg().contains("NaN"));
    }

    #[test]
    fn a_figure_without_curves_is_a_figure() {
        assert!(!channel_figure(Size::Screen, "nothing", &[]).svg().contains("NaN"));
    }
}
