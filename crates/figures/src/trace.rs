//! A wrench over time, for logs of any length. Each sliver of time keeps its first, lowest, highest and last value,
//! which draw the same line as all values (Jugel et al., "M4: A Visualization-Oriented Time Series Data Aggregation",
//! VLDB 2014).

use super::axes::{BOTTOM_MARGIN, Panel, PlotAxis, ValueRange, wide_area};
use super::canvas::{Figure, Pen, Size, point};
use super::histogram::{Cell, Grid};
use super::palette::{self, Colour};
use shell_data::statistics::upper_median;
use shell_data::wrench::{Axis, PerAxis};

/// Number of slivers of time: at least half of them, more than there are pixels, cover the log.
const SLIVERS: usize = 2048;

#[derive(Clone, Debug, Default)]
pub struct WrenchTrace {
    is_by_row: bool,
    axes: PerAxis<TraceCurve>,
}

#[derive(Clone, Debug, Default)]
pub(super) struct TraceCurve {
    slivers: Option<Grid<Option<Sliver>, 1>>,
}

/// Points of one sliver, each as (time, value).
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sliver {
    first: (f64, f64),
    lowest: (f64, f64),
    highest: (f64, f64),
    last: (f64, f64),
}

impl WrenchTrace {
    /// Creates an empty trace along numbers of rows in place of times.
    pub fn by_row() -> Self {
        Self { is_by_row: true, ..Self::default() }
    }

    /// Adds rows: time in s, six columns of wrench in the order of [`Axis::ALL`], N and N·m. The axis of an empty
    /// column is not drawn. Rows that are not finite are skipped.
    ///
    /// # Panics
    /// If there are not six columns, each empty or as long as `time_s`.
    pub fn add<C: AsRef<[f64]>>(&mut self, time_s: &[f64], wrench: &[C]) {
        assert_eq!(wrench.len(), 6, "one column per axis");
        for (trace, column) in self.axes.iter_mut().zip(wrench) {
            let column = column.as_ref();
            assert!(column.is_empty() || column.len() == time_s.len(), "one value per time");
            trace.add(time_s, column);
        }
    }
}

impl TraceCurve {
    pub(super) fn add(&mut self, time: &[f64], values: &[f64]) {
        let finite = || {
            let pairs = time.iter().copied().zip(values.iter().copied());
            pairs.filter(|(t, v)| t.is_finite() && v.is_finite())
        };
        let range = ValueRange::over(finite().map(|(t, _)| t));
        if range.low > range.high {
            return;
        }
        let grid = Grid::cover(&mut self.slivers, [range], [SLIVERS]);
        let locate = grid.bins[0].locator();
        for point in finite() {
            let one = Sliver { first: point, lowest: point, highest: point, last: point };
            grid.cells[locate(point.0)].absorb(&Some(one));
        }
    }

    pub(super) fn points(&self) -> impl Iterator<Item = (f64, f64)> {
        let slivers = self.slivers.iter().flat_map(|grid| grid.cells.iter().flatten());
        slivers.flat_map(Sliver::points)
    }
}

impl Cell for Option<Sliver> {
    fn absorb(&mut self, later: &Self) {
        *self = match (*self, *later) {
            (Some(held), Some(Sliver { lowest, highest, last, .. })) => Some(Sliver {
                lowest: if lowest.1 < held.lowest.1 { lowest } else { held.lowest },
                highest: if highest.1 > held.highest.1 { highest } else { held.highest },
                last,
                ..held
            }),
            (held, later) => held.or(later),
        };
    }
}

impl Sliver {
    fn points(&self) -> Vec<(f64, f64)> {
        let mut points = vec![self.first, self.lowest, self.highest, self.last];
        if self.highest.0 < self.lowest.0 {
            points.swap(1, 2);
        }
        points.dedup();
        points
    }
}

const WIDTH: f64 = 960.0;
const TOP: f64 = 40.0;
const PANEL_HEIGHT: f64 = 106.0;
const PANEL_PITCH: f64 = 118.0;

pub fn trace_figure(size: Size, title: &str, trace: &WrenchTrace) -> Figure {
    let curves = Axis::ALL.into_iter().zip(&trace.axes);
    let shown: Vec<_> =
        curves.filter_map(|(axis, curve)| Some((axis, curve, curve.slivers.as_ref()?))).collect();
    let width = size.width(WIDTH);
    let height = TOP + PANEL_PITCH * shown.len().max(1) as f64 + BOTTOM_MARGIN;
    let mut canvas = Figure::titled(size, width, height, title);
    let times = shown.iter().map(|(.., slivers)| slivers.ranges[0]);
    let time = times.fold(ValueRange::EMPTY, ValueRange::union);
    for (row, &(axis, curve, _)) in shown.iter().enumerate() {
        let panel = Panel {
            area: wide_area(width, TOP + PANEL_PITCH * row as f64, PANEL_HEIGHT),
            x: match trace.is_by_row {
                true => PlotAxis::linear("row", "", time),
                false => PlotAxis::linear("time", "s", time),
            },
            y: PlotAxis::linear(axis.name(), axis.unit(), shown_range(curve)).padded(0.06),
        };
        panel.draw_grid(&mut canvas);
        draw_curves(&mut canvas, &panel, &[(curve, (palette::series(0), Pen::Round(1.0)))]);
        panel.draw_stacked_frame(&mut canvas, row + 1 == shown.len());
    }
    canvas
}

