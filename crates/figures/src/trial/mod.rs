//! Figures of trials, as papers print them: one column wide, legible without colour.

mod boxes;
mod labels;
mod over_time;
mod phase;

pub use boxes::box_figure;
pub use over_time::{Passage, drag_lift_figure, stack_figure, window_figure};
pub use phase::phase_figure;

use super::axes::{self, BOTTOM_MARGIN, LEFT_MARGIN, Panel, PlotAxis, ValueRange};
use super::canvas::{Figure, Pen, Rect, Size, Style, number, point, text_width};
use super::palette::{self, Colour};
use super::trace::{TraceCurve, draw_curves};
use shell_data::statistics::upper_median;
use trial::Trace;

/// Width of a figure on a screen: a column of 88 mm at twice its size.
const WIDTH: f64 = 680.0;
const TOP: f64 = 58.0;

fn wide_area(size: Size, top: f64, height: f64) -> Rect {
    axes::wide_area(size.width(WIDTH), top, height)
}

fn titled(size: Size, height: f64, title: &str) -> Figure {
    Figure::titled(size, size.width(WIDTH), height, title)
}

/// Curves differ in style too, as colours cannot be distinguished in grey.
type CurvePen = (Colour, Pen);

const SOLID: CurvePen = (palette::series(0), Pen::Round(1.6));
const DASHED: CurvePen = (palette::series(1), Pen::Dashed(1.6));
const PALE: [CurvePen; 2] =
    [(Colour(0x9cc6e3), Pen::Round(0.8)), (Colour(0xf3c29d), Pen::Round(0.8))];

/// A quantity over time, kept in as few points as draw the same line.
fn line(time_s: &[f64], values: impl IntoIterator<Item = f64>) -> TraceCurve {
    let values: Vec<f64> = values.into_iter().collect();
    let mut line = TraceCurve::default();
    line.add(time_s, &values);
    line
}

/// Means over `width_s` around each time, NaN if the interval is cut off; the times ascend.
pub fn smoothed(time_s: &[f64], values: &[f64], width_s: f64) -> Vec<f64> {
    let mut sums = vec![0.0];
    for (i, value) in values.iter().enumerate() {
        sums.push(sums[i] + value);
    }
    let (first, last) = (time_s[0], time_s[time_s.len() - 1]);
    let mean = |&middle: &f64| {
        if middle - first < 0.5 * width_s || last - middle < 0.5 * width_s {
            return f64::NAN;
        }
        let from = time_s.partition_point(|&t| t < middle - 0.5 * width_s);
        let to = time_s.partition_point(|&t| t <= middle + 0.5 * width_s);
        (sums[to] - sums[from]) / (to - from) as f64
    };
    time_s.iter().map(mean).collect()
}

pub fn stride_s(trace: &Trace) -> Option<f64> {
    let mut lengths: Vec<f64> =
        trace.stride_times_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
    upper_median(&mut lengths)
}

fn range_with_zero<'a>(lines: impl IntoIterator<Item = &'a TraceCurve>) -> ValueRange {
    let values = lines.into_iter().flat_map(|line| line.points().map(|(_, value)| value));
    ValueRange::over(values).including(0.0)
}

enum LegendKey<'a> {
    Line(&'a str, CurvePen),
    Area(&'a str, Colour),
}

/// Keys in rows between `left` and `right`, each with its start; in a single row on a screen.
fn legend_rows<'a>(
    size: Size,
    (left, right): (f64, f64),
    keys: impl IntoIterator<Item = &'a LegendKey<'a>>,
) -> Vec<Vec<(f64, &'a LegendKey<'a>)>> {
    let (mut rows, mut next): (Vec<Vec<_>>, f64) = (Vec::new(), left);
    let room = if size == Size::Screen { f64::INFINITY } else { right };
    for key in keys {
        let (LegendKey::Line(text, _) | LegendKey::Area(text, _)) = key;
        let length = 36.0 + 0.92 * text_width(text, Style::LABEL.size) + 6.0;
        // The space after a key may extend beyond the edge.
        match rows.last_mut().filter(|_| next + length - 6.0 <= room) {
            Some(row) => row.push((next, key)),
            None => {
                next = left;
                rows.push(vec![(next, key)]);
            }
        }
        next += length;
    }
    rows
}

