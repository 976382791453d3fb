//! Fingerprints that show whether two logs contain the same rows, in any file format. If a training log has a copy, its
//! rows count twice; if the copy is held out, errors look far too small.

use std::fmt;

use crate::{Block, vectorised};

/// A hash of the rows of a log: equal for equal rows in any order, almost never for different rows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Fingerprint {
    rows: u64,
    sum: u64,
    /// Sum of the squares of the terms of `sum`.
    squares: u64,
}

impl fmt::Display for Fingerprint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "rows:{}:{:016x}{:016x}", self.rows, self.sum, self.squares)
    }
}

impl Fingerprint {
    pub fn new(block: &Block) -> Self {
        fingerprint(block)
    }

    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// Adds rows; the order of rows and of parts has no effect.
    pub fn merge(&mut self, other: Self) {
        self.rows += other.rows;
        self.sum = self.sum.wrapping_add(other.sum);
        self.squares = self.squares.wrapping_add(other.squares);
    }

    /// Finds the first log with the same rows as an earlier one; returns the indices of the earlier log and the copy.
    pub fn first_copy(logs: &[Self]) -> Option<(usize, usize)> {
        let copy_of = |(later, fingerprint): (usize, &Self)| {
            let earlier = logs[..later].iter().position(|earlier| earlier == fingerprint);
            earlier.filter(|_| fingerprint.rows > 0).map(|earlier| (earlier, later))
        };
        logs.iter().enumerate().find_map(copy_of)
    }
}

/// Returns an unmixed hash for each of `rows` rows. Hashes of different rows may differ in only a few bits, so mix them
/// before use. `start` is the hash of a row without columns.
#[inline(always)]
pub fn row_hashes<'a>(
    start: u64,
    rows: usize,
    columns: impl Iterator<Item = &'a [f64]>,
) -> Vec<u64> {
    let mut hashes = vec![start; rows];
    // Every processor has vector instructions for the rotation and addition of 64-bit integers.
    for column in columns {
        for (hash, value) in hashes.iter_mut().zip(column) {
            *hash = hash.rotate_left(23).wrapping_add(value.to_bits());
        }
    }
    hashes
}

/// Mixes the bits like the final step of xxHash.
#[inline(always)]
fn mixed(hash: u64) -> u64 {
    let hash = (hash ^ (hash >> 29)).wrapping_mul(0x1656_67b1_9e37_79f9);
    hash ^ (hash >> 32)
}

/// Returns a hash of a sequence of values, which depends on their order.
pub fn hash(values: impl Iterator<Item = f64>) -> u64 {
    // The hash is mixed after each value, because there may be only a few similar values.
    values.fold(0, |hash: u64, value| mixed(hash.rotate_left(23) ^ value.to_bits()))
}

vectorised! {
    fn fingerprint(block: &Block) -> Fingerprint {
        let columns = block.readings.iter().chain(&block.wrench);
        let hashes = row_hashes(0, block.rows, columns.map(Vec::as_slice));
        let mut fingerprint = Fingerprint { rows: block.rows as u64, ..Fingerprint::default() };
        // Hashes are mixed, because sums of unmixed hashes are often equal for different rows.
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
