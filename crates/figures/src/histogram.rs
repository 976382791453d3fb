//! A two-dimensional histogram that finds its own ranges.

use std::array;

use super::bins::{Cell, Grid};
use super::scale::ValueRange;

/// Counts of points (x, y) in at most `X` by `Y` equal rectangular cells.
///
/// Holds a fixed number of cells however many points it is given. Cell widths are powers of two and
/// double when a point falls outside, which moves whole cells into whole cells: the counts are exact
/// for the final cells and independent of the order of points, blocks and merges. At least half of
/// the bins of each axis span the data.
#[derive(Clone, Debug, Default)]
pub(super) struct Histogram2d<const X: usize, const Y: usize> {
    grid: Option<Grid<u64, 2>>,
    /// Number of points counted.
    pub(super) points: u64,
}

impl Cell for u64 {
    fn absorb(&mut self, later: &Self) {
        *self += later;
    }
}

/// One cell that is not empty: its edges and its count.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct HistogramCell {
    pub(super) x: ValueRange,
    pub(super) y: ValueRange,
    pub(super) count: u64,
}

impl<const X: usize, const Y: usize> Histogram2d<X, Y> {
    /// Counts the points (`x[i]`, `y[i]`); those that are not finite are left out.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub(super) fn add(&mut self, x: &[f64], y: &[f64]) {
        assert_eq!(x.len(), y.len(), "one y for every x");
        let mut range = [ValueRange::EMPTY; 2];
        let mut finite = 0;
        for (&x, &y) in x.iter().zip(y) {
            if x.is_finite() && y.is_finite() {
                range = [range[0].including(x), range[1].including(y)];
                finite += 1;
            }
        }
        if finite == 0 {
            return;
        }
        self.points += finite;
        let grid = Grid::cover(&mut self.grid, range, [X, Y]);
        let ([column, row], width) = (grid.bins.map(|bins| bins.locator()), grid.bins[0].count);
        for (&x, &y) in x.iter().zip(y) {
            if x.is_finite() && y.is_finite() {
                grid.cells[row(y) * width + column(x)] += 1;
            }
        }
    }

    /// Adds the counts of another.
    pub(super) fn merge(&mut self, other: &Self) {
        self.points += other.points;
        if let Some(theirs) = &other.grid {
            Grid::cover(&mut self.grid, theirs.ranges, [X, Y]).absorb(theirs);
        }
    }

    /// The smallest and largest x and y; −1 to 1 while empty.
    pub(super) fn ranges(&self) -> [ValueRange; 2] {
        self.grid.as_ref().map_or([ValueRange { low: -1.0, high: 1.0 }; 2], |grid| grid.ranges)
    }

    /// The cells that are not empty, row by row; cells merged 2^`doublings` by 2^`doublings`.
    pub(super) fn cells(&self, doublings: [u32; 2]) -> Vec<HistogramCell> {
        let Some(grid) = &self.grid else { return Vec::new() };
        let bins = array::from_fn(|i| grid.bins[i].coarsened(doublings[i]));
        let mut coarse = Grid::empty(bins, grid.ranges);
        coarse.absorb(grid);
        let [x, y] = bins;
        let occupied = coarse.cells.into_iter().enumerate().filter(|&(_, count)| count > 0);
        let cell =
            |(i, count)| HistogramCell { x: x.edges(i % x.count), y: y.edges(i / x.count), count };
        occupied.map(cell).collect()
    }

    /// The counts over y alone: edges of each bin from the first to the last that is not empty.
    pub(super) fn marginal_y(&self) -> Vec<(ValueRange, u64)> {
        let Some(grid) = &self.grid else { return Vec::new() };
        let ([x, y], [_, range]) = (grid.bins, grid.ranges);
        let locate = y.locator();
        let total = |row: usize| grid.cells[row * x.count..][..x.count].iter().sum();
        let rows = locate(range.low)..=locate(range.high);
        rows.map(|row| (y.edges(row), total(row))).collect()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn of(points: &[(f64, f64)]) -> Histogram2d<16, 8> {
        let mut histogram = Histogram2d::default();
        let (x, y): (Vec<_>, Vec<_>) = points.iter().copied().unzip();
        histogram.add(&x, &y);
        histogram
    }

    fn points() -> impl Strategy<Value = Vec<(f64, f64)>> {
        let magnitude = prop::sample::select(vec![1e-3, 1.0, 1e4]);
        let point = (magnitude, -1.0..1.0_f64, -1.0..1.0_f64).prop_map(|(m, x, y)| (m * x, m * y));
        prop::collection::vec(point, 1..60)
    }

    proptest! {
        #[test]
        fn cells_do_not_depend_on_splitting_merging_or_order(points in points(), at in 0usize..60) {
            let whole = of(&points);
            let (a, b) = points.split_at(at.min(points.len()));
            let mut in_blocks = of(a);
            let (x, y): (Vec<_>, Vec<_>) = b.iter().copied().unzip();
            in_blocks.add(&x, &y);
            let mut merged = of(b);
            merged.merge(&of(a));
            prop_assert_eq!(whole.cells([0, 0]), in_blocks.cells([0, 0]));
            prop_assert_eq!(whole.cells([0, 0]), merged.cells([0, 0]));
        }

        #[test]
        fn every_point_is_counted_in_the_cell_that_contains_it(points in points()) {
            for doublings in [[0, 0], [2, 1]] {
                for HistogramCell { x, y, count } in of(&points).cells(doublings) {
                    let inside = |&&(px, py): &&(f64, f64)| {
                        px >= x.low && px < x.high && py >= y.low && py < y.high
                    };
                    prop_assert_eq!(points.iter().filter(inside).count() as u64, count);
                }
            }
        }

        #[test]
        fn the_marginal_adds_up(points in points()) {
            let histogram = of(&points);
            let total: u64 = histogram.marginal_y().iter().map(|&(_, count)| count).sum();
            prop_assert_eq!(total, points.len() as u64);
            prop_assert_eq!(histogram.points, points.len() as u64);
        }
    }

    #[test]
    fn points_that_are_not_finite_are_left_out() {
        let histogram = of(&[(1.0, f64::NAN), (f64::INFINITY, 1.0), (1.0, 1.0)]);
        assert_eq!(histogram.points, 1);
        let nothing = of(&[(f64::NAN, 0.0)]);
        assert!(nothing.cells([0, 0]).is_empty() && nothing.marginal_y().is_empty());
    }
}
