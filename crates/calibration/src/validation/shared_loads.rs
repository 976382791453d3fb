//! Whether test rows come from the plateaus of constant load that a model was trained on.
//!
//! A random split of the rows of one recording leaves rows of every plateau on both sides, and the error
//! on the test rows is then that of training. A test row counts as one of a training plateau if its
//! wrench is that of training rows to the last digit and every reading is about where theirs are: a
//! plateau that is set up again, with the same weights, has other readings. Rows may be in any order, as
//! programs leave them that split at random. Where the reference flickers this says nothing.

use std::collections::HashMap;

use shell_data::block::Block;
use shell_data::wrench::PerAxis;

/// Rows that are kept.
const KEPT: usize = 4096;

/// The fewest rows of a load that say where its readings are.
const FEWEST_ROWS: usize = 4;

/// The fewest loads that are plateaus rather than rest.
const FEWEST_LOADS: usize = 3;

/// Rows spread over some logs.
#[derive(Clone, Debug, Default)]
pub struct RowSample {
    rows: Vec<SampledRow>,
}

#[derive(Clone, Debug)]
struct SampledRow {
    load: PerAxis<u64>,
    readings: Vec<f64>,
}

/// The readings at one load.
struct AtLoad {
    rows: usize,
    ranges: Vec<[f64; 2]>,
}

impl RowSample {
    /// Every so-manieth row of a block; see [`stride`](Self::stride).
    pub fn of(block: &Block, stride: usize) -> Self {
        let row = |row: usize| SampledRow {
            // Zeros of either sign are one load.
            load: std::array::from_fn(|axis| (block.wrench[axis][row] + 0.0).to_bits()),
            readings: block.readings.iter().map(|column| column[row]).collect(),
        };
        Self { rows: (0..block.rows).step_by(stride).map(row).collect() }
    }

    /// Which rows of logs to take, of some `rows` that they have: about as many as are kept.
    pub fn stride(rows: u64) -> usize {
        // Odd: rows often alternate in twos.
        usize::try_from(rows / KEPT as u64).unwrap_or(usize::MAX) | 1
    }

    /// Adds the rows of a block after those before; every second is let go where they are too many.
    pub fn add(&mut self, block: Self) {
        self.rows.extend(block.rows);
        while self.rows.len() > KEPT {
            let mut row = 0_usize;
            self.rows.retain(|_| {
                row += 1;
                row % 2 == 1
            });
        }
    }

    /// The share of these rows that lie on plateaus of `train`; `None` where those are not made of
    /// plateaus.
    pub fn share_on_plateaus_of(&self, train: &Self) -> Option<f64> {
        let mut loads: HashMap<PerAxis<u64>, AtLoad> = HashMap::new();
        for row in &train.rows {
            let at = loads.entry(row.load).or_insert_with(|| AtLoad {
                rows: 0,
                ranges: row.readings.iter().map(|&reading| [reading; 2]).collect(),
            });
            at.rows += 1;
            for (range, &reading) in at.ranges.iter_mut().zip(&row.readings) {
                *range = [range[0].min(reading), range[1].max(reading)];
            }
        }
        loads.retain(|_, at| at.rows >= FEWEST_ROWS);
        let held: usize = loads.values().map(|at| at.rows).sum();
        if loads.len() < FEWEST_LOADS || 2 * held < train.rows.len() || self.rows.is_empty() {
            return None;
        }
        let is_shared = |row: &&SampledRow| {
            loads.get(&row.load).is_some_and(|at| {
                at.ranges.iter().zip(&row.readings).all(|([least, most], reading)| {
                    let width = most - least;
                    (least - width..=most + width).contains(reading)
                })
            })
        };
        Some(self.rows.iter().filter(is_shared).count() as f64 / self.rows.len() as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// So many rows of each of ten loads, the readings about `at` of the load.
    fn held(rows: usize, at: impl Fn(f64) -> f64) -> Block {
        let row = |row: usize| ((row * 7 + 3) % 10, row as f64);
        let column = |of: &dyn Fn((usize, f64)) -> f64| (0..10 * rows).map(row).map(of).collect();
        Block {
            rows: 10 * rows,
            readings: vec![column(&|(load, row)| at(load as f64) + (row * 0.7).sin()); 3],
            wrench: vec![column(&|(load, _)| load as f64 * 0.3); 6],
            ..Block::default()
        }
    }

    fn sample(blocks: &[Block]) -> RowSample {
        let mut all = RowSample::default();
        blocks.iter().for_each(|block| all.add(RowSample::of(block, 7)));
        all
    }

    #[test]
    fn rows_of_the_same_plateaus_are_found_in_any_order_and_those_of_others_are_not() {
        let train = sample(&vec![held(300, |load| 100.0 * load); 20]);
        assert!(train.rows.len() <= KEPT);
        let same = sample(&[held(40, |load| 100.0 * load)]);
        assert!(same.share_on_plateaus_of(&train).unwrap() > 0.99);
        // The same weights, in another session.
        let again = sample(&[held(40, |load| 100.0 * load + 30.0)]);
        assert_eq!(again.share_on_plateaus_of(&train), Some(0.0));
    }

    #[test]
    fn loads_that_hardly_repeat_and_rest_are_no_plateaus() {
        let mut moving = held(300, |load| load);
        for column in &mut moving.wrench {
            column.iter_mut().enumerate().for_each(|(row, load)| *load = row as f64);
        }
        assert_eq!(
            sample(&[moving.clone()]).share_on_plateaus_of(&sample(&[moving.clone()])),
            None
        );
        moving.wrench.iter_mut().for_each(|column| column[..2000].fill(0.0));
        assert_eq!(sample(&[moving.clone()]).share_on_plateaus_of(&sample(&[moving])), None);
        assert_eq!(RowSample::default().share_on_plateaus_of(&RowSample::default()), None);
    }
}
