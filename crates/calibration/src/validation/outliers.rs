//! Outliers: corrupt rows, found by their deleted residuals.
//!
//! A row is tested by a fit to the others, with the error `e` of an axis, its standard deviation
//! `σ` over the rows of the fit and the leverage `h = ‖Fᵀx‖²` of the row's features:
//!
//! ```text
//! size = |e| / (σ·√(1 + h))      of a row that the fit has not seen
//! size = |e| / (σ·√(1 − h))      of one that it has
//! ```
//!
//! A row is an outlier if its size exceeds a limit on any axis (Cook and Weisberg, Residuals and
//! Influence in Regression, 1982, §2.2), with two exceptions:
//! - Its neighbours have similar errors: motion that a model cannot follow lasts, a slip takes a
//!   row or two.
//! - The error is no larger than the change of both the prediction and the load from one row to the
//!   next: sensor and reference are not sampled at the same time.
//!
//! Three other rules find outliers that a fit follows, that lie far away, or that are small:
//!
//! - A reading is more than eight standard deviations from the mean and half that from both
//!   neighbours.
//! - The size is above 3, a reading jumps by two standard deviations from both neighbours in the
//!   same direction, and the leverage is more than half of the maximum and twenty times the
//!   average. A fit follows such rows regardless of their values.
//! - The size is above 4, and a reading jumps from both neighbours by six standard deviations of
//!   its channel's changes from row to row: fast motion may cause as large an error, but not such a
//!   jump.
//!
//! Corrupt rows bend a fit towards themselves and hide each other. The search therefore begins
//! without all rows that exceed a limit, and returns the good ones until the fit no longer changes.
//!
//! The [limit](LIMIT) is 10 because a row moves the predictions of `n` others by no more than
//! `size·σ/√n` on average: to move a root mean square error by a tenth, it needs a size of
//! `0.46·√n`, above 10 from 470 rows on. If many errors are large, a search raises the limit far
//! above all of them.

use crate::conversion::Calibration;
use crate::prediction::spread;
use least_squares::error::FitError;
use least_squares::features::{Features, LANES};
use least_squares::passes::{Workers, each};
use least_squares::reading_ranges::ReadingRanges;
use least_squares::solver::Solution;
use least_squares::symmetric::{TriangularColumns, triangular_columns};
use shell_data::block::Block;
use shell_data::dataset::Dataset;
use shell_data::statistics::RunningVariance;
use shell_data::vectorised;
use shell_data::wrench::{Axis, PerAxis};

/// Least limit for the size of an error: a row beyond the limit is an outlier.
pub const LIMIT: f64 = 10.0;

/// Limit for the distance of a reading from its mean, in standard deviations.
const FAR: f64 = 8.0;

/// Sizes above which a row is tested; the leverage in the test takes time.
const LOOK_AT_ERROR: f64 = 3.6;
const LOOK_AT_READING: f64 = 4.5;

/// Limits for a row that dominates a fit: leverage, leverage in multiples of the average, jump from both
/// neighbours in standard deviations, size of the error.
const TAKES_OVER: f64 = 0.5;
const TAKES_OVER_IN_AVERAGES: f64 = 20.0;
const JUMP: f64 = 2.0;
const SIZE_WITH_JUMP: f64 = 3.0;

/// Limits for a spike: jump from both neighbours, in standard deviations of the channel's changes; error size.
const SPIKE: f64 = 6.0;
const SIZE_WITH_SPIKE: f64 = 4.0;

/// Distances, in rows before and after a slip of one row or two, at which its error has halved.
const BESIDE: [[usize; 2]; 3] = [[1, 1], [1, 2], [2, 1]];

/// Errors below this share of the standard deviation of the load are rounding.
const SMALLEST_NOISE: f64 = 1e-4;

