//! A two-dimensional histogram drawn as coloured cells, colour by the logarithm of the count.

use super::canvas::{Figure, Pen, Rect, Style, number, point};
use super::histogram::{Histogram2d, HistogramCell};
use super::palette::{self, Colour};
use super::panel::Panel;
use super::scale::{decimal, superscript};

/// Steps of the colour scale: more than the eye separates, few enough paths.
const LEVELS: usize = 48;

/// Counts from 1 to `most`, by colour.
#[derive(Clone, Copy, Debug)]
pub(super) struct ColourScale {
    most: u64,
}

impl ColourScale {
    /// The scale on which the fullest of all cells is lightest.
    pub(super) fn for_cells<'a>(cells: impl IntoIterator<Item = &'a HistogramCell>) -> Self {
        Self { most: cells.into_iter().map(|cell| cell.count).max().unwrap_or(1).max(2) }
    }

    fn level(self, count: u64) -> usize {
        let position = (count as f64).ln() / (self.most as f64).ln();
        ((position * LEVELS as f64) as usize).min(LEVELS - 1)
    }

    /// Draws the scale as a bar with its labels below.
    pub(super) fn draw_bar(self, canvas: &mut Figure, bar: Rect, quantity: &str) {
        let step = bar.width / LEVELS as f64;
        let middle = bar.top + bar.height / 2.0;
        for level in 0..LEVELS {
            let left = bar.left + step * level as f64;
            let path = format!("M{}H{}", point(left, middle), number(left + step));
            canvas.stroke(path, level_colour(level), Pen::Crisp(bar.height));
        }
        canvas.frame(bar, palette::INK);
        let decades = (self.most as f64).log10();
        let every = (decades * 30.0 / bar.width).ceil().max(1.0) as u32;
        for decade in (0..=decades as u32).step_by(every as usize) {
            let x = bar.left + bar.width * f64::from(decade) / decades;
            canvas.line((x, bar.bottom()), (x, bar.bottom() + 3.0), palette::INK, 1.0);
            let text = if decade < 4 {
                decimal(10f64.powi(decade as i32), 0)
            } else {
                format!("10{}", superscript(decade as i32))
            };
            canvas.text((x, bar.bottom() + 14.0), &text, Style::LABEL);
        }
        canvas.text((bar.left - 8.0, bar.bottom()), quantity, Style::END);
    }
}

/// How often to double the cells of a histogram so that neighbours in it still touch: about twice as
/// many cells along each axis as the square root of the points, and no smaller than a pixel.
pub(super) fn doublings<const X: usize, const Y: usize>(
    histogram: &Histogram2d<X, Y>,
    pixels: f64,
) -> u32 {
    let wanted = (2.0 * (histogram.points as f64).sqrt()).clamp(32.0, pixels.max(32.0));
    (X as f64 / wanted).log2().floor().max(0.0) as u32
}

/// Draws the cells in the panel: one path per colour, one stroke as wide as a cell is high for each
/// run of neighbours, which takes half the bytes of rectangles.
pub(super) fn draw_cells(
    canvas: &mut Figure,
    panel: &Panel,
    cells: &[HistogramCell],
    scale: ColourScale,
) {
    let Some(any) = cells.first() else { return };
    let height = panel.place(0.0, any.y.low).1 - panel.place(0.0, any.y.high).1;
    let mut paths = vec![String::new(); LEVELS];
    let one_run = |a: &HistogramCell, b: &HistogramCell| {
        a.y == b.y && a.x.high == b.x.low && scale.level(a.count) == scale.level(b.count)
    };
    for run in cells.chunk_by(one_run) {
        let (first, last) = (run[0], run[run.len() - 1]);
        let (left, top) = panel.place(first.x.low, first.y.high);
        let (right, bottom) = panel.place(last.x.high, last.y.low);
        if bottom > panel.area.top && top < panel.area.bottom() {
            let middle = point(left, (top + bottom) / 2.0);
            paths[scale.level(first.count)] += &format!("M{middle}H{}", number(right));
        }
    }
    canvas.clipped(panel.area, |canvas| {
        for (level, path) in paths.into_iter().enumerate().filter(|(_, path)| !path.is_empty()) {
            canvas.stroke(path, level_colour(level), Pen::Crisp(height));
        }
    });
}

fn level_colour(level: usize) -> Colour {
    palette::sequential(level as f64 / (LEVELS - 1) as f64)
}
