//! How far readings and loads spread.

use crate::error::FitError;
use crate::passes::{Workers, each};
use shell_data::block::Block;
use shell_data::dataset::Dataset;
use shell_data::statistics::RunningVariance;
use shell_data::wrench::Axis;

/// The spread of readings and loads.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Spread {
    /// Means of the readings of each channel, then of the axes of the wrench.
    pub(super) means: Vec<f64>,
    /// Their standard deviations.
    pub(super) deviations: Vec<f64>,
    /// The standard deviations of the changes of each channel from row to row.
    pub(super) changes: Vec<f64>,
}

impl Spread {
    /// Of a data set, from rows all over it.
    pub fn new(data: &Dataset, workers: Workers<'_>) -> Result<Self, FitError> {
        /// So many rows determine a standard deviation to one percent.
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
        // Other passes count these rows for the progress bar.
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

    /// How many standard deviations a value of a column is from another.
    pub fn apart(&self, column: usize, value: f64, other: f64) -> f64 {
        let sd = self.deviations[column];
        if sd > 0.0 { (value - other).abs() / sd } else { 0.0 }
    }

    pub(super) fn distance_from_mean(&self, column: usize, value: f64) -> f64 {
        self.apart(column, value, self.means[column])
    }
}

/// Mean and variance of each column of a block: of readings and wrench, then of the changes of the readings from row to
/// row. Only every `step`-th run of rows is used.
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
        // Their squares add up to 182, their mean is 26/6. Rounding of a few operations.
        let sd = (182.0 / 6.0 - (26.0_f64 / 6.0).powi(2)).sqrt();
        assert!((spread.apart(0, 5.0, 3.0) - 2.0 / sd).abs() < 1e-12);
        // Changes of 2, 2, 6 and 0, whose mean is 2.5.
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
        // A twelfth of the rows.
        assert!((spread.deviations[0] / whole.rms_about_mean() - 1.0).abs() < 0.02);
        assert!((spread.means[0] - whole.mean).abs() < 0.02);
    }
}
