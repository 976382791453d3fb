//! Lines and points on one pair of axes, linear or logarithmic.

use super::figure::Figure;
use super::palette;
use super::panel::{BOTTOM_MARGIN, LEFT_MARGIN, Panel};
use super::scale::Axis;
use super::svg::{Anchor, Canvas, Rect, Style, point, text_width};

/// How the points of a series are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
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
    pub mark: Mark,
}

/// One pair of axes with any number of series and a legend beside it.
#[derive(Clone, Debug)]
pub struct Chart {
    /// Title over the picture.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// What is drawn, first below.
    pub series: Vec<Series>,
}

const WIDTH: f64 = 520.0;
const HEIGHT: f64 = 340.0;
const TOP: f64 = 44.0;
const LEGEND_KEY: f64 = 24.0;
const LEGEND_PITCH: f64 = 19.0;

impl Chart {
    /// Draws the chart.
    pub fn figure(&self) -> Figure {
        let labels = self.series.iter().map(|series| text_width(&series.label, Style::LABEL.size));
        let legend = LEGEND_KEY + 24.0 + labels.fold(0.0, f64::max);
        let area = Rect { left: LEFT_MARGIN + 4.0, top: TOP, width: WIDTH, height: HEIGHT };
        let entries = LEGEND_PITCH * self.series.len() as f64;
        let height = (TOP + HEIGHT + BOTTOM_MARGIN + 6.0).max(TOP + entries + 16.0);
        let mut canvas = Canvas::new(area.right() + legend, height);
        let title = Style::TITLE.anchored(Anchor::Start);
        canvas.text((area.left, TOP - 16.0), &self.title, title);

        let panel = Panel { area, x: self.x.clone(), y: self.y.clone() };
        panel.draw_grid(&mut canvas);
        canvas.clipped(area, |canvas| {
            for (i, series) in self.series.iter().enumerate() {
                series.draw(canvas, &panel, colour(i));
            }
        });
        panel.draw_frame(&mut canvas);
        for (i, series) in self.series.iter().enumerate() {
            let (left, y) = (area.right() + 12.0, TOP + 10.0 + LEGEND_PITCH * i as f64);
            let (from, to) = ((left, y), (left + LEGEND_KEY, y));
            series.draw_marks(&mut canvas, &[from, to], &[(left + LEGEND_KEY / 2.0, y)], colour(i));
            let style = Style::LABEL.anchored(Anchor::Start);
            canvas.text((left + LEGEND_KEY + 6.0, y + 4.0), &series.label, style);
        }
        Figure::new(canvas.finish())
    }
}

impl Series {
    fn draw(&self, canvas: &mut Canvas, panel: &Panel, colour: &str) {
        let placed = self.points.iter().map(|&(x, y)| panel.place(x, y));
        let placed: Vec<_> = placed.filter(|(x, y)| x.is_finite() && y.is_finite()).collect();
        self.draw_marks(canvas, &placed, &placed, colour);
    }

    fn draw_marks(
        &self,
        canvas: &mut Canvas,
        line: &[(f64, f64)],
        points: &[(f64, f64)],
        colour: &str,
    ) {
        if self.mark != Mark::Points
            && let Some((first, rest)) = line.split_first()
        {
            let mut path = format!("M{}", point(first.0, first.1));
            for &(x, y) in rest {
                path += &format!("L{}", point(x, y));
            }
            canvas.stroke(&path, colour, 1.6);
        }
        if self.mark != Mark::Line {
            for &centre in points {
                canvas.circle(centre, 3.2, colour);
            }
        }
    }
}

fn colour(series: usize) -> &'static str {
    palette::SERIES[series % palette::SERIES.len()]
}

#[cfg(test)]
mod tests {
    use super::super::scale::Spacing;
    use super::*;

    #[test]
    fn points_that_cannot_be_placed_are_left_out() {
        let axis = || Axis::new("rows", "", Spacing::Log, 1.0, 1000.0);
        let series = Series {
            label: "a < b".into(),
            points: vec![(1.0, 10.0), (0.0, 10.0), (10.0, f64::NAN), (100.0, -1.0), (1e3, 1e3)],
            mark: Mark::Both,
        };
        let chart = Chart { title: "t".into(), x: axis(), y: axis(), series: vec![series] };
        let figure = chart.figure();
        // Two points and one in the legend.
        assert_eq!(figure.svg().matches("<circle").count(), 3);
        assert!(figure.svg().contains("a &lt; b") && !figure.svg().contains("NaN"));
    }
}