#[derive(Debug)]
pub struct RowTest<'a> {
    spread: &'a Spread,
    pub calibration: Calibration,
    features: Features,
    factor: TriangularColumns,
    /// Standard deviation of the errors of each axis, N and N·m.
    pub noise: PerAxis<f64>,
    average_leverage: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TestedRow {
    pub row: usize,
    /// Predicted minus measured, N and N·m.
    pub error: PerAxis<f64>,
    /// The largest size of an error.
    pub size: f64,
    pub axis: usize,
    /// True if the neighbours have smaller errors, and the load changes by less than the error.
    errs_alone: bool,
    /// The largest distance of a reading from its mean, in standard deviations.
    far: f64,
    /// True if that reading is also far from both neighbours.
    is_far_alone: bool,
    /// True if a reading jumps from both neighbours, and the leverage is high enough to dominate the fit.
    takes_over: bool,
    /// True if a reading jumps from both neighbours by more than usual, and the error is large.
    is_spike: bool,
}

impl TestedRow {
    pub fn is_outlier(&self, limit: f64) -> bool {
        (self.size > limit && self.errs_alone)
            || (self.far > FAR && self.is_far_alone)
            || (self.size > SIZE_WITH_JUMP && self.takes_over)
            || (self.errs_alone && self.is_spike)
    }

    /// Returns true if the row, tested by a fit to all rows, justifies a search. A spike or a far
    /// reading with a small error does not: one in some hundred thousand good rows looks like that.
    pub fn starts_search(&self) -> bool {
        (self.size > LIMIT && self.errs_alone) || self.takes_over
    }

    pub fn stands_out(&self) -> bool {
        self.size > LIMIT || self.far > FAR || self.takes_over
    }
}

impl<'a> RowTest<'a> {
    /// Creates a test; `None` if there are no more rows than coefficients.
    pub fn new(solution: &Solution, spread: &'a Spread) -> Option<Self> {
        let features = Features::new(solution.model, solution.scaling.clone());
        let free = solution.rows.checked_sub(features.len() as u64).filter(|&free| free > 0)?;
        let channels = solution.model.columns();
        let noise = std::array::from_fn(|axis| {
            let variance = solution.residual_products[(axis, axis)] / free as f64;
            let load = spread.deviations[channels + axis];
            variance.max(0.0).sqrt().max(SMALLEST_NOISE * load)
        });
        Some(Self {
            spread,
            calibration: Calibration::from_solution(solution, &ReadingRanges::new(channels)),
            average_leverage: features.len() as f64 / solution.rows as f64,
            features,
            factor: triangular_columns(solution.factor.as_ref()),
            noise,
        })
    }

    /// Largest size of the errors of rows that are not [suspects](Self::suspects) of a fit with
    /// `noise`, if both fits predict the same.
    pub fn largest_unseen(&self, noise: &PerAxis<f64>) -> f64 {
        let sizes = noise.iter().zip(&self.noise).map(|(noise, own)| LOOK_AT_ERROR * noise / own);
        sizes.fold(0.0, f64::max)
    }

    /// Finds the rows of a block to test: a large error, a far reading, a jump or a spike. Public functions here
    /// are not generic, because generic ones are compiled with their callers, perhaps optimised for size.
    pub fn suspects(&self, block: &Block, predicted: &PerAxis<Vec<f64>>) -> Vec<usize> {
        let excess = row_excess(self, predicted, block);
        excess.iter().enumerate().filter(|(_, excess)| **excess > 1.0).map(|(row, _)| row).collect()
    }

