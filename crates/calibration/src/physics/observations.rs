//! What the sensors are fitted to: means of wrench and readings over rows of like wrench.
//!
//! Rows of a pose are one observation many times over, so their means are what the fit sees, each
//! with the same weight. Where the wrench changes within a group of rows, as in a push by hand, there
//! is a mean for each cell of the wrench, [`CELL_WIDTH`] wide, with the group's mean in the middle of
//! one: a pose of constant load is then a single cell.
//!
//! Sums are integers: every value is rounded once, to 2⁻⁶⁰ of the largest size of its column, and
//! then added without error. So means do not depend on the order of the rows.

use std::collections::BTreeMap;

use super::PhysicsError;
use shell_data::wrench::PerAxis;

/// Most channels of a model: a frame's flags are bits, its values are on the stack.
pub const MOST_CHANNELS: usize = 16;

/// Edge of a cell, in root mean squares of an axis: far below what bends a response.
pub const CELL_WIDTH: f64 = 0.25;

/// The mean of some rows.
#[derive(Clone, Debug, PartialEq)]
pub struct Observation {
    /// Which rows are one observation or hang together: validation holds out whole groups.
    pub group: u64,
    /// Mean wrench, N and N·m.
    pub wrench: PerAxis<f64>,
    /// Mean reading of each channel, counts.
    pub readings: Vec<f64>,
}

/// The means of the cells of each group of rows, in ascending order of the groups' labels.
///
/// `wrench` has six columns (N and N·m), `readings` one for each channel (counts), `groups` one label
/// for each row.
///
/// # Errors
/// [`PhysicsError::NotFinite`], [`PhysicsError::Channels`].
///
/// # Panics
/// If the columns are of different lengths.
pub fn group_means(
    groups: &[u64],
    wrench: &PerAxis<&[f64]>,
    readings: &[&[f64]],
) -> Result<Vec<Observation>, PhysicsError> {
    let labels = || groups.iter().map(|&group| (group, [0; 6]));
    let means = means(labels(), groups.len(), wrench, readings)?;
    let middles: BTreeMap<u64, PerAxis<f64>> = means.iter().map(|o| (o.group, o.wrench)).collect();
    let width = cell_width(wrench)?;
    // Rows of a group are mostly neighbours.
    let mut last = None;
    let mut middle = |group: u64| match last {
        Some((label, middle)) if label == group => middle,
        _ => last.insert((group, middles[&group])).1,
    };
    let cells = groups.iter().enumerate().map(|(row, &group)| {
        let middle = middle(group);
        let cell = |axis: usize| position((wrench[axis][row] - middle[axis]) / width[axis]);
        (group, std::array::from_fn(cell))
    });
    self::means(cells, groups.len(), wrench, readings)
}

/// Index of the cell along one axis. With N rows no value exceeds √N root mean squares, so indices fit into 16 bits
/// up to 67 million rows; values beyond the last cell would be counted in it.
fn position(x: f64) -> i16 {
    x.round_ties_even() as i16
}

/// N and N·m.
fn cell_width(wrench: &PerAxis<&[f64]>) -> Result<PerAxis<f64>, PhysicsError> {
    // Squares on the same grid, so that the width does not depend on the order of the rows either.
    let mut width = [1.0; 6];
    for (width, column) in width.iter_mut().zip(wrench) {
        let squares: Vec<f64> = column.iter().map(|x| x * x).collect();
        let grid = RoundingGrid::new(&squares)?;
        let sum: i128 = squares.iter().map(|&square| grid.position(square)).sum();
        let rms = grid.mean(sum, column.len().max(1)).sqrt();
        *width = if rms > 0.0 { CELL_WIDTH * rms } else { 1.0 };
    }
    Ok(width)
}

