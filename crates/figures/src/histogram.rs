//! Histograms that find their own ranges: equal bins whose width doubles as the data spread.
//!
//! Bin `i` at exponent `k` covers `[i·2ᵏ, (i+1)·2ᵏ)`, so bins nest exactly in those of the next
//! exponent: the smallest that fits the range so far, whatever the order of the data.

use std::array;

use super::axes::ValueRange;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bins {
    /// Bins are 2^exponent wide.
    pub(super) exponent: i32,
    pub(super) first: i64,
    pub(super) count: usize,
}

/// The limit below which indices stay exact integers in `f64`.
const LARGEST_INDEX: f64 = (1u64 << 52) as f64;
/// Below this exponent a scale factor would leave the range of `f64`.
const SMALLEST_EXPONENT: i32 = -1000;

impl Bins {
    /// `count` bins centred on a finite range, at least `2^exponent` wide.
    fn around(exponent: i32, ValueRange { low, high }: ValueRange, count: usize) -> Self {
        // An exponent that is certainly too small, but near enough to try the next few.
        let width = (high / count as f64 - low / count as f64)
            .max(high.abs().max(low.abs()) * 2f64.powi(-52));
        let estimate =
            if width > 0.0 { width.log2().floor() as i32 - 1 } else { SMALLEST_EXPONENT };
        let mut exponent = exponent.max(estimate);
        loop {
            let (from, to) = (floor_index(low, exponent), floor_index(high, exponent));
            if from.abs().max(to.abs()) < LARGEST_INDEX && to - from < count as f64 {
                let spare = count as i64 - 1 - (to - from) as i64;
                return Self { exponent, first: from as i64 - spare / 2, count };
            }
            exponent += 1;
        }
    }

    /// A window that contains the range: this one if possible, otherwise one with wider bins.
    fn widened(self, range: ValueRange) -> Self {
        match self.contains(range.low) && self.contains(range.high) {
            true => self,
            false => Self::around(self.exponent, range, self.count),
        }
    }

    fn contains(&self, value: f64) -> bool {
        let offset = floor_index(value, self.exponent) - self.first as f64;
        offset >= 0.0 && offset < self.count as f64
    }

    pub(super) fn locator(&self) -> impl Fn(f64) -> usize + use<> {
        let (scale, first) = (2f64.powi(-self.exponent), self.first as f64);
        move |value| ((value * scale).floor() - first) as usize
    }

    /// Maps bin `position` of `other`, which has equal or finer bins, to this window.
    fn position_of(&self, other: &Self, position: usize) -> usize {
        let index = (other.first + position as i64) >> (self.exponent - other.exponent).min(63);
        (index - self.first) as usize
    }

    pub(super) fn edges(&self, position: usize) -> ValueRange {
        let [low, high] = [position, position + 1]
            .map(|position| (self.first + position as i64) as f64 * 2f64.powi(self.exponent));
        ValueRange { low, high }
    }

    /// Merges 2^`doublings` bins each, with the narrowest possible window.
    pub(super) fn coarsened(&self, doublings: u32) -> Self {
        let first = self.first >> doublings;
        let last = (self.first + self.count as i64 - 1) >> doublings;
        let count = (last - first + 1) as usize;
        Self { exponent: self.exponent + doublings as i32, first, count }
    }
}

#[derive(Clone, Debug)]
pub(super) struct Grid<C, const N: usize> {
    pub(super) bins: [Bins; N],
    pub(super) ranges: [ValueRange; N],
    /// In sequence, the first dimension fastest.
    pub(super) cells: Vec<C>,
}

pub(super) trait Cell: Clone + Default + PartialEq {
    fn absorb(&mut self, later: &Self);
}

impl<C: Cell, const N: usize> Grid<C, N> {
    pub(super) fn empty(bins: [Bins; N], ranges: [ValueRange; N]) -> Self {
        let count = bins.iter().map(|bins| bins.count).product();
        Self { bins, ranges, cells: vec![C::default(); count] }
    }

    /// Extends a grid to cover finite ranges in addition to its own, with `counts` bins.
    pub(super) fn cover(
        grid: &mut Option<Self>,
        ranges: [ValueRange; N],
        counts: [usize; N],
    ) -> &mut Self {
        let covering = match grid.take() {
            None => Self::empty(
                array::from_fn(|i| Bins::around(SMALLEST_EXPONENT, ranges[i], counts[i])),
                ranges,
            ),
            Some(grid) => {
                let ranges = array::from_fn(|i| ranges[i].union(grid.ranges[i]));
                let bins = array::from_fn(|i| grid.bins[i].widened(ranges[i]));
                if bins == grid.bins {
                    Self { ranges, ..grid }
                } else {
                    let mut wider = Self::empty(bins, ranges);
                    wider.absorb(&grid);
                    wider
                }
            }
        };
        grid.insert(covering)
    }