    /// Tests a few rows of a block, in ascending order, by a fit that `has_left_out` some of them.
    pub fn test(
        &self,
        block: &Block,
        rows: &[usize],
        has_left_out: &dyn Fn(usize) -> bool,
    ) -> Vec<TestedRow> {
        if rows.is_empty() {
            return Vec::new();
        }
        let (columns, positions) = &copy_rows(rows, block);
        let mut predicted = PerAxis::default();
        self.calibration.wrench(&columns.readings, &mut predicted);
        let error = |axis: usize, at: usize| predicted[axis][at] - columns.wrench[axis][at];
        let test_row = |(&position, leverage): (&TestPosition, f64)| {
            let TestPosition { row, at, .. } = position;
            // The residual of a row of leverage one is rounding, because the fit follows it. The
            // values: variance of the error, leverage in a fit with the row, factor from its error
            // to that of a fit without it.
            let (variance, in_fit, deleted) = match has_left_out(row) {
                true => (1.0 + leverage, leverage / (1.0 + leverage), 1.0),
                false => ((1.0 - leverage).max(1e-9), leverage, (1.0 - leverage).max(1e-9).recip()),
            };
            let scale = variance.sqrt().recip();
            let sizes: PerAxis<f64> = std::array::from_fn(|axis| match self.noise[axis] > 0.0 {
                true => error(axis, at).abs() / self.noise[axis] * scale,
                false => 0.0,
            });
            let axis = (0..6).max_by(|&a, &b| sizes[a].total_cmp(&sizes[b])).unwrap_or(0);
            let (size, own) = (sizes[axis], error(axis, at));
            let errs_alike = |beside: Option<usize>| {
                beside.is_some_and(|at| error(axis, at) * own.signum() > 0.5 * deleted * own.abs())
            };
            let halves = |[before, after]: [usize; 2]| {
                !errs_alike(position.before(before)) && !errs_alike(position.after(after))
            };
            // If the load moves, a sensor that is sampled earlier errs by a part of the change.
            let exceeds_change = deleted * own.abs()
                > change(&predicted[axis], position).min(change(&columns.wrench[axis], position));
            let (far, is_far_alone) = distance(columns, self.spread, position);
            TestedRow {
                row,
                error: std::array::from_fn(|axis| error(axis, at)),
                size,
                axis,
                errs_alone: exceeds_change && BESIDE.into_iter().any(halves),
                far,
                is_far_alone,
                takes_over: exceeds_change
                    && in_fit > TAKES_OVER
                    && in_fit > TAKES_OVER_IN_AVERAGES * self.average_leverage
                    && jumps(columns, &self.spread.deviations, JUMP, position),
                is_spike: size > SIZE_WITH_SPIKE
                    && jumps(columns, &self.spread.changes, SPIKE, position),
            }
        };
        let of_rows = |column: &Vec<f64>| positions.iter().map(|of| column[of.at]).collect();
        let readings: Vec<Vec<f64>> = columns.readings.iter().map(of_rows).collect();
        positions.iter().zip(leverages(self, &readings)).map(test_row).collect()
    }
}

vectorised! {
    /// `‖Fᵀx‖²` of each row.
    fn leverages(test: &RowTest<'_>, readings: &[Vec<f64>]) -> Vec<f64> {
        let mut features = vec![[0.0; LANES]; test.features.len()];
        let rows = readings.first().map_or(0, Vec::len);
        let mut leverages = Vec::with_capacity(rows + LANES);
        for start in (0..rows).step_by(LANES) {
            test.features.lanes(readings, start, &mut features);
            leverages.extend(spread(&test.factor, &features));
        }
        leverages.truncate(rows);
        leverages
    }
}

/// A row of a block, and its index in columns that hold copies of this row and its neighbours.
#[derive(Clone, Copy, Debug)]
struct TestPosition {
    row: usize,
    at: usize,
    rows: usize,
}

impl TestPosition {
    fn before(self, distance: usize) -> Option<usize> {
        (self.row >= distance).then(|| self.at - distance)
    }

    fn after(self, distance: usize) -> Option<usize> {
        (self.row + distance < self.rows).then_some(self.at + distance)
    }
}

/// Copies rows of a block, ascending, with neighbours; returns the positions among the copies.
fn copy_rows(rows: &[usize], block: &Block) -> (Block, Vec<TestPosition>) {
    const REACH: usize = 2;
    let mut copies = Block::default();
    let mut copied = 0;
    let position = |&row: &usize| {
        let near = copied.max(row.saturating_sub(REACH))..block.rows.min(row + REACH + 1);
        copied = near.end;
        copies.append(block, near);
        TestPosition { row, at: copies.rows - (copied - row), rows: block.rows }
    };
    let positions = rows.iter().map(position).collect();
    (copies, positions)
}