fn means(
    keys: impl Iterator<Item = (u64, [i16; 6])>,
    rows: usize,
    wrench: &PerAxis<&[f64]>,
    readings: &[&[f64]],
) -> Result<Vec<Observation>, PhysicsError> {
    if readings.is_empty() || readings.len() > MOST_CHANNELS {
        return Err(PhysicsError::Channels { found: readings.len() });
    }
    let columns: Vec<&[f64]> = wrench.iter().chain(readings).copied().collect();
    assert!(columns.iter().all(|column| column.len() == rows), "columns of one length");
    let grids =
        columns.iter().map(|column| RoundingGrid::new(column)).collect::<Result<Vec<_>, _>>()?;
    let indices = 0..u32::try_from(rows).expect("fewer than 2³² rows fit into memory");
    let mut cells: Vec<(u64, [i16; 6], u32)> =
        keys.zip(indices).map(|((group, cell), row)| (group, cell, row)).collect();
    cells.sort_unstable();
    let observation = |cell: &[(u64, [i16; 6], u32)]| {
        let mean = |position: usize| {
            let (column, grid) = (columns[position], &grids[position]);
            let sum = cell.iter().map(|&(.., row)| grid.position(column[row as usize])).sum();
            grid.mean(sum, cell.len())
        };
        Observation {
            group: cell[0].0,
            wrench: std::array::from_fn(mean),
            readings: (6..columns.len()).map(mean).collect(),
        }
    };
    Ok(cells.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)).map(observation).collect())
}

/// The grid that a column is rounded to.
struct RoundingGrid {
    /// Steps in one.
    steps: f64,
}

impl RoundingGrid {
    /// 2⁻⁶⁰ of the least power of two above every value: i128 then holds 2⁶⁶ of them.
    fn new(column: &[f64]) -> Result<Self, PhysicsError> {
        let largest = column
            .iter()
            .fold(0.0_f64, |most, x| if x.is_finite() { most.max(x.abs()) } else { f64::INFINITY });
        if !largest.is_finite() {
            return Err(PhysicsError::NotFinite);
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    type Reduce = fn(&[u64], &PerAxis<&[f64]>, &[&[f64]]) -> Result<Vec<Observation>, PhysicsError>;

    #[test]
    fn means_do_not_depend_on_the_order_of_the_rows() {
        let value = |row: u64| f64::from((row * 2_654_435_761 % 1009) as u32) / 7.0;
        let of = |rows: &[u64], reduce: Reduce| {
            let column = |k: u64| rows.iter().map(|&row| value(row + 13 * k)).collect::<Vec<_>>();
            let columns: Vec<Vec<f64>> = (0..9).map(column).collect();
            let groups: Vec<u64> = rows.iter().map(|row| row % 5).collect();
            let wrench = std::array::from_fn(|axis| columns[axis].as_slice());
            let readings: Vec<&[f64]> = columns[6..].iter().map(Vec::as_slice).collect();
            reduce(&groups, &wrench, &readings)
        };
        let forward: Vec<u64> = (0..200).collect();
        let backward: Vec<u64> = (0..200).rev().collect();
        let found = of(&forward, group_means).unwrap();
        assert!(found.len() > 5 && found.iter().all(|o| o.group < 5));
        assert_eq!(Ok(found), of(&backward, group_means));
    }

    #[test]
    fn a_pose_of_constant_load_is_one_observation_wherever_it_lies() {
        let groups: Vec<u64> = (0..40).map(|row| row / 10).collect();
        let load = |&group: &u64| 3.1 * group as f64;
        let column: Vec<f64> = groups.iter().map(load).collect();
        let wrench: PerAxis<&[f64]> = [&column; 6];
        let found = group_means(&groups, &wrench, &[&column]).unwrap();
        assert_eq!(found.len(), 4);
        assert!(found.iter().all(|o| (o.wrench[0] - load(&o.group)).abs() < 1e-12));
    }

    #[test]
    fn values_that_are_not_numbers_and_too_many_channels_are_told() {
        let wrench: PerAxis<&[f64]> = [&[1.0]; 6];
        assert_eq!(group_means(&[0], &wrench, &[&[f64::NAN]]), Err(PhysicsError::NotFinite));
        let found = group_means(&[0], &wrench, &[wrench[0]; 17]);
        assert_eq!(found, Err(PhysicsError::Channels { found: 17 }));
    }
}
