//! Training rows in groups that are held out together, and observations. An observation is the mean of wrench and
//! readings over a cell: rows of a group with a similar wrench. A fit uses a sample of the observations.
//!
//! Rows of a pose repeat one observation, so the fit sees their mean, and every mean has the same weight. Where the
//! wrench changes within a group, as in a push by hand, each cell has a mean. Cells are [`CELL_WIDTH`] wide, and the
//! group's mean is in the middle of one: a pose of constant load is a single cell.
//!
//! Sums are integers: values are rounded once, to 2⁻⁶⁰ of the largest in the column, so the order of rows has no
//! effect.

use std::collections::{BTreeMap, BTreeSet};

use super::PhysicsError;
use super::fit::{MOST_CHANNELS, Observation};
use super::inversion::Estimates;
use least_squares::grouped_rows::{GroupedRows, Run, count, every_nth};
use shell_data::dataset::Dataset;
use shell_data::wrench::PerAxis;

/// Maximum number of rows that are converted at a time, because the results take memory.
const ROWS_AT_ONCE: usize = 4096;

#[derive(Clone, Debug, Default)]
pub struct TrainingRows {
    pub(super) rows: GroupedRows,
    pub(super) channels: usize,
    /// Reference for conversions of a group's rows, if not their wrench: the stated load, if readings corrected it.
    pub judged_by: BTreeMap<u64, PerAxis<f64>>,
}

impl TrainingRows {
    /// Takes the labelled rows of a data set. Also returns the labels of their groups in the order of first rows.
    ///
    /// # Panics
    /// If there are 2³² blocks or groups, or a block has that many rows.
    pub fn from_dataset(data: &Dataset) -> (Self, Vec<String>) {
        let (rows, labels) = GroupedRows::from_labels(data);
        (Self { rows, channels: data.channels(), judged_by: BTreeMap::new() }, labels)
    }

    pub fn row_count(&self) -> usize {
        self.rows.row_count()
    }

    pub fn group_count(&self) -> usize {
        self.rows.groups().count()
    }

    /// Numbers of rows, in ascending order of groups.
    pub fn group_sizes(&self) -> Vec<u64> {
        self.rows.groups().map(|runs| count(runs) as u64).collect()
    }

    /// Converts every n-th row of some groups, from the first of each, in parts of at most [`ROWS_AT_ONCE`] rows;
    /// `every` returns n for a number of rows. `take` receives the group of each row, the predicted wrench minus the
    /// reference, and the model's standard errors, N and N·m.
    pub(super) fn convert(
        &self,
        groups: &BTreeSet<u64>,
        every: impl Fn(usize) -> usize,
        estimates: impl Fn(&[Vec<f64>]) -> Estimates,
        mut take: impl FnMut(u64, PerAxis<f64>, PerAxis<f64>),
    ) {
        for runs in self.rows.groups().filter(|runs| groups.contains(&runs[0].group())) {
            let (group, some) = (runs[0].group(), every_nth(runs, every(count(runs))));
            let stated = self.judged_by.get(&group);
            for block in self.rows.copied(&some, ROWS_AT_ONCE) {
                let estimates = estimates(&block.readings);
                for row in 0..block.rows {
                    let estimate = estimates.row(row);
                    let errors = std::array::from_fn(|axis| {
                        let judge = stated.map_or(block.wrench[axis][row], |wrench| wrench[axis]);
                        estimate.wrench[axis] - judge
                    });
                    take(group, errors, estimate.standard_errors);
                }
            }
        }
    }
}

/// Edge of a cell, in root mean squares of an axis: a response hardly bends over such a length.
const CELL_WIDTH: f64 = 0.25;

impl TrainingRows {
    /// Observations in ascending order of groups.
    ///
    /// # Errors
    /// [`PhysicsError::NotFinite`], [`PhysicsError::Channels`].
    pub fn observations(&self) -> Result<Vec<Observation>, PhysicsError> {
        Ok(Cells::new(self)?.observations(usize::MAX))
    }
}