fn top_below<'a>(size: Size, keys: impl IntoIterator<Item = &'a LegendKey<'a>>) -> f64 {
    let area = wide_area(size, TOP, 0.0);
    let rows = legend_rows(size, (area.left, area.right()), keys).len();
    TOP + LEGEND_PITCH * rows.saturating_sub(1) as f64
}

/// Draws a legend above a panel, from its left, in one row, or on paper in as many rows as needed.
fn draw_legend<'a>(
    canvas: &mut Figure,
    area: Rect,
    keys: impl IntoIterator<Item = &'a LegendKey<'a>>,
) {
    let rows = legend_rows(canvas.size, (area.left, area.right()), keys);
    for (above, row) in rows.iter().rev().enumerate() {
        let y = area.top - 12.0 - LEGEND_PITCH * above as f64;
        row.iter().for_each(|&(left, key)| key.draw(canvas, left, y));
    }
}

const LEGEND_PITCH: f64 = 15.0;

impl LegendKey<'_> {
    fn draw(&self, canvas: &mut Figure, left: f64, y: f64) {
        match self {
            LegendKey::Line(_, (colour, pen)) => {
                canvas.stroke(format!("M{left} {y}h24"), *colour, *pen);
            }
            LegendKey::Area(_, colour) => {
                let top = y - 5.0;
                canvas.fill(format!("M{left} {top}h24v10h-24Z"), *colour);
                canvas.frame(Rect { left, top, width: 24.0, height: 10.0 }, palette::ZERO);
            }
        }
        let (LegendKey::Line(text, _) | LegendKey::Area(text, _)) = self;
        canvas.text((left + 30.0, y + 4.0), text, Style::START);
    }
}

fn empty_figure(size: Size, title: &str, reason: &str) -> Figure {
    let mut canvas = titled(size, TOP + 60.0, title);
    canvas.text((16.0, TOP + 12.0), reason, Style::START);
    canvas
}

#[cfg(test)]
mod tests {
    use super::super::canvas::Shape;
    use super::super::lettering;
    use super::*;
    use trial::{ConditionRow, Per, PhaseProfile, Quantity, ValueSample};

    fn trace() -> Trace {
        let t_s: Vec<f64> = (0..4000).map(|i| 1e-3 * f64::from(i)).collect();
        let mut trace = Trace { stride_times_s: vec![0.5, 1.0, 1.5, 2.0], ..Trace::default() };
        for axis in &mut trace.wrench {
            *axis = t_s.iter().map(|t| (20.0 * t).sin()).collect();
        }
        trace.right_leg_rad = t_s.iter().map(|t| 12.0 * t).collect();
        trace.right_power_w = t_s.iter().map(|t| 1.0 + t).collect();
        trace.t_s = t_s;
        trace
    }

    #[test]
    fn stride_means_end_where_the_trace_ends() {
        let t_s: Vec<f64> = (0..100).map(|i| 0.1 * f64::from(i)).collect();
        let values: Vec<f64> = t_s.iter().map(|t| 3.0 * t).collect();
        let means = smoothed(&t_s, &values, 1.05);
        assert!(means[..5].iter().chain(&means[95..]).all(|mean| mean.is_nan()));
        for (mean, value) in means[6..94].iter().zip(&values[6..94]) {
            // The mean of a line is the line; running sums have a hundred values of at most 30.
            assert!((mean - value).abs() < 1e-11);
        }
    }

