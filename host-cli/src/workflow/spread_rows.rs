//! Rows spread evenly over logs: enough to tell how errors are distributed, where the logs are read once.

use shell_data::block::Block;

/// Rows that are kept, at most. Of half as many, 33 errors are above the highest level of an interval, and
/// the quantile of 95 % is that of all rows to a hundredth.
const KEPT: usize = 1 << 16;

/// Rows of logs, one of every so many.
#[derive(Clone, Debug, Default)]
pub(super) struct SpreadRows {
    rows: Block,
    /// How many rows there have been to take from.
    offered: usize,
    /// How often every second was let go: of the rows offered, one of two to this power is taken.
    halvings: u32,
}

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
        let rows = Block {
            rows: block.rows.div_ceil(stride),
            readings: taken(&block.readings),
            wrench: taken(&block.wrench),
            ..Block::default()
        };
        Self { offered: rows.rows, rows, halvings: 0 }
    }

    /// Adds those of a block after those before, as far apart; every second is let go where they are too
    /// many.
    pub(super) fn add(&mut self, block: &Self) {
        let all = &mut self.rows;
        all.readings.resize(block.rows.readings.len(), Vec::new());
        all.wrench.resize(block.rows.wrench.len(), Vec::new());
        let mut columns: Vec<&mut Vec<f64>> =
            all.readings.iter_mut().chain(&mut all.wrench).collect();
        let every = 1 << self.halvings;
        let first = self.offered.next_multiple_of(every) - self.offered;
        let new = block.rows.readings.iter().chain(&block.rows.wrench);
        for (column, new) in columns.iter_mut().zip(new) {
            column.extend(new.iter().skip(first).step_by(every));
        }
        all.rows += block.rows.rows.saturating_sub(first).div_ceil(every);
        self.offered += block.offered;
        while all.rows > KEPT {
            all.rows = all.rows.div_ceil(2);
            self.halvings += 1;
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
        &self.rows
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