/// Cells of the wrench that contain rows, in ascending order of groups and of their indices. Only their number is
/// stored: there may be as many cells as rows, and a fit uses few.
pub(super) struct Cells<'a> {
    rows: &'a GroupedRows,
    grids: Vec<RoundingGrid>,
    width: PerAxis<f64>,
    pub(super) count: usize,
}

/// Index of a row's cell along each axis, and the row: its run and its position there.
type RowInCell = ([i16; 6], u32, u32);

impl<'a> Cells<'a> {
    /// # Errors
    /// [`PhysicsError::NotFinite`], [`PhysicsError::Channels`].
    pub(super) fn new(rows: &'a TrainingRows) -> Result<Self, PhysicsError> {
        let TrainingRows { rows, channels, .. } = rows;
        if *channels == 0 || *channels > MOST_CHANNELS {
            return Err(PhysicsError::Channels(*channels));
        }
        let grid = |position: usize| RoundingGrid::new(rows.column(&rows.runs, position));
        let grids = (0..6 + channels).map(grid).collect::<Result<_, _>>()?;
        let mut cells = Self { rows, grids, width: cell_width(rows)?, count: 0 };
        let mut of_group = Vec::new();
        for runs in rows.groups() {
            cells.sort(runs, &mut of_group);
            cells.count += of_group.chunk_by(are_in_one_cell).count();
        }
        Ok(cells)
    }

    /// Means of at most `most` cells, at equal strides because neighbours resemble each other.
    pub(super) fn observations(&self, most: usize) -> Vec<Observation> {
        let step = step(self.count, most);
        let (mut observations, mut of_group, mut at) = (Vec::new(), Vec::new(), 0_usize);
        for runs in self.rows.groups() {
            self.sort(runs, &mut of_group);
            for cell in of_group.chunk_by(are_in_one_cell) {
                if at.is_multiple_of(step) {
                    observations.push(self.mean(runs, cell));
                }
                at += 1;
            }
        }
        observations
    }

    fn sort(&self, runs: &[Run], cells: &mut Vec<RowInCell>) {
        cells.clear();
        for (position, run) in (0..).zip(runs) {
            cells.extend((0..run.rows).map(|row| ([0; 6], position, row)));
        }
        for (axis, width) in self.width.iter().enumerate() {
            let grid = &self.grids[axis];
            let sum = self.rows.column(runs, axis).map(|x| grid.position(x)).sum();
            let middle = grid.mean(sum, cells.len());
            for ((cell, ..), x) in cells.iter_mut().zip(self.rows.column(runs, axis)) {
                cell[axis] = index((x - middle) / width);
            }
        }
        cells.sort_unstable();
    }

    fn mean(&self, runs: &[Run], cell: &[RowInCell]) -> Observation {
        let mean = |position: usize| {
            let grid = &self.grids[position];
            let value = |&(_, run, row): &RowInCell| {
                self.rows.of_run(&runs[run as usize], position)[row as usize]
            };
            grid.mean(cell.iter().map(|row| grid.position(value(row))).sum(), cell.len())
        };
        Observation {
            group: runs[0].group(),
            wrench: std::array::from_fn(mean),
            readings: (6..self.grids.len()).map(mean).collect(),
        }
    }
}

/// Stride that takes at most `most` of `count`.
pub(super) fn step(count: usize, most: usize) -> usize {
    count.div_ceil(most).max(1)
}

fn are_in_one_cell(a: &RowInCell, b: &RowInCell) -> bool {
    a.0 == b.0
}

/// Index of the cell along one axis. With N rows no value exceeds √N root mean squares, so indices fit into 16 bits
/// up to 67 million rows; the last cell takes larger values.
fn index(x: f64) -> i16 {
    x.round_ties_even() as i16
}