vectorised! {
    /// Largest ratio, in each row, of errors, distances from the mean and jumps to the limits above which it is tested.
    fn row_excess(test: &RowTest<'_>, predicted: &PerAxis<Vec<f64>>, block: &Block) -> Vec<f64> {
        let mut excess = vec![0.0; block.rows];
        for (axis, (predicted, measured)) in predicted.iter().zip(&block.wrench).enumerate() {
            let scale = (LOOK_AT_ERROR * test.noise[axis]).recip();
            for ((excess, p), m) in excess.iter_mut().zip(predicted).zip(measured) {
                raise(excess, (p - m).abs() * scale);
            }
        }
        let Spread { means, deviations, changes } = test.spread;
        let spreads = means.iter().zip(deviations).zip(changes);
        for (column, ((mean, sd), change)) in block.readings.iter().zip(spreads) {
            let scale = (LOOK_AT_READING * sd).recip();
            for (excess, value) in excess.iter_mut().zip(column) {
                raise(excess, (value - mean).abs() * scale);
            }
            let scale = (SPIKE * change).min(JUMP * sd).recip();
            let rows = excess.get_mut(1..).unwrap_or_default();
            for (excess, of) in rows.iter_mut().zip(column.windows(3)) {
                raise(excess, jump(of[1], [of[0], of[2]]) * scale);
            }
            // The first and the last row have one neighbour here: the other is in another block.
            if let ([first, second, ..], [.., before, last]) = (&column[..], &column[..]) {
                raise(&mut excess[0], jump(*first, [*second; 2]) * scale);
                raise(&mut excess[block.rows - 1], jump(*last, [*before; 2]) * scale);
            }
        }
        excess
    }
}

/// Raises `excess` to `to`. If a limit is zero, a value of zero gives NaN, which raises nothing.
#[inline(always)]
fn raise(excess: &mut f64, to: f64) {
    *excess = if to > *excess { to } else { *excess };
}

/// Largest distance of a reading of a row from its mean, in standard deviations. The second value
/// is true if the reading is also half the limit away from both neighbours.
fn distance(columns: &Block, spread: &Spread, position: TestPosition) -> (f64, bool) {
    let far = |(channel, column): (usize, &Vec<f64>)| {
        (channel, spread.apart(channel, column[position.at], spread.means[channel]))
    };
    let all = columns.readings.iter().enumerate().map(far);
    let farthest = all.max_by(|(_, a), (_, b)| a.total_cmp(b));
    let Some((channel, far)) = farthest else { return (0.0, false) };
    let column = &columns.readings[channel];
    let is_apart = |beside: Option<usize>| {
        beside.is_none_or(|at| spread.apart(channel, column[position.at], column[at]) > 0.5 * FAR)
    };
    (far, is_apart(position.before(1)) && is_apart(position.after(1)))
}

fn change(values: &[f64], position: TestPosition) -> f64 {
    let beside = [position.before(1), position.after(1)].into_iter().flatten();
    beside.map(|at| (values[position.at] - values[at]).abs()).fold(0.0, f64::max)
}

/// Returns true if a reading jumps from both neighbours by `limit` times its channel's deviation.
fn jumps(columns: &Block, deviations: &[f64], limit: f64, position: TestPosition) -> bool {
    let [before, after] = [position.before(1), position.after(1)];
    let (Some(before), Some(after)) = (before.or(after), after.or(before)) else { return false };
    columns.readings.iter().zip(deviations).any(|(column, deviation)| {
        let size = jump(column[position.at], [column[before], column[after]]);
        size > limit * deviation
    })
}

