//! How well two recordings match: the search over all offsets, and readings beside what the aligned
//! reference predicts.

use super::chart::ChartMark;
use super::histogram::ValueRange;
use super::palette;
use super::panel::{BOTTOM_MARGIN, LEFT_MARGIN, Panel};
use super::scale::{PlotAxis, Spacing};
use super::size::Size;
use super::svg::{Anchor, Canvas, Figure, Rect, Style, polyline};
use alignment::Quality;

const WIDTH: f64 = 860.0;
const TOP: f64 = 44.0;
const HEIGHT: f64 = 200.0;
const PITCH: f64 = HEIGHT + BOTTOM_MARGIN + 36.0;
/// Points drawn of the search: the highest of as many stretches, two per pixel.
const SEARCH_POINTS: usize = 1600;

/// Draws the search (score over offset, the best being 1) above an excerpt of the match.
pub fn match_figure(size: Size, title: &str, quality: &Quality) -> Figure {
    let width = size.width(WIDTH);
    let mut canvas = Canvas::sized(size, width, TOP + 2.0 * PITCH);
    canvas.text((16.0, 24.0), title, Style::TITLE.anchored(Anchor::Start));
    let area = |row: f64| Rect {
        left: LEFT_MARGIN + 8.0,
        top: TOP + row * PITCH,
        width: width - LEFT_MARGIN - 24.0,
        height: HEIGHT,
    };

    let search = highest(&quality.search, SEARCH_POINTS);
    let offsets_s = ValueRange::over(search.iter().map(|&(offset_s, _)| offset_s));
    let x =
        PlotAxis::new("offset of the starts", "s", Spacing::Linear, offsets_s.low, offsets_s.high);
    let y = PlotAxis::new("score", "", Spacing::Linear, 0.0, 1.05);
    let panel = Panel { area: area(0.0), x, y };
    draw(&mut canvas, &panel, &[(&search, ChartMark::Line)]);

    let column = |i: usize| -> Vec<(f64, f64)> {
        quality.excerpt.points.iter().map(|point| (point[0], point[i])).collect()
    };
    let (readings, predicted) = (column(1), column(2));
    let times_s = ValueRange::over(readings.iter().map(|&(time_s, _)| time_s));
    let counts = ValueRange::over(readings.iter().chain(&predicted).map(|&(_, value)| value));
    let name = format!("channel {}", quality.excerpt.channel + 1);
    let panel = Panel {
        area: area(1.0),
        x: PlotAxis::new("board time", "s", Spacing::Linear, times_s.low, times_s.high),
        y: PlotAxis::new(&name, "counts", Spacing::Linear, counts.low, counts.high).padded(0.06),
    };
    draw(&mut canvas, &panel, &[(&readings, ChartMark::Points), (&predicted, ChartMark::Line)]);
    let (right, above) = (panel.area.right(), panel.area.top - 8.0);
    let legend = Style::LABEL.anchored(Anchor::End);
    canvas.text((right, above), "points: readings; line: the aligned reference, mapped", legend);
    canvas.finish()
}

fn draw(canvas: &mut Canvas, panel: &Panel, series: &[(&[(f64, f64)], ChartMark)]) {
    panel.draw_grid(canvas);
    canvas.clipped(panel.area, |canvas| {
        for (colour, (points, mark)) in palette::SERIES.iter().zip(series) {
            let placed = points.iter().map(|&(x, y)| panel.place(x, y));
            match mark {
                ChartMark::Points => {
                    placed.for_each(|position| canvas.circle(position, 2.0, colour))
                }
                _ => canvas.stroke(&polyline(placed), colour, 1.2),
            }
        }
    });
    panel.draw_frame(canvas);
}

/// The highest point of each of `stretches` stretches: no peak is lost.
fn highest(points: &[(f64, f64)], stretches: usize) -> Vec<(f64, f64)> {
    let length = points.len().div_ceil(stretches).max(1);
    let best = |stretch: &[(f64, f64)]| {
        stretch.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or_default()
    };
    points.chunks(length).map(best).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use alignment::Excerpt;

    #[test]
    fn a_long_search_keeps_its_peak_and_few_points() {
        let search: Vec<_> = (0..100_000)
            .map(|i| (f64::from(i) * 0.02 - 600.0, if i == 31_234 { 1.0 } else { 0.1 }))
            .collect();
        let drawn = highest(&search, SEARCH_POINTS);
        assert!(drawn.len() <= SEARCH_POINTS && drawn.contains(&search[31_234]));
    }

    #[test]
    fn an_empty_match_is_drawn_too() {
        let quality = Quality {
            explained: 0.0,
            residual_counts: vec![],
            rows: 0,
            search_explained: 0.0,
            search_ratio: 0.0,
            search: vec![],
            spring_delay_s: 0.0,
            white_se: [0.0; 2],
            excerpt: Excerpt::default(),
        };
        let figure = match_figure(Size::Screen, "a < b", &quality);
        assert!(figure.svg().contains("a &lt; b") && !figure.svg().contains("NaN"));
    }
}
