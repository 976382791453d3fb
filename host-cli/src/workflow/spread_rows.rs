//! Rows spread evenly over logs: enough to tell how errors are distributed, where the logs are read once.

use shell_data::block::Block;

/// Rows that are kept, at most. Of half as many, 33 errors are above the highest level of an interval, and
/// the quantile of 95 % is that of all rows to a hundredth.
const KEPT: usize = 1 << 16;

/// Rows of logs, one of every so many.
#[derive(Clone, Debug, Default)]
pub(super) struct SpreadRows(Block);

impl SpreadRows {
    /// One of so many rows is taken of logs that have about `rows`.
    pub(super) fn stride(rows: u64) -> usize {
        // Odd: rows often alternate in twos.
        usize::try_from(rows / KEPT as u64).unwrap_or(usize::MAX) | 1
    }

    /// Of the rows of a block.
    pub(super) fn of(block: &Block, stride: usize) -> Self {
        let taken = |columns: &[Vec<f64>]| -> Vec<Vec<f64>> {
            columns.iter().map(|column| column.iter().copied().step_by(stride).collect()).collect()
        };
        Self(Block {
            rows: block.rows.div_ceil(stride),
            readings: taken(&block.readings),
            wrench: taken(&block.wrench),
            ..Block::default()
        })
    }

    /// Adds those of a block after those before; every second is let go where they are too many.
    pub(super) fn add(&mut self, block: &Self) {
        let Self(all) = self;
        all.readings.resize(block.0.readings.len(), Vec::new());
        all.wrench.resize(block.0.wrench.len(), Vec::new());
        all.rows += block.0.rows;
        let mut columns: Vec<&mut Vec<f64>> =
            all.readings.iter_mut().chain(&mut all.wrench).collect();
        for (column, more) in columns.iter_mut().zip(block.0.readings.iter().chain(&block.0.wrench))
        {
            column.extend_from_slice(more);
        }
        while all.rows > KEPT {
            all.rows = all.rows.div_ceil(2);
            for column in &mut columns {
                for row in 1..all.rows {
                    column[row] = column[2 * row];
                }
                column.truncate(all.rows);
            }
        }
    }

    /// The rows.
    pub(super) fn block(&self) -> &Block {
        &self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_spread_evenly_whatever_their_number() {
        for (blocks, stride) in [(3, 1), (700, 1), (700, 5)] {
            let mut all = SpreadRows::default();
            let rows = 500;
            for block in 0..blocks {
                let place = |row: usize| (block * rows + row) as f64;
                let column: Vec<f64> = (0..rows).map(place).collect();
                let block = Block {
                    rows,
                    readings: vec![column.clone()],
                    wrench: vec![column; 6],
                    ..Block::default()
                };
                all.add(&SpreadRows::of(&block, stride));
            }
            let block = all.block();
            let column = &block.readings[0];
            assert_eq!(column.len(), block.rows);
            assert!(block.wrench.iter().all(|axis| axis == column));
            // All that there are, or more than half of what there is room for.
            let taken = blocks * rows.div_ceil(stride);
            assert!(block.rows == taken.min(block.rows) && block.rows <= KEPT);
            assert!(block.rows == taken || 2 * block.rows > KEPT);
            let steps: Vec<f64> = column.windows(2).map(|two| two[1] - two[0]).collect();
            assert!(steps.iter().all(|&step| step == steps[0]), "{blocks} {stride}");
        }
    }
}
