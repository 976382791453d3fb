//! Match of two recordings: the search over all offsets, and readings with their predictions.

use super::axes::{BOTTOM_MARGIN, Panel, PlotAxis, ValueRange, wide_area};
use super::canvas::{Figure, Pen, Size, Style, polyline};
use super::palette;
use alignment::Quality;

const WIDTH: f64 = 860.0;
const TOP: f64 = 44.0;
const HEIGHT: f64 = 200.0;
const PITCH: f64 = HEIGHT + BOTTOM_MARGIN + 36.0;
/// Number of points drawn for the search, two per pixel. The search is cut into parts, and the
/// highest point of each part is drawn.
const SEARCH_POINTS: usize = 1600;

/// Draws the search (score over offset, maximum 1) above an excerpt of the match.
pub fn match_figure(size: Size, title: &str, quality: &Quality) -> Figure {
    let width = size.width(WIDTH);
    let mut canvas = Figure::titled(size, width, TOP + 2.0 * PITCH, title);
    let search = highest(&quality.search, SEARCH_POINTS);
    let range = |points: &[(f64, f64)]| ValueRange::over(points.iter().map(|point| point.0));
    let panel = Panel {
        area: wide_area(width, TOP, HEIGHT),
        x: PlotAxis::linear("offset of the starts", "s", range(&search)),
        y: PlotAxis::linear("score", "", ValueRange { low: 0.0, high: 1.05 }),
    };
    draw(&mut canvas, &panel, &[], &search, 0);

    let column = |i: usize| -> Vec<(f64, f64)> {
        quality.excerpt.points.iter().map(|point| (point[0], point[i])).collect()
    };
    let (readings, predicted) = (column(1), column(2));
    let counts = ValueRange::over(readings.iter().chain(&predicted).map(|&(_, value)| value));
    let name = format!("channel {}", quality.excerpt.channel + 1);
    let panel = Panel {
        area: wide_area(width, TOP + PITCH, HEIGHT),
        x: PlotAxis::linear("board time", "s", range(&readings)),
        y: PlotAxis::linear(&name, "counts", counts).padded(0.06),
    };
    draw(&mut canvas, &panel, &readings, &predicted, 1);
    let at = (panel.area.right(), panel.area.top - 8.0);
    canvas.text(at, "points: readings; line: the aligned reference, mapped", Style::END);
    canvas
}

fn draw(
    canvas: &mut Figure,
    panel: &Panel,
    points: &[(f64, f64)],
    line: &[(f64, f64)],
    colour: usize,
) {
    let place = |&(x, y): &(f64, f64)| panel.place(x, y);
    panel.draw(canvas, |canvas| {
        points.iter().for_each(|point| canvas.circle(place(point), 2.0, palette::series(0)));
        let path = polyline(line.iter().map(place));
        canvas.stroke(path, palette::series(colour), Pen::Round(1.2));
    });
}

fn highest(points: &[(f64, f64)], parts: usize) -> Vec<(f64, f64)> {
    let length = points.len().div_ceil(parts).max(1);
    let best = |part: &[(f64, f64)]| {
        part.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or_default()
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
            explained_elsewhere: 0.0,
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