/// The distance of a value above both neighbours, or below both; negative if it is between them.
#[inline(always)]
fn jump(value: f64, [before, after]: [f64; 2]) -> f64 {
    let (a, b) = (value - before, value - after);
    let least = |a: f64, b: f64| if a < b { a } else { b };
    let (up, down) = (least(a, b), least(-a, -b));
    if up > down { up } else { down }
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Spread {
    /// Means of the readings of each channel, then of the axes of the wrench.
    pub(super) means: Vec<f64>,
    pub(super) deviations: Vec<f64>,
    pub(super) changes: Vec<f64>,
}

impl Spread {
    pub fn new(data: &Dataset, workers: Workers<'_>) -> Result<Self, FitError> {
        /// This number of rows determines a standard deviation to one percent.
        const ENOUGH: u64 = 8192;
        let step = (data.rows() / ENOUGH).max(1) as usize;
        let blocks: Vec<&Block> = data.blocks().map(|(_, block)| &*block.rows).collect();
        let mut columns = Vec::<RunningVariance>::new();
        let merge = |of_block: Vec<RunningVariance>| {
            columns.resize(of_block.len(), RunningVariance::default());
            columns.iter_mut().zip(&of_block).for_each(|(all, block)| all.merge(block));
            Ok(())
        };
        let of_block = |(): &mut (), block: &&Block| Ok(sampled_spread(block, step));
        let workers = Workers { watch: None, ..workers };
        each(&blocks, |block| block, workers, || (), of_block, merge)?;
        let readings = columns.len().saturating_sub(Axis::ALL.len()) / 2;
        let changes = columns.split_off(columns.len() - readings);
        let sd = RunningVariance::rms_about_mean;
        Ok(Self {
            means: columns.iter().map(|of| of.mean).collect(),
            deviations: columns.iter().map(sd).collect(),
            changes: changes.iter().map(sd).collect(),
        })
    }

    /// Distance between two values of a column, in standard deviations.
    pub fn apart(&self, column: usize, value: f64, other: f64) -> f64 {
        let sd = self.deviations[column];
        if sd > 0.0 { (value - other).abs() / sd } else { 0.0 }
    }
}

/// Mean and variance of each column: readings, wrench, then changes of the readings from row to
/// row. Uses every `step`-th run.
fn sampled_spread(block: &Block, step: usize) -> Vec<RunningVariance> {
    /// Rows of a run, if `step` is more than one.
    const RUN: usize = 32;
    let run = if step > 1 { RUN } else { block.rows.max(1) };
    let mut values = Vec::with_capacity(block.rows / step + run);
    let mut of = |column: &Vec<f64>, changes: bool| {
        values.clear();
        for run in column.chunks(run).step_by(step) {
            match changes {
                true => values.extend(run.windows(2).map(|pair| pair[1] - pair[0])),
                false => values.extend_from_slice(run),
            }
        }
        RunningVariance::new(&values)
    };
    let Block { readings, wrench, .. } = block;
    let mut all: Vec<_> = readings.iter().chain(wrench).map(|column| of(column, false)).collect();
    all.extend(readings.iter().map(|column| of(column, true)));
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_jump_is_away_from_both_neighbours() {
        assert_eq!(jump(5.0, [1.0, 2.0]), 3.0);
        assert_eq!(jump(-5.0, [1.0, 2.0]), 6.0);
        assert!(jump(1.5, [1.0, 2.0]) < 0.0);
    }

    use shell_data::wrench::Axes;

    #[test]
    fn spreads_of_blocks_merge_and_measure_in_standard_deviations() {
        let block = |column: Vec<f64>| Block {
            rows: column.len(),
            wrench: vec![vec![0.0; column.len()]; 6],
            readings: vec![column],
            ..Block::default()
        };
        let blocks = vec![block(vec![1.0, 3.0]), block(vec![1.0, 3.0, 9.0, 9.0])];
        let data = Dataset::from_blocks("memory", Axes::ALL, blocks);
        let spread = Spread::new(&data, Workers::ONE).unwrap();
        // The squares add up to 182, the mean is 26/6. Rounding of a few operations.
        let sd = (182.0 / 6.0 - (26.0_f64 / 6.0).powi(2)).sqrt();
        assert!((spread.apart(0, 5.0, 3.0) - 2.0 / sd).abs() < 1e-12);
        // Changes of 2, 2, 6 and 0, with mean 2.5.
        assert!((spread.changes[0] - (44.0_f64 / 4.0 - 2.5 * 2.5).sqrt()).abs() < 1e-12);
    }

    #[test]
    fn the_spread_of_many_rows_is_that_of_rows_all_over_them() {
        let value = |row: usize| (row as f64 * 0.7).sin() + row as f64 * 1e-5;
        let block = |start: usize| Block {
            rows: 1000,
            readings: vec![(start..start + 1000).map(value).collect()],
            wrench: vec![vec![0.0; 1000]; 6],
            ..Block::default()
        };
        let blocks = (0..100).map(|block_of| block(block_of * 1000)).collect();
        let data = Dataset::from_blocks("memory", Axes::ALL, blocks);
        let spread = Spread::new(&data, Workers::ONE).unwrap();
        let whole = RunningVariance::new(&(0..100_000).map(value).collect::<Vec<_>>());
        // The spread comes from a twelfth of the rows.
        assert!((spread.deviations[0] / whole.rms_about_mean() - 1.0).abs() < 0.02);
        assert!((spread.means[0] - whole.mean).abs() < 0.02);
    }
}