    #[test]
    fn the_passage_is_shaded_at_its_times() {
        let passage = Passage::new([1.0, 3.3], Some(0.18), 0.28);
        let svg = drag_lift_figure(Size::Screen, "t", &trace(), &passage);
        let svg = svg.svg();
        let fills = |colour: Colour| -> Vec<(f64, f64)> {
            let rectangles = svg.lines().filter(|line| line.contains(&colour.hex()));
            // "M<left> <top>V<bottom>H<right>V<top>Z", of the panel; legends draw with h and v.
            let of = |line: &str| {
                let left = line.split("d=\"M").nth(1)?.split(' ').next()?.parse().ok()?;
                let right = line.split('H').nth(1)?.split('V').next()?.parse().ok()?;
                Some((left, right))
            };
            rectangles.filter_map(of).collect()
        };
        let area = wide_area(Size::Screen, TOP, 100.0);
        let x = |time_s: f64| area.left + area.width * time_s / 3.999;
        let expected = [(x(1.0), x(1.9)), (x(2.4), x(3.3))];
        for ((left, right), (from, to)) in fills(palette::PARTLY_INSIDE).into_iter().zip(expected) {
            assert!((left - from).abs() < 0.01 && (right - to).abs() < 0.01);
        }
        assert_eq!(fills(palette::PARTLY_INSIDE).len(), 2);
        assert_eq!(fills(palette::INSIDE).len(), 1);
    }

    #[test]
    fn figures_without_data_state_it() {
        let passage = Passage::new([1.0, 2.0], None, 0.28);
        let nothing = Trace { t_s: trace().t_s, ..Trace::default() };
        for figure in [
            drag_lift_figure(Size::Screen, "a < b", &nothing, &passage),
            stack_figure(Size::Screen, "a < b", &nothing, &passage, [0.0, 3.0]),
            phase_figure(Size::Screen, "a < b", &[]),
            box_figure(Size::Screen, "a < b", &[]),
        ] {
            assert!(
                figure.svg().contains("a &lt; b") && figure.svg().contains(">no"),
                "{}",
                figure.svg()
            );
        }
        // Telemetry columns that exist are drawn without the others.
        let legs = stack_figure(
            Size::Screen,
            "t",
            &Trace { wrench: Default::default(), ..trace() },
            &passage,
            [0.0, 3.0],
        );
        assert!(legs.svg().contains("leg angle (rad)") && !legs.svg().contains("Fx"));
    }

    #[test]
    fn a_box_has_its_quartiles_and_whiskers_at_their_values() {
        let mut sample = ValueSample::default();
        [1.0, 2.0, 3.0, 4.0, 5.0, 30.0].into_iter().for_each(|value| sample.add_cluster([value]));
        let statistics = sample.statistics(1).unwrap();
        let row = ConditionRow {
            condition: "<3 cm>".to_owned(),
            per: Per::Trial,
            quantity: Quantity::SpecificResistance,
            statistics: statistics.clone(),
            difference: None,
        };
        let svg = box_figure(Size::Screen, "t", &[row]);
        let svg = svg.svg();
        assert!(svg.contains("&lt;3 cm&gt;") && svg.contains("n = 6"));
        // One outlier, 30, and one ring in the key.
        assert_eq!(
            svg.matches("fill=\"none\" stroke=\"#222222\"/>\n").count()
                - svg.matches("<rect").count(),
            2
        );
        // One point for each of the six values, and one in the key.
        let is_point =
            |line: &&str| line.starts_with("<circle") && line.contains(&palette::series(0).hex());
        assert_eq!(svg.lines().filter(is_point).count(), 7);
        // The axis runs over values from 1 to 30 with 8 % at both ends, 150 pixels high from 58 on.
        let y = |value: f64| 58.0 + 150.0 - 150.0 * (value - 1.0 + 0.08 * 29.0) / (1.16 * 29.0);
        for value in [
            statistics.q1,
            statistics.median,
            statistics.q3,
            statistics.whisker_low,
            statistics.whisker_high,
        ] {
            let text = super::super::canvas::number(y(value));
            assert!(
                svg.contains(&format!(" {text}H")) || svg.contains(&format!("V{text}H")),
                "{value} at {text}"
            );
        }
    }