fn cell_width(rows: &GroupedRows) -> Result<PerAxis<f64>, PhysicsError> {
    // Squares are rounded to a grid, too, so that the width does not depend on the order of the rows either.
    let mut width = [1.0; 6];
    for (axis, width) in width.iter_mut().enumerate() {
        let squares = || rows.column(&rows.runs, axis).map(|x| x * x);
        let grid = RoundingGrid::new(squares())?;
        let sum: i128 = squares().map(|square| grid.position(square)).sum();
        let rms = grid.mean(sum, rows.row_count().max(1)).sqrt();
        *width = if rms > 0.0 { CELL_WIDTH * rms } else { 1.0 };
    }
    Ok(width)
}

struct RoundingGrid {
    steps: f64,
}

impl RoundingGrid {
    /// Sets the step to 2⁻⁶⁰ of the least power of two above every value: an i128 holds the sum of 2⁶⁶ values.
    fn new(mut column: impl Iterator<Item = f64>) -> Result<Self, PhysicsError> {
        let larger = |most: f64, x: f64| x.is_finite().then(|| most.max(x.abs()));
        let largest = column.try_fold(0.0, larger).ok_or(PhysicsError::NotFinite)?;
        let exponent = if largest > 0.0 { libm::ilogb(largest) + 1 } else { 0 };
        Ok(Self { steps: libm::ldexp(1.0, (60 - exponent).clamp(-1000, 1000)) })
    }

    fn position(&self, x: f64) -> i128 {
        (x * self.steps).round_ties_even() as i128
    }

    fn mean(&self, sum: i128, count: usize) -> f64 {
        sum as f64 / count as f64 / self.steps
    }
}

const MOST_TRIED: usize = 600;

/// Most observations in a fit. Ten uncertain parameters per sensor then add a two-hundredth to the squared error.
const MOST_FITTED: usize = 2_000;

#[derive(Clone, Debug, PartialEq)]
pub struct ObservationSample {
    /// Number of observations before sampling.
    pub count: usize,
    pub(super) tried: Vec<Observation>,
    pub(super) fitted: Vec<Observation>,
}

impl ObservationSample {
    pub(super) fn new(observations: &[Observation]) -> Self {
        let count = observations.len();
        let few = |most| observations.iter().step_by(step(count, most)).cloned().collect();
        Self { count, tried: few(MOST_TRIED), fitted: few(MOST_FITTED) }
    }

    /// # Errors
    /// [`PhysicsError::NotFinite`], [`PhysicsError::Channels`].
    pub fn from_rows(rows: &TrainingRows) -> Result<Self, PhysicsError> {
        let cells = Cells::new(rows)?;
        let [tried, fitted] = [MOST_TRIED, MOST_FITTED].map(|most| cells.observations(most));
        Ok(Self { count: cells.count, tried, fitted })
    }
}

#[cfg(test)]
mod tests {
    use shell_data::block::Block;
    use shell_data::wrench::Axes;

    use super::*;
    use crate::Flags;

    #[test]
    fn every_third_row_of_a_group_is_converted_and_compared_with_its_wrench() {
        // Three groups of 6000 rows alternate every 1500; a reading is the row's number, each load twice that.
        let number: Vec<f64> = (0..18_000).map(f64::from).collect();
        let groups = (0..12).map(|run| ((run % 3).to_string(), 1500)).collect();
        let wrench = vec![number.iter().map(|n| 2.0 * n).collect(); 6];
        let rows = number.len();
        let block = Block { rows, readings: vec![number], wrench, groups, ..Block::default() };
        let data = Dataset::from_blocks("rows", Axes::ALL, vec![block]);
        let (rows, labels) = TrainingRows::from_dataset(&data);
        assert_eq!((rows.row_count(), labels.len()), (18_000, 3));
        let as_read = |readings: &[Vec<f64>]| Estimates {
            wrench: std::array::from_fn(|_| readings[0].clone()),
            standard_errors: std::array::from_fn(|_| readings[0].clone()),
            flags: vec![Flags::default(); readings[0].len()],
        };
        let held_out = BTreeSet::from([0, 2]);
        let (mut groups, mut errors) = (Vec::new(), Vec::new());
        rows.convert(
            &held_out,
            |_| 3,
            as_read,
            |group, of_row, _| {
                groups.push(group);
                errors.push(of_row[4]);
            },
        );
        assert_eq!(groups, [vec![0; 2000], vec![2; 2000]].concat());
        let expected = |group: u32| {
            let rows = (0..18_000).filter(move |row| row / 1500 % 3 == group);
            rows.step_by(3).map(|row| -f64::from(row))
        };
        assert_eq!(errors, expected(0).chain(expected(2)).collect::<Vec<_>>());
    }