    /// Adds the cells of a grid with equal or finer cells inside this one's range.
    pub(super) fn absorb(&mut self, finer: &Self) {
        let nothing = C::default();
        for (index, cell) in finer.cells.iter().enumerate().filter(|(_, cell)| **cell != nothing) {
            let (mut here, mut stride, mut rest) = (0, 1, index);
            for (bins, finer) in self.bins.iter().zip(&finer.bins) {
                here += stride * bins.position_of(finer, rest % finer.count);
                (stride, rest) = (stride * bins.count, rest / finer.count);
            }
            self.cells[here].absorb(cell);
        }
    }
}

fn floor_index(value: f64, exponent: i32) -> f64 {
    (value * 2f64.powi(-exponent)).floor()
}

/// Counts of points (x, y) in at most `X` by `Y` equal cells. Cell widths are powers of two that
/// double when a point falls outside, which merges whole cells: counts are exact and independent of
/// the order of points, blocks and merges. At least half of the bins of each axis span the data.
#[derive(Clone, Debug, Default)]
pub(super) struct Histogram2d<const X: usize, const Y: usize> {
    grid: Option<Grid<u64, 2>>,
    pub(super) points: u64,
}

impl Cell for u64 {
    fn absorb(&mut self, later: &Self) {
        *self += later;
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct HistogramCell {
    pub(super) x: ValueRange,
    pub(super) y: ValueRange,
    pub(super) count: u64,
}

impl<const X: usize, const Y: usize> Histogram2d<X, Y> {
    /// Counts the points (`x[i]`, `y[i]`); points that are not finite are skipped.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub(super) fn add(&mut self, x: &[f64], y: &[f64]) {
        assert_eq!(x.len(), y.len(), "one y for every x");
        let points = || {
            let pairs = x.iter().copied().zip(y.iter().copied());
            pairs.filter(|(x, y)| x.is_finite() && y.is_finite())
        };
        let with = |[x, y]: [ValueRange; 2], (a, b)| [x.including(a), y.including(b)];
        let ranges = points().fold([ValueRange::EMPTY; 2], with);
        if ranges[0].low > ranges[0].high {
            return;
        }
        let grid = Grid::cover(&mut self.grid, ranges, [X, Y]);
        let ([column, row], width) = (grid.bins.map(|bins| bins.locator()), grid.bins[0].count);
        for (x, y) in points() {
            grid.cells[row(y) * width + column(x)] += 1;
            self.points += 1;
        }
    }

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

    /// The nonempty cells, row by row, merged 2^`doublings` by 2^`doublings`.
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

    /// The counts over y alone: edges of each bin from the first to the last nonempty one.
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

    proptest! {
        #[test]
        fn the_window_holds_the_range_with_at_least_half_of_its_bins(
            low in -1e9..1e9_f64, span in 1e-6..1e9_f64,
        ) {
            let high = low + span;
            let bins = Bins::around(SMALLEST_EXPONENT, ValueRange { low, high }, 256);
            prop_assert!(bins.contains(low) && bins.contains(high));
            let used = bins.locator()(high) - bins.locator()(low) + 1;
            // One bin finer would not have fitted: at least 257 bins of half the width.
            prop_assert!((128..=256).contains(&used), "{used}");
        }

        #[test]
        fn coarse_bins_are_sums_of_fine_ones(value in -1e3..1e3_f64, more in 0.0..1e6_f64) {
            let fine = Bins::around(SMALLEST_EXPONENT, ValueRange { low: value, high: value + 1e-3 }, 64);
            let wider = ValueRange { low: value - more, high: value + 1.0 };
            let coarse = Bins::around(fine.exponent, wider, 64);
            let position = coarse.position_of(&fine, fine.locator()(value));
            prop_assert_eq!(position, coarse.locator()(value));
            let coarser = fine.coarsened(3);
            prop_assert_eq!(coarser.position_of(&fine, fine.locator()(value)), coarser.locator()(value));
        }
    }

    #[test]
    fn ranges_at_the_limits_of_f64_are_counted() {
        for (low, high) in [
            (0.0, 0.0),
            (-0.0, 0.0),
            (5e-324, 5e-324),
            (-5e-324, 5e-324),
            (1e300, 1e300),
            (f64::MIN, f64::MAX),
            (1.0, 1.0 + f64::EPSILON),
        ] {
            let bins = Bins::around(SMALLEST_EXPONENT, ValueRange { low, high }, 16);
            assert!(bins.contains(low) && bins.contains(high), "{low} {high} {bins:?}");
            let edge = bins.edges(0).low;
            assert!(edge <= low || edge == f64::NEG_INFINITY);
        }
    }

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
