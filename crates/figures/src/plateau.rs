//! Data of few constant loads: their rows fall on a few specks, of which the mean and the spread are drawn.

use super::canvas::Figure;
use super::histogram::HistogramCell;
use super::palette;
use super::panel::Panel;

/// The rows of one load, by the cells of measured (x) and predicted (y) that they fall on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LoadPlateau {
    /// The mean measured value.
    pub(super) measured: f64,
    /// The mean prediction.
    pub(super) predicted: f64,
    /// Its standard deviation.
    pub(super) sd: f64,
}

/// Fewer loads are not a set of poses, and more cannot be told apart on paper.
const FEW: usize = 4;
const MANY: usize = 120;

/// The part of the range that plateaus may cover; more is a signal that moves.
const COVERED: f64 = 0.4;

/// The plateaus in a histogram, from the least measured value on; none if the load moves.
pub(super) fn plateaus(cells: &[HistogramCell]) -> Vec<LoadPlateau> {
    let mut cells: Vec<&HistogramCell> = cells.iter().collect();
    cells.sort_by(|a, b| a.x.low.total_cmp(&b.x.low));
    let mut runs: Vec<Vec<&HistogramCell>> = Vec::new();
    for cell in cells {
        // Columns of cells that touch are one load and its scatter.
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
        true => runs.iter().map(|run| plateau(run)).collect(),
        false => Vec::new(),
    }
}

fn plateau(run: &[&HistogramCell]) -> LoadPlateau {
    let count: f64 = run.iter().map(|cell| cell.count as f64).sum();
    let mean = |of: &dyn Fn(&HistogramCell) -> f64| {
        run.iter().map(|cell| cell.count as f64 * of(cell)).sum::<f64>() / count
    };
    let y = |cell: &HistogramCell| (cell.y.low + cell.y.high) / 2.0;
    let predicted = mean(&y);
    LoadPlateau {
        measured: mean(&|cell| (cell.x.low + cell.x.high) / 2.0),
        predicted,
        sd: mean(&|cell| (y(cell) - predicted).powi(2)).sqrt(),
    }
}

/// A ring at each mean and a bar of one standard deviation to either side.
pub(super) fn draw_plateaus(
    canvas: &mut Figure,
    panel: &Panel,
    plateaus: impl IntoIterator<Item = ((f64, f64), f64)>,
) {
    canvas.clipped(panel.area, |canvas| {
        for ((x, y), sd) in plateaus {
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

    /// Loads of 0, 1, … N, each with this scatter of the reference and a prediction of a bias and a spread
    /// that are known.
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
    fn plateaus_have_the_mean_and_the_spread_of_their_rows() {
        let found = plateaus(&cells(12, 0.02));
        assert_eq!(found.len(), 12);
        for (load, plateau) in (0..).zip(&found) {
            let load = f64::from(load);
            // To half a cell, of which there are 256, twice as many as are used at worst.
            let cell = 12.0 / 128.0;
            assert!((plateau.measured - load).abs() < cell, "{plateau:?}");
            assert!((plateau.predicted - load - 0.1).abs() < cell, "{plateau:?}");
            assert!((plateau.sd - 0.3).abs() < cell, "{plateau:?}");
        }
    }

    #[test]
    fn a_load_that_moves_has_no_plateaus() {
        assert!(plateaus(&cells(12, 0.5)).is_empty());
        assert!(plateaus(&cells(3, 0.02)).is_empty(), "too few to be a set of poses");
        assert!(plateaus(&[]).is_empty());
    }
}
