//! Rows in little memory: counts, and the wrench of a digital sensor, as what they are, integers of
//! 16 bits.

use std::sync::OnceLock;

use crate::block::Block;
use crate::step::{Step, Words};

/// The readings and the wrench of some rows, in little memory.
#[derive(Debug)]
pub(super) struct KeptBlock {
    rows: usize,
    /// The readings, then the wrench.
    columns: Vec<Column>,
    /// Those columns that are small integers, one after another.
    words: Vec<u16>,
    others: Vec<f64>,
}

/// How the numbers of one column are kept.
#[derive(Clone, Copy, Debug)]
enum Column {
    /// As multiples of a step.
    Words(Words),
    /// As they are.
    Other,
}

/// What the numbers of each column are multiples of: in the first block, and then mostly in all.
pub(super) type Steps = OnceLock<Vec<Option<Step>>>;

impl KeptBlock {
    /// Of the rows of `block`, all of whose readings and wrench there are.
    pub(super) fn new(block: &Block, steps: &Steps) -> Self {
        let columns = || block.readings.iter().chain(&block.wrench);
        let steps = steps.get_or_init(|| columns().map(|column| Step::of(column)).collect());
        let mut kept = Self {
            rows: block.rows,
            columns: Vec::with_capacity(steps.len()),
            words: Vec::with_capacity(steps.len() * block.rows),
            others: Vec::new(),
        };
        for (column, step) in columns().zip(steps) {
            let words = step.and_then(|step| step.count(column, &mut kept.words));
            if words.is_none() {
                kept.others.extend_from_slice(column);
            }
            kept.columns.push(words.map_or(Column::Other, Column::Words));
        }
        kept.words.shrink_to_fit();
        kept
    }

    /// What the rows take.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(&self.words[..]) + size_of_val(&self.others[..])
    }

    /// Writes the rows into `block` as they were read, of so many channels.
    pub(super) fn restore(&self, block: &mut Block, channels: usize) {
        block.rows = self.rows;
        block.readings.resize_with(channels, Vec::new);
        block.wrench.resize_with(self.columns.len() - channels, Vec::new);
        let (mut words, mut others) = (&self.words[..], &self.others[..]);
        let columns = block.readings.iter_mut().chain(&mut block.wrench);
        for (kept, column) in self.columns.iter().zip(columns) {
            column.clear();
            match kept {
                Column::Words(how) => {
                    let words = words.split_off(..self.rows).expect("as many as there are rows");
                    how.values(words, column);
                }
                Column::Other => {
                    let numbers = others.split_off(..self.rows).expect("likewise");
                    column.extend_from_slice(numbers);
                }
            }
        }
    }
}