/// Range of the values, with zero (the tare level) unless it is far from all of them.
fn shown_range(curve: &TraceCurve) -> ValueRange {
    let range = ValueRange::over(curve.points().map(|(_, value)| value));
    let with_zero = range.including(0.0);
    let is_near = with_zero.high - with_zero.low <= 4.0 * (range.high - range.low);
    if is_near { with_zero } else { range }
}

pub(super) fn draw_curves(
    canvas: &mut Figure,
    panel: &Panel,
    curves: &[(&TraceCurve, (Colour, Pen))],
) {
    canvas.clipped(panel.area, |canvas| {
        panel.draw_zero(canvas);
        for (curve, (colour, pen)) in curves {
            canvas.stroke(path(panel, curve), *colour, *pen);
        }
    });
}

/// The line through a curve's points, interrupted where the log has a gap.
fn path(panel: &Panel, curve: &TraceCurve) -> String {
    let mut path = String::new();
    let mut before = String::new();
    let longest = longest_step(curve);
    let mut last = f64::INFINITY;
    for (t, v) in curve.points() {
        let (x, y) = panel.place(t, v);
        let here = point((x * 10.0).round() / 10.0, (y * 10.0).round() / 10.0);
        let is_gap = t - last > longest;
        last = t;
        if here != before || is_gap {
            path.push(if path.is_empty() || is_gap { 'M' } else { 'L' });
            path.push_str(&here);
            before = here;
        }
    }
    path
}

/// Longest step in time over which a line is drawn: a hundredth of the curve, and ten usual steps.
fn longest_step(curve: &TraceCurve) -> f64 {
    let times: Vec<f64> = curve.points().map(|(time, _)| time).collect();
    let steps = times.windows(2).map(|pair| pair[1] - pair[0]);
    let mut steps: Vec<f64> = steps.filter(|step| *step > 0.0).collect();
    let span = times.last().copied().unwrap_or(0.0) - times.first().copied().unwrap_or(0.0);
    (10.0 * upper_median(&mut steps).unwrap_or(0.0)).max(0.01 * span)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trace(values: &[(f64, f64)], split: usize) -> TraceCurve {
        let mut trace = TraceCurve::default();
        for block in values.chunks(split) {
            let (time, values): (Vec<_>, Vec<_>) = block.iter().copied().unzip();
            trace.add(&time, &values);
        }
        trace
    }

    fn spiky(count: u32) -> Vec<(f64, f64)> {
        let spike = |i| if i == 71_234 { 9.0 } else { (f64::from(i) * 0.37).sin() };
        (0..count).map(|i| (f64::from(i) * 1e-3, spike(i))).collect()
    }

    #[test]
    fn a_short_log_keeps_every_point() {
        let values = spiky(500);
        assert_eq!(trace(&values, 64).points().collect::<Vec<_>>(), values);
    }

    #[test]
    fn a_long_log_keeps_its_spikes_and_its_ends_in_few_points() {
        let values = spiky(200_000);
        let points: Vec<_> = trace(&values, 4096).points().collect();
        assert!(points.len() <= 4 * SLIVERS);
        assert!(points.contains(&values[71_234]));
        assert_eq!((points.first(), points.last()), (values.first(), values.last()));
        assert!(points.is_sorted_by(|a, b| a.0 <= b.0));
    }

    #[test]
    fn the_points_do_not_depend_on_the_blocks() {
        let values = spiky(50_000);
        assert!(trace(&values, 50_000).points().eq(trace(&values, 777).points()));
    }

    #[test]
    fn lines_are_interrupted_where_rows_are_missing() {
        let drawn = |times: &dyn Fn(&f64) -> bool| {
            let times: Vec<f64> = (0..1000).map(|i| 0.01 * f64::from(i)).filter(times).collect();
            let values: Vec<(f64, f64)> = times.iter().map(|t| (*t, t.sin())).collect();
            let mut trace = WrenchTrace::default();
            let mut columns = vec![Vec::new(); 6];
            let (time_s, force): (Vec<f64>, Vec<f64>) = values.into_iter().unzip();
            columns[0] = force;
            trace.add(&time_s, &columns);
            let svg = trace_figure(Size::Screen, "t", &trace).svg();
            // The longest path is the curve.
            let paths = svg.split(" d=\"").map(|path| path.split('"').next().unwrap_or_default());
            let curve = paths.max_by_key(|path| path.len()).unwrap().to_owned();
            curve.matches('M').count()
        };
        assert_eq!(drawn(&|_| true), 1);
        assert_eq!(drawn(&|t| !(4.0..8.5).contains(t)), 2);
        // A few lost rows are no gap.
        assert_eq!(drawn(&|t| !(4.0..4.03).contains(t)), 1);
    }

    #[test]
    fn axes_without_values_are_not_drawn() {
        let mut trace = WrenchTrace::default();
        let mut columns = vec![Vec::new(); 6];
        columns[2] = vec![1.0, f64::NAN, 2.0];
        trace.add(&[0.0, 1.0, 2.0], &columns);
        let figure = trace_figure(Size::Screen, "run", &trace);
        assert!(figure.svg().contains(">Fz (N)<") && !figure.svg().contains(">Fx (N)<"));
        assert!(
            trace_figure(Size::Screen, "run", &WrenchTrace::default()).svg().ends_with("</svg>\n")
        );
    }
}
