//! Whether test rows come from the plateaus of constant load that a model was trained on.
//!
//! A random split of the rows of one recording leaves rows of every plateau on both sides, and the error
//! on the test rows is then that of training. A test row counts as one of a training plateau if its
//! wrench is that of training rows to the last digit and every reading is about where theirs are: a
//! plateau that is set up again, with the same weights, has other readings. Rows may be in any order, as
//! programs leave them that split at random. Where the reference flickers this says nothing.

use shell_data::block::Block;
use shell_data::fingerprint;

/// Rows that are kept.
const KEPT: usize = 4096;

/// The fewest rows of a load that say where its readings are.
const FEWEST_ROWS: usize = 4;

/// The fewest loads that are plateaus rather than rest.
const FEWEST_LOADS: usize = 3;

/// Rows spread over some logs.
#[derive(Clone, Debug, Default)]
pub struct RowSample {
    channels: usize,
    /// A number for each row that is the same for the same wrench, and hardly ever for another.
    loads: Vec<u64>,
    /// Row by row.
    readings: Vec<f64>,
}

/// The loads that the rows of a sample were held at, in the order of their numbers.
#[derive(Clone, Debug)]
pub struct Plateaus(Vec<Plateau>);

#[derive(Clone, Debug)]
struct Plateau {
    load: u64,
    /// The readings at it.
    ranges: Vec<[f64; 2]>,
}

/// Which of some rows lie on plateaus.
#[derive(Clone, Debug)]
pub struct SharedRows {
    plateaus: Plateaus,
    are_shared: Vec<bool>,
}

impl RowSample {
    /// Every so-manieth row of a block; see [`stride`](Self::stride).
    pub fn of(block: &Block, stride: usize) -> Self {
        let channels = block.readings.len();
        let mut sample = Self { channels, ..Self::default() };
        for row in (0..block.rows).step_by(stride) {
            // Zeros of either sign are one load.
            let load = block.wrench.iter().map(|axis| axis[row] + 0.0);
            sample.loads.push(fingerprint::hash(load));
            sample.readings.extend(block.readings.iter().map(|column| column[row]));
        }
        sample
    }

    /// Which rows of logs to take, of some `rows` that they have: about as many as are kept.
    pub fn stride(rows: u64) -> usize {
        // Odd: rows often alternate in twos.
        usize::try_from(rows / KEPT as u64).unwrap_or(usize::MAX) | 1
    }

    /// Adds the rows of a block after those before; every second is let go where they are too many.
    pub fn add(&mut self, block: &Self) {
        self.channels = block.channels;
        self.loads.extend_from_slice(&block.loads);
        self.readings.extend_from_slice(&block.readings);
        while self.loads.len() > KEPT {
            let left = self.loads.len().div_ceil(2);
            for row in 1..left {
                self.loads[row] = self.loads[2 * row];
                let from = 2 * row * self.channels;
                self.readings.copy_within(from..from + self.channels, row * self.channels);
            }
            self.loads.truncate(left);
            self.readings.truncate(left * self.channels);
        }
    }

    fn readings(&self, row: usize) -> &[f64] {
        &self.readings[row * self.channels..][..self.channels]
    }

    /// The plateaus that the rows are made of; `None` if they are not.
    pub fn plateaus(&self) -> Option<Plateaus> {
        let mut rows: Vec<usize> = (0..self.loads.len()).collect();
        rows.sort_unstable_by_key(|&row| self.loads[row]);
        let (mut plateaus, mut held) = (Vec::new(), 0);
        for rows in rows.chunk_by(|&a, &b| self.loads[a] == self.loads[b]) {
            if rows.len() < FEWEST_ROWS {
                continue;
            }
            held += rows.len();
            let mut ranges = vec![[f64::INFINITY, f64::NEG_INFINITY]; self.channels];
            for &row in rows {
                for (range, &reading) in ranges.iter_mut().zip(self.readings(row)) {
                    *range = [range[0].min(reading), range[1].max(reading)];
                }
            }
            plateaus.push(Plateau { load: self.loads[rows[0]], ranges });
        }
        let is_made_of = plateaus.len() >= FEWEST_LOADS && 2 * held >= self.loads.len();
        is_made_of.then_some(Plateaus(plateaus))
    }
}

impl Plateaus {
    fn have(&self, load: u64, readings: &[f64]) -> bool {
        self.0.binary_search_by_key(&load, |at| at.load).is_ok_and(|at| {
            self.0[at].ranges.iter().zip(readings).all(|([least, most], reading)| {
                let width = most - least;
                (least - width..=most + width).contains(reading)
            })
        })
    }
}

impl SharedRows {
    /// No rows yet.
    pub fn new(plateaus: Plateaus) -> Self {
        Self { plateaus, are_shared: Vec::new() }
    }

    /// Adds the rows of a block; of too many, every second is let go, as in [`RowSample::add`].
    pub fn add(&mut self, block: &RowSample) {
        let is_shared = |row: usize| self.plateaus.have(block.loads[row], block.readings(row));
        let are_shared: Vec<bool> = (0..block.loads.len()).map(is_shared).collect();
        self.are_shared.extend(are_shared);
        while self.are_shared.len() > KEPT {
            let mut row = 0_usize;
            self.are_shared.retain(|_| {
                row += 1;
                row % 2 == 1
            });
        }
    }

    /// The share of the rows that lie on plateaus; `None` for zero rows.
    pub fn share(&self) -> Option<f64> {
        let shared = self.are_shared.iter().filter(|is_shared| **is_shared).count();
        let rows = self.are_shared.len();
        (rows > 0).then(|| shared as f64 / rows as f64)
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
        blocks.iter().for_each(|block| all.add(&RowSample::of(block, 7)));
        all
    }

    fn share(test: &[Block], train: &[Block]) -> Option<f64> {
        let mut shared = SharedRows::new(sample(train).plateaus()?);
        test.iter().for_each(|block| shared.add(&RowSample::of(block, 7)));
        shared.share()
    }

    #[test]
    fn rows_of_the_same_plateaus_are_found_in_any_order_and_those_of_others_are_not() {
        let train = vec![held(300, |load| 100.0 * load); 20];
        assert!(sample(&train).loads.len() <= KEPT);
        assert!(share(&[held(40, |load| 100.0 * load)], &train).unwrap() > 0.99);
        // As many as have to be thinned out.
        assert!(share(&train, &train).unwrap() > 0.99);
        // The same weights, in another session.
        assert_eq!(share(&[held(40, |load| 100.0 * load + 30.0)], &train), Some(0.0));
    }

    #[test]
    fn loads_that_hardly_repeat_and_rest_are_no_plateaus() {
        let mut moving = held(300, |load| load);
        for column in &mut moving.wrench {
            column.iter_mut().enumerate().for_each(|(row, load)| *load = row as f64);
        }
        assert_eq!(share(&[moving.clone()], &[moving.clone()]), None);
        moving.wrench.iter_mut().for_each(|column| column[..2000].fill(0.0));
        assert_eq!(share(&[moving.clone()], &[moving]), None);
        assert_eq!(share(&[], &[]), None);
        assert_eq!(share(&[], &[held(300, |load| load)]), None);
    }
}
