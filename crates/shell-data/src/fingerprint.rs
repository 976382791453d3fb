//! Whether two logs hold the same rows, whatever their files look like.
//!
//! A copy of a log among the training logs counts its rows twice; held out against its original, or
//! tested on, it makes errors look far smaller than they are.

use std::fmt;

use crate::{Block, vectorised};

/// What is left of the rows of a log: equal for equal rows in any order, and for others hardly ever.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Fingerprint {
    rows: u64,
    sum: u64,
    /// Sum of the squares of what `sum` adds up.
    squares: u64,
}

/// As documents hold it.
impl fmt::Display for Fingerprint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "rows:{}:{:016x}{:016x}", self.rows, self.sum, self.squares)
    }
}

impl Fingerprint {
    /// Of readings and wrench of the rows of a block.
    pub fn new(block: &Block) -> Self {
        fingerprint(block)
    }

    /// How many rows it is of.
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// Counts the rows of `other` in: of the same log, in any order.
    pub fn merge(&mut self, other: Self) {
        self.rows += other.rows;
        self.sum = self.sum.wrapping_add(other.sum);
        self.squares = self.squares.wrapping_add(other.squares);
    }

    /// Which of some logs is the first with the rows of one before it, and which that is.
    pub fn first_copy(logs: &[Self]) -> Option<(usize, usize)> {
        let copy_of = |(later, fingerprint): (usize, &Self)| {
            let earlier = logs[..later].iter().position(|earlier| earlier == fingerprint);
            earlier.filter(|_| fingerprint.rows > 0).map(|earlier| (earlier, later))
        };
        logs.iter().enumerate().find_map(copy_of)
    }
}

/// A number for each of `rows` rows, the same for equal rows, and to be mixed: what differs in two rows may
/// differ in a few of its bits. `start` is what a row without columns has.
#[inline(always)]
pub fn row_hashes<'a>(
    start: u64,
    rows: usize,
    columns: impl Iterator<Item = &'a [f64]>,
) -> Vec<u64> {
    let mut hashes = vec![start; rows];
    // Rotated and added: every processor has both for vectors of 64 bits, few have the product.
    for column in columns {
        for (hash, value) in hashes.iter_mut().zip(column) {
            *hash = hash.rotate_left(23).wrapping_add(value.to_bits());
        }
    }
    hashes
}

/// As xxHash finishes.
#[inline(always)]
fn mixed(hash: u64) -> u64 {
    let hash = (hash ^ (hash >> 29)).wrapping_mul(0x1656_67b1_9e37_79f9);
    hash ^ (hash >> 32)
}

/// A number for some values, which is the same for the same ones in the same order, and for others hardly
/// ever.
pub fn hash(values: impl Iterator<Item = f64>) -> u64 {
    // Mixed after each: they may be few and much alike.
    values.fold(0, |hash: u64, value| mixed(hash.rotate_left(23) ^ value.to_bits()))
}

vectorised! {
    fn fingerprint(block: &Block) -> Fingerprint {
        let columns = block.readings.iter().chain(&block.wrench);
        let hashes = row_hashes(0, block.rows, columns.map(Vec::as_slice));
        let mut fingerprint = Fingerprint { rows: block.rows as u64, ..Fingerprint::default() };
        // Mixed, so that sums of rows say which rows they are.
        for hash in hashes {
            let hash = mixed(hash);
            fingerprint.sum = fingerprint.sum.wrapping_add(hash);
            fingerprint.squares = fingerprint.squares.wrapping_add(hash.wrapping_mul(hash | 1));
        }
        fingerprint
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(rows: &[[f64; 2]]) -> Fingerprint {
        let column = |i: usize| rows.iter().map(|row| row[i]).collect();
        Fingerprint::new(&Block {
            rows: rows.len(),
            readings: vec![column(0), column(1)],
            ..Block::default()
        })
    }

    #[test]
    fn the_same_rows_are_found_in_any_order_and_in_pieces() {
        let whole = of(&[[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]);
        let mut pieces = of(&[[5.0, 6.0]]);
        pieces.merge(of(&[[3.0, 4.0], [1.0, 2.0]]));
        assert_eq!(pieces, whole);
        let others = [
            of(&[[1.0, 2.0], [3.0, 4.0]]),
            of(&[[2.0, 1.0], [3.0, 4.0], [5.0, 6.0]]),
            of(&[[1.0, 2.0], [1.0, 2.0], [5.0, 6.0]]),
        ];
        assert!(!others.contains(&whole));
        assert_eq!(Fingerprint::first_copy(&[whole, others[0], pieces]), Some((0, 2)));
        assert_eq!(Fingerprint::first_copy(&[of(&[]), of(&[])]), None);
    }
}
