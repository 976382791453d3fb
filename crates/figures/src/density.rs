//! A two-dimensional histogram as cells, coloured by the logarithm of the count. Few constant loads
//! cover only a few spots, so their mean and spread are drawn.

use super::axes::{Panel, log_label};
use super::canvas::{Figure, Pen, Rect, Style, number, point};
use super::histogram::{Histogram2d, HistogramCell};
use super::palette::{self, Colour};

/// Number of steps of the colour scale: more than the eye can distinguish, but few enough paths.
const LEVELS: usize = 48;

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
            let text = log_label(1, decade as i32);
            canvas.text((x, bar.bottom() + 14.0), &text, Style::LABEL);
        }
        canvas.text((bar.left - 8.0, bar.bottom()), quantity, Style::END);
    }
}

/// Number of times to double the width of cells, so that neighbours touch. About twice as many cells
/// as the square root of the number of points remain per axis, none of them smaller than a pixel.
pub(super) fn doublings<const X: usize, const Y: usize>(
    histogram: &Histogram2d<X, Y>,
    pixels: f64,
) -> u32 {
    let wanted = (2.0 * (histogram.points as f64).sqrt()).clamp(32.0, pixels.max(32.0));
    (X as f64 / wanted).log2().floor().max(0.0) as u32
}

/// Draws one path per colour, and one stroke of a cell's height per run of neighbours, which takes
/// half the bytes of rectangles.
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

/// The rows of one load, from the cells of measured (x) and predicted (y) values that contain them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PoseMean {
    pub(super) measured: f64,
    pub(super) predicted: f64,
    pub(super) sd: f64,
}

/// Limits on the number of loads: fewer are not a set of poses, more cannot be distinguished.
const FEW: usize = 4;
const MANY: usize = 120;

/// Largest part of the range that poses cover; above it, the load is a moving signal.
const COVERED: f64 = 0.4;

/// Poses, ascending by the measured value; none if the load moves.
pub(super) fn poses(cells: &[HistogramCell]) -> Vec<PoseMean> {
    let mut cells: Vec<&HistogramCell> = cells.iter().collect();
    cells.sort_by(|a, b| a.x.low.total_cmp(&b.x.low));
    let mut runs: Vec<Vec<&HistogramCell>> = Vec::new();
    for cell in cells {
        // Adjacent columns of cells are one load and its scatter.
        let width = cell.x.high - cell.x.low;
        let touches =
            |run: &Vec<&HistogramCell>| run.iter().any(|c| cell.x.low <= c.x.high + 0.5 * width);
        match runs.last_mut().filter(|run| touches(run)) {
            Some(run) => run.push(cell),
            None => runs.push(vec![cell]),
        }
    }
    if !(FEW..=MANY).contains(&runs.len()) {
        return Vec::new();
    }
    let ends = |run: &Vec<&HistogramCell>| {
        let high = run.iter().map(|cell| cell.x.high).fold(f64::NEG_INFINITY, f64::max);
        (run[0].x.low, high)
    };
    let covered: f64 = runs.iter().map(ends).map(|(low, high)| high - low).sum();
    let range = ends(&runs[runs.len() - 1]).1 - ends(&runs[0]).0;
    match covered <= COVERED * range {
        true => runs.iter().map(|run| pose_mean(run)).collect(),
        false => Vec::new(),
    }
}

fn pose_mean(run: &[&HistogramCell]) -> PoseMean {
    let count: f64 = run.iter().map(|cell| cell.count as f64).sum();
    let mean = |of: &dyn Fn(&HistogramCell) -> f64| {
        run.iter().map(|cell| cell.count as f64 * of(cell)).sum::<f64>() / count
    };
    let y = |cell: &HistogramCell| (cell.y.low + cell.y.high) / 2.0;
    let predicted = mean(&y);
    PoseMean {
        measured: mean(&|cell| (cell.x.low + cell.x.high) / 2.0),
        predicted,
        sd: mean(&|cell| (y(cell) - predicted).powi(2)).sqrt(),
    }
}

pub(super) fn draw_poses(
    canvas: &mut Figure,
    panel: &Panel,
    poses: impl IntoIterator<Item = ((f64, f64), f64)>,
) {
    canvas.clipped(panel.area, |canvas| {
        for ((x, y), sd) in poses {
            let (low, high) = (panel.place(x, y - sd), panel.place(x, y + sd));
            canvas.line(low, high, palette::INK, 1.2);
            canvas.ring(panel.place(x, y), 3.0, palette::INK);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::super::histogram::Histogram2d;
    use super::*;

    /// Loads 0, 1, … N with this scatter, and predictions with known bias and spread.
    fn cells(loads: u32, scatter: f64) -> Vec<HistogramCell> {
        let mut histogram = Histogram2d::<256, 256>::default();
        for load in 0..loads {
            let load = f64::from(load);
            for i in 0..200 {
                let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
                let measured = load + scatter * (f64::from(i) / 100.0 - 1.0);
                histogram.add(&[measured], &[load + 0.1 + sign * 0.3]);
            }
        }
        histogram.cells([0; 2])
    }

    #[test]
    fn poses_have_the_mean_and_the_spread_of_their_rows() {
        let found = poses(&cells(12, 0.02));
        assert_eq!(found.len(), 12);
        for (load, pose) in (0..).zip(&found) {
            let load = f64::from(load);
            // To half a cell; of 256 cells at least half are used.
            let cell = 12.0 / 128.0;
            assert!((pose.measured - load).abs() < cell, "{pose:?}");
            assert!((pose.predicted - load - 0.1).abs() < cell, "{pose:?}");
            assert!((pose.sd - 0.3).abs() < cell, "{pose:?}");
        }
    }

    #[test]
    fn a_load_that_moves_has_no_poses() {
        assert!(poses(&cells(12, 0.5)).is_empty());
        assert!(poses(&cells(3, 0.02)).is_empty(), "too few to be a set of poses");
        assert!(poses(&[]).is_empty());
    }
}
