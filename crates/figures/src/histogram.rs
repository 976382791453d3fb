//! A two-dimensional histogram that finds its own ranges.

use std::array;

use super::bins::Bins;

/// Counts of points (x, y) in equal rectangular cells.
///
/// Holds a fixed number of cells however many points it is given. Cell widths are powers of two and
/// double when a point falls outside, which moves whole cells into whole cells: the counts are exact
/// for the final cells and independent of the order of points, blocks and merges. At least half of
/// the bins of each axis span the data.
#[derive(Clone, Debug)]
pub(super) struct Histogram2d {
    bins: [usize; 2],
    grid: Option<CellGrid>,
    /// Number of points counted.
    pub(super) points: u64,
}

#[derive(Clone, Debug)]
struct CellGrid {
    /// Of x and of y, as the ranges.
    bins: [Bins; 2],
    ranges: [ValueRange; 2],
    /// Row by row, y ascending.
    counts: Vec<u64>,
}

/// The smallest and the largest value of a coordinate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ValueRange {
    pub(super) low: f64,
    pub(super) high: f64,
}

impl ValueRange {
    const EMPTY: Self = Self { low: f64::INFINITY, high: f64::NEG_INFINITY };

    /// The range of some values; empty, with ends that are infinite, of none.
    pub(super) fn over(values: impl IntoIterator<Item = f64>) -> Self {
        values.into_iter().fold(Self::EMPTY, Self::including)
    }

    fn including(self, value: f64) -> Self {
        Self { low: self.low.min(value), high: self.high.max(value) }
    }

    pub(super) fn union(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }
}

/// One cell that is not empty: its edges and its count.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct HistogramCell {
    pub(super) x: ValueRange,
    pub(super) y: ValueRange,
    pub(super) count: u64,
}

impl Histogram2d {
    /// An empty histogram of at most `bins_x` by `bins_y` cells, each at least 2.
    ///
    /// # Panics
    /// If an axis has fewer than 2 bins: data on both sides of zero need as many.
    pub(super) fn new(bins_x: usize, bins_y: usize) -> Self {
        assert!(bins_x >= 2 && bins_y >= 2, "at least two bins on each axis");
        Self { bins: [bins_x, bins_y], grid: None, points: 0 }
    }

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
        let grid = self.cover(range);
        let ([column, row], width) = (grid.bins.map(|bins| bins.locator()), grid.bins[0].count);
        for (&x, &y) in x.iter().zip(y) {
            if x.is_finite() && y.is_finite() {
                grid.counts[row(y) * width + column(x)] += 1;
            }
        }
    }

    /// Adds the counts of a histogram with the same number of bins.
    ///
    /// # Panics
    /// If the numbers of bins differ.
    pub(super) fn merge(&mut self, other: &Self) {
        assert_eq!(self.bins, other.bins, "histograms of the same shape");
        self.points += other.points;
        if let Some(theirs) = &other.grid {
            self.cover(theirs.ranges).absorb(theirs);
        }
    }

    /// The smallest and largest x and y, `None` while empty.
    pub(super) fn ranges(&self) -> Option<[ValueRange; 2]> {
        self.grid.as_ref().map(|grid| grid.ranges)
    }

    /// The cells that are not empty, row by row; cells merged 2^`doublings` by 2^`doublings`.
    pub(super) fn cells(&self, doublings: [u32; 2]) -> Vec<HistogramCell> {
        let Some(grid) = &self.grid else { return Vec::new() };
        let bins = array::from_fn(|i| grid.bins[i].coarsened(doublings[i]));
        let mut coarse = CellGrid::empty(bins, grid.ranges);
        coarse.absorb(grid);
        let CellGrid { bins: [x, y], counts, .. } = coarse;
        let occupied = counts.iter().enumerate().filter(|&(_, &count)| count > 0);
        occupied
            .map(|(i, &count)| HistogramCell {
                x: x.edges(i % x.count),
                y: y.edges(i / x.count),
                count,
            })
            .collect()
    }

    /// The counts over y alone: edges of each bin from the first to the last that is not empty.
    pub(super) fn marginal_y(&self) -> Vec<(ValueRange, u64)> {
        let Some(grid) = &self.grid else { return Vec::new() };
        let ([x, y], [_, range]) = (grid.bins, grid.ranges);
        let locate = y.locator();
        let total = |row: usize| grid.counts[row * x.count..][..x.count].iter().sum();
        let rows = locate(range.low)..=locate(range.high);
        rows.map(|row| (y.edges(row), total(row))).collect()
    }

    /// The grid, made to cover a range as well as all it covers already.
    fn cover(&mut self, ranges: [ValueRange; 2]) -> &mut CellGrid {
        let grid = match self.grid.take() {
            None => {
                let around = |i: usize| Bins::around(ranges[i].low, ranges[i].high, self.bins[i]);
                CellGrid::empty(array::from_fn(around), ranges)
            }
            Some(grid) => {
                let ranges = array::from_fn(|i| ranges[i].union(grid.ranges[i]));
                let widened = |i: usize| grid.bins[i].widened(ranges[i].low, ranges[i].high);
                let bins = array::from_fn(widened);
                if bins == grid.bins {
                    CellGrid { ranges, ..grid }
                } else {
                    let mut wider = CellGrid::empty(bins, ranges);
                    wider.absorb(&grid);
                    wider
                }
            }
        };
        self.grid.insert(grid)
    }
}

impl Bins {
    fn edges(&self, position: usize) -> ValueRange {
        ValueRange { low: self.edge(position), high: self.edge(position + 1) }
    }
}

impl CellGrid {
    fn empty(bins: [Bins; 2], ranges: [ValueRange; 2]) -> Self {
        Self { bins, ranges, counts: vec![0; bins[0].count * bins[1].count] }
    }

    /// Adds the counts of a grid that has equal or finer cells inside this one's range.
    fn absorb(&mut self, finer: &Self) {
        let ([x, y], [finer_x, finer_y]) = (self.bins, finer.bins);
        for (row, counts) in finer.counts.chunks_exact(finer_x.count).enumerate() {
            for (column, &count) in counts.iter().enumerate().filter(|&(_, &count)| count > 0) {
                let row = y.position_of(&finer_y, row);
                self.counts[row * x.count + x.position_of(&finer_x, column)] += count;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn of(points: &[(f64, f64)]) -> Histogram2d {
        let mut histogram = Histogram2d::new(16, 8);
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