    /// Asserts the width, letters of 5 to 7 pt, and no text cut off or over another.
    fn assert_printable(figure: &Figure, size: Size, width_mm: f64) {
        let svg = figure.svg();
        assert!(svg.contains(&format!("width=\"{width_mm}mm\"")), "{}", &svg[..200]);
        let pt = size.scale() * 0.75;
        // The width of the page in a PDF, in pt of 1/72 inch.
        let page = width_mm / 25.4 * 72.0;
        let mut texts: Vec<(&String, tiny_skia::Rect)> = Vec::new();
        assert!((figure.width * pt - page).abs() < 1e-9, "{} {page}", figure.width * pt);
        for shape in &figure.shapes {
            let Shape::Text { at, text, style, .. } = shape else { continue };
            // Half a hundredth: sizes are written with two decimals.
            assert!((4.995..=7.005).contains(&(style.size * pt)), "{text}: {} pt", style.size * pt);
            let Some((path, position)) = lettering::outline(text, *at, *style) else { continue };
            let bounds = path.transform(position).unwrap().bounds();
            let (right, bottom) = (figure.width as f32, figure.height as f32);
            let is_inside = bounds.left() >= 0.0 && bounds.top() >= 0.0;
            assert!(is_inside, "{text} at {bounds:?}");
            assert!(bounds.right() <= right && bounds.bottom() <= bottom, "{text} at {bounds:?}");
            for (other, of) in &texts {
                assert!(bounds.intersect(of).is_none(), "{text} over {other}");
            }
            texts.push((text, bounds));
        }
    }

    #[test]
    fn figures_fit_the_columns_of_a_paper() {
        let passage = Passage::new([0.5, 3.5], Some(0.18), 0.28);
        let phases = PhaseProfile::new(&trace(), [0.5, 2.0]).unwrap();
        let phases = ["free", "3 cm"].map(|name| (name.to_owned(), phases.clone()));
        let mut sample = ValueSample::default();
        sample.add_cluster((0..368).map(f64::from));
        let statistics = sample.statistics(1).unwrap();
        let boxes = |conditions: &[String]| -> Vec<ConditionRow> {
            let rows = conditions.iter().flat_map(|condition| {
                Per::ALL.map(|per| ConditionRow {
                    condition: condition.clone(),
                    per,
                    quantity: Quantity::DragEnergy,
                    statistics: statistics.clone(),
                    difference: None,
                })
            });
            rows.collect()
        };
        let depths = ["free", "0 cm", "3 cm", "6 cm", "9 cm"].map(str::to_owned);
        let terrains = [2, 5, 9, 12].map(|count| {
            let name = |i| format!("cheetah-trot-soft-terrain-0.{i}m/s");
            (1..=count).map(name).collect::<Vec<_>>()
        });
        let without_separators =
            ["cheetahtrotsoftterrain0.5metrespersecond", "free"].map(str::to_owned);
        let conditions = [&depths[..], &without_separators].into_iter();
        for (size, width_mm) in [(Size::Single, 89.0), (Size::Double, 183.0)] {
            let figures = [
                drag_lift_figure(size, "free: run-1.txt", &trace(), &passage),
                stack_figure(size, "free: run-1.txt", &trace(), &passage, [0.0, 4.0]),
                phase_figure(size, "Drag and lift over a stride", &phases),
            ];
            let conditions = conditions.clone().chain(terrains.iter().map(|names| &names[..]));
            let boxes = conditions
                .map(|names| box_figure(size, "Energies and specific resistance", &boxes(names)));
            for figure in figures.into_iter().chain(boxes) {
                assert_printable(&figure, size, width_mm);
            }
        }
    }
}