    /// Rows in blocks of `size`: a label, six columns of wrench, and readings.
    fn training_rows(rows: &[(u64, Vec<f64>)], size: usize) -> TrainingRows {
        let block = |rows: &[(u64, Vec<f64>)]| {
            let column = |at: usize| rows.iter().map(|row| row.1[at]).collect::<Vec<f64>>();
            Block {
                rows: rows.len(),
                wrench: (0..6).map(column).collect(),
                readings: (6..rows[0].1.len()).map(column).collect(),
                groups: rows.iter().map(|row| (row.0.to_string(), 1)).collect(),
                ..Block::default()
            }
        };
        let blocks = rows.chunks(size).map(block).collect();
        TrainingRows::from_dataset(&Dataset::from_blocks("rows", Axes::ALL, blocks)).0
    }

    fn varied_rows() -> Vec<(u64, Vec<f64>)> {
        let value = |row: u64| f64::from((row * 2_654_435_761 % 1009) as u32) / 7.0;
        (0..200).map(|row| (row % 5, (0..9).map(|k| value(row + 13 * k)).collect())).collect()
    }

    #[test]
    fn means_do_not_depend_on_the_order_of_the_rows_or_on_blocks() {
        let mut rows = varied_rows();
        let found = training_rows(&rows, 200).observations().unwrap();
        assert!(found.len() > 5 && found.iter().all(|o| o.group < 5));
        assert_eq!(training_rows(&rows, 7).observations().unwrap(), found);
        // Reorders rows only within the groups: the order of groups depends on their first rows.
        rows[5..].reverse();
        rows[5..].sort_by_key(|row| row.0);
        assert_eq!(training_rows(&rows, 64).observations().unwrap(), found);
    }

    #[test]
    fn a_subset_of_observations_equals_those_of_all_rows() {
        let rows = training_rows(&varied_rows(), 64);
        let cells = Cells::new(&rows).unwrap();
        let all = cells.observations(usize::MAX);
        assert_eq!(all.len(), cells.count);
        for most in [1, 3, 40, 150] {
            let expected: Vec<Observation> =
                all.iter().step_by(all.len().div_ceil(most)).cloned().collect();
            assert_eq!(cells.observations(most), expected);
        }
    }

    #[test]
    fn a_pose_of_constant_load_is_one_observation_at_any_position() {
        let load = |group: u64| 3.1 * group as f64;
        let rows: Vec<_> = (0..40).map(|row| (row / 10, vec![load(row / 10); 7])).collect();
        let found = training_rows(&rows, 16).observations().unwrap();
        assert_eq!(found.len(), 4);
        assert!(found.iter().all(|o| (o.wrench[0] - load(o.group)).abs() < 1e-12));
    }

    #[test]
    fn nan_values_and_too_many_channels_are_refused() {
        let observations = |row: Vec<f64>| training_rows(&[(0, row)], 1).observations();
        assert_eq!(observations(vec![f64::NAN; 7]), Err(PhysicsError::NotFinite));
        assert_eq!(observations(vec![1.0; 6 + 17]), Err(PhysicsError::Channels(17)));
        assert_eq!(observations(vec![1.0; 6]), Err(PhysicsError::Channels(0)));
    }
}
