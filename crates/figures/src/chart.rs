//! Lines and points on one pair of axes, linear or logarithmic.

use super::canvas::{Figure, Pen, Rect, polyline};
use super::legend::Legend;
use super::palette::{self, Colour};
use super::panel::Panel;
use super::scale::PlotAxis;
use super::size::Size;

/// How the points of a series are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChartMark {
    /// As a line through the points, in their order.
    Line,
    /// As points.
    Points,
    /// As points joined by a line.
    Both,
}

/// Points that belong together.
#[derive(Clone, Debug)]
pub struct Series {
    /// What the legend calls it.
    pub label: String,
    /// (x, y) in the units of the axes. Those that are not finite, or not positive on a logarithmic
    /// axis, are left out.
    pub points: Vec<(f64, f64)>,
    /// How it is drawn.
    pub mark: ChartMark,
}

/// One pair of axes with any number of series and a legend beside it.
#[derive(Clone, Debug)]
pub struct Chart {
    /// Title over the picture.
    pub title: String,
    /// Horizontal axis.
    pub x: PlotAxis,
    /// Vertical axis.
    pub y: PlotAxis,
    /// What is drawn, first below.
    pub series: Vec<Series>,
}

const WIDTH: f64 = 520.0;
const HEIGHT: f64 = 340.0;

impl Chart {
    /// Draws the chart.
    pub fn figure(&self, size: Size) -> Figure {
        let labels: Vec<&str> = self.series.iter().map(|series| series.label.as_str()).collect();
        let legend = Legend::new(size, &labels);
        let usual = legend.panel(WIDTH, HEIGHT);
        let area = Rect { height: HEIGHT.min(usual.width), ..usual };
        let mut canvas = legend.figure(&self.title, [area; 2]);
        let panel = Panel { area, x: self.x.clone(), y: self.y.clone() };
        panel.draw_grid(&mut canvas);
        canvas.clipped(area, |canvas| {
            for (i, series) in self.series.iter().enumerate() {
                series.draw(canvas, &panel, palette::series(i));
            }
        });
        panel.draw_frame(&mut canvas);
        legend.draw(&mut canvas, [area; 2], |canvas, i, [from, to]| {
            let middle = (f64::midpoint(from.0, to.0), from.1);
            self.series[i].draw_marks(canvas, &[from, to], &[middle], palette::series(i));
        });
        canvas
    }
}

impl Series {
    fn draw(&self, canvas: &mut Figure, panel: &Panel, colour: Colour) {
        let placed = self.points.iter().map(|&(x, y)| panel.place(x, y));
        let placed: Vec<_> = placed.filter(|(x, y)| x.is_finite() && y.is_finite()).collect();
        self.draw_marks(canvas, &placed, &placed, colour);
    }

    fn draw_marks(
        &self,
        canvas: &mut Figure,
        line: &[(f64, f64)],
        points: &[(f64, f64)],
        colour: Colour,
    ) {
        if self.mark != ChartMark::Points && !line.is_empty() {
            canvas.stroke(polyline(line.iter().copied()), colour, Pen::Round(1.6));
        }
        if self.mark != ChartMark::Line {
            for &centre in points {
                canvas.circle(centre, 3.2, colour);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::scale::Spacing;
    use super::*;

    #[test]
    fn points_that_cannot_be_placed_are_left_out() {
        let axis = || PlotAxis::new("rows", "", Spacing::Log, 1.0, 1000.0);
        let series = Series {
            label: "a < b".into(),
            points: vec![(1.0, 10.0), (0.0, 10.0), (10.0, f64::NAN), (100.0, -1.0), (1e3, 1e3)],
            mark: ChartMark::Both,
        };
        let chart = Chart { title: "t".into(), x: axis(), y: axis(), series: vec![series] };
        let figure = chart.figure(Size::Screen);
        // Two points and one in the legend.
        assert_eq!(figure.svg().matches("<circle").count(), 3);
        assert!(figure.svg().contains("a &lt; b") && !figure.svg().contains("NaN"));
    }
}
