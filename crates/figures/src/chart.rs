//! Curves with a legend beside the panels, or below in a narrow figure: any series, and a body in a
//! channel of beams (drag over position, touching beams below).

use super::axes::{BOTTOM_MARGIN, LEFT_MARGIN, Panel, PlotAxis, ValueRange};
use super::canvas::{Figure, Pen, Rect, Size, Style, polyline, text_width};
use super::palette::{self, Colour};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChartMark {
    Line,
    Points,
    Both,
}

#[derive(Clone, Debug)]
pub struct Series {
    pub label: String,
    /// (x, y) in the units of the axes. Points that cannot be drawn are skipped.
    pub points: Vec<(f64, f64)>,
    pub mark: ChartMark,
}

#[derive(Clone, Debug)]
pub struct Chart {
    pub title: String,
    pub x: PlotAxis,
    pub y: PlotAxis,
    pub series: Vec<Series>,
}

const CHART_WIDTH: f64 = 520.0;
const CHART_HEIGHT: f64 = 340.0;

impl Chart {
    pub fn figure(&self, size: Size) -> Figure {
        let labels: Vec<&str> = self.series.iter().map(|series| series.label.as_str()).collect();
        let legend = Legend::new(size, &labels);
        let usual = legend.panel(CHART_WIDTH, CHART_HEIGHT);
        let area = Rect { height: CHART_HEIGHT.min(usual.width), ..usual };
        let mut canvas = legend.figure(&self.title, [area; 2]);
        let panel = Panel { area, x: self.x.clone(), y: self.y.clone() };
        panel.draw(&mut canvas, |canvas| {
            for (i, series) in self.series.iter().enumerate() {
                let placed = series.points.iter().map(|&(x, y)| panel.place(x, y));
                let placed: Vec<_> =
                    placed.filter(|(x, y)| x.is_finite() && y.is_finite()).collect();
                series.draw_marks(canvas, &placed, &placed, palette::series(i));
            }
        });
        legend.draw(&mut canvas, [area; 2], |canvas, i, [from, to]| {
            let middle = (f64::midpoint(from.0, to.0), from.1);
            self.series[i].draw_marks(canvas, &[from, to], &[middle], palette::series(i));
        });
        canvas
    }
}

impl Series {
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

#[derive(Clone, Debug, PartialEq)]
pub struct ChannelCurve {
    pub label: String,
    /// Position in m and drag in N.
    pub drag: Vec<(f64, f64)>,
    /// Position in m and number of touching beams, averaged over both sides.
    pub contacts: Vec<(f64, f64)>,
}

const CHANNEL_WIDTH: f64 = 560.0;
const DRAG_HEIGHT: f64 = 260.0;
const CONTACTS_HEIGHT: f64 = 110.0;
const GAP: f64 = 18.0;

pub fn channel_figure(size: Size, title: &str, curves: &[ChannelCurve]) -> Figure {
    let labels: Vec<&str> = curves.iter().map(|curve| curve.label.as_str()).collect();
    let legend = Legend::new(size, &labels);
    let upper = legend.panel(CHANNEL_WIDTH, DRAG_HEIGHT);
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
            for (i, curve) in curves.iter().enumerate() {
                let points = [&curve.drag, &curve.contacts][of].iter();
                let path = polyline(points.map(|&(x, y)| panel.place(x, y)));
                if !path.is_empty() {
                    canvas.stroke(path, palette::series(i), Pen::Round(CURVE_WIDTH));
                }
            }
        });
    }
    upper.draw_y_labels(&mut canvas);
    canvas.frame(upper.area, palette::INK);
    lower.draw_frame(&mut canvas);
    legend.draw(&mut canvas, [upper.area, lower.area], |canvas, i, [from, to]| {
        canvas.line(from, to, palette::series(i), CURVE_WIDTH);
    });
    canvas
}

const CURVE_WIDTH: f64 = 1.6;

const TOP: f64 = 44.0;
const KEY: f64 = 24.0;
const PITCH: f64 = 19.0;
const MARGIN: f64 = 16.0;

#[derive(Clone, Copy, Debug)]
pub(super) struct Legend<'a> {
    size: Size,
    labels: &'a [&'a str],
}

impl<'a> Legend<'a> {
    pub(super) fn new(size: Size, labels: &'a [&'a str]) -> Self {
        Self { size, labels }
    }

    fn width(&self) -> f64 {
        if self.size.is_narrow() {
            return MARGIN;
        }
        let letters = self.size.letters(Style::LABEL.size);
        let labels = self.labels.iter().map(|label| text_width(label, letters));
        KEY + 24.0 + labels.fold(0.0, f64::max)
    }

    pub(super) fn panel(&self, usual: f64, height: f64) -> Rect {
        let left = LEFT_MARGIN + 4.0;
        let width = match self.size {
            Size::Screen => usual,
            print => print.width(0.0) - left - self.width(),
        };
        Rect { left, top: TOP, width, height }
    }

    pub(super) fn figure(&self, title: &str, [upper, lowest]: [Rect; 2]) -> Figure {
        let (bottom, entries) = (below(lowest), PITCH * self.labels.len() as f64);
        let height = match self.size.is_narrow() {
            true => bottom + entries,
            false => bottom.max(TOP + entries + 16.0),
        };
        let mut figure = Figure::new(self.size, upper.right() + self.width(), height);
        figure.title((upper.left, TOP - 16.0), title);
        figure
    }

    /// `draw` draws the key of the curve with this index from one point to another.
    pub(super) fn draw(
        &self,
        canvas: &mut Figure,
        [upper, lowest]: [Rect; 2],
        mut draw: impl FnMut(&mut Figure, usize, [(f64, f64); 2]),
    ) {
        let (left, top) = match self.size.is_narrow() {
            true => (upper.left, below(lowest) + 4.0),
            false => (upper.right() + 12.0, TOP + 10.0),
        };
        for (i, label) in self.labels.iter().enumerate() {
            let y = top + PITCH * i as f64;
            draw(canvas, i, [(left, y), (left + KEY, y)]);
            canvas.text((left + KEY + 6.0, y + 4.0), label, Style::START);
        }
    }
}

fn below(lowest: Rect) -> f64 {
    lowest.bottom() + BOTTOM_MARGIN + 6.0
}

#[cfg(test)]
mod tests {
    use super::super::axes::Spacing;
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
        // Two points, and one in the legend.
        assert_eq!(figure.svg().matches("<circle").count(), 3);
        assert!(figure.svg().contains("a &lt; b") && !figure.svg().contains("NaN"));
    }

    #[test]
    fn every_curve_is_drawn_once_in_each_panel_that_it_is_known_in() {
        let curve = |label: &str, contacts| ChannelCurve {
            label: label.to_owned(),
            drag: vec![(0.0, 0.0), (0.1, 0.2)],
            contacts,
        };
        let contacts = vec![(0.0, 0.0), (0.1, 5.0)];
        let curves = [curve("3 cm", contacts), curve("run 1", Vec::new())];
        let figure = channel_figure(Size::Screen, "drag", &curves);
        let lines =
            |i| figure.svg().matches(&format!("stroke=\"{}\"", palette::series(i).hex())).count();
        // Including the line in the legend.
        assert_eq!((lines(0), lines(1)), (3, 2));
        assert!(figure.svg().contains("run 1") && !figure.svg().contains("NaN"));
    }

    #[test]
    fn a_figure_without_curves_is_a_figure() {
        assert!(!channel_figure(Size::Screen, "nothing", &[]).svg().contains("NaN"));
    }
}
