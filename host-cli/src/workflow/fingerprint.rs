//! Whether two logs hold the same rows, whatever their files look like.
//!
//! A copy of a log among the training logs counts its rows twice; held out against its original, or
//! tested on, it makes errors look far smaller than they are.

use shell_data::block::Block;

/// What is left of the rows of a log: equal for equal rows in any order, and for others hardly ever.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Fingerprint {
    rows: u64,
    sum: u64,
    /// Sum of the squares of what `sum` adds up.
    squares: u64,
}

impl Fingerprint {
    /// Of readings and wrench of the rows of a block.
    pub(super) fn of(block: &Block) -> Self {
        let mut hashes = vec![0_u64; block.rows];
        for column in block.readings.iter().chain(&block.wrench) {
            for (hash, value) in hashes.iter_mut().zip(column) {
                // One multiplication and shift of xxHash's finish for each number.
                let mixed = (*hash ^ value.to_bits()).wrapping_mul(0x9e37_79b1_85eb_ca87);
                *hash = mixed ^ (mixed >> 29);
            }
        }
        let squares = hashes.iter().map(|hash| hash.wrapping_mul(*hash | 1));
        Self {
            rows: block.rows as u64,
            squares: squares.fold(0, u64::wrapping_add),
            sum: hashes.iter().copied().fold(0, u64::wrapping_add),
        }
    }

    pub(super) fn merge(&mut self, other: Self) {
        self.rows += other.rows;
        self.sum = self.sum.wrapping_add(other.sum);
        self.squares = self.squares.wrapping_add(other.squares);
    }

    /// Which of some logs is the first with the rows of one before it, and which that is.
    pub(super) fn first_copy(logs: &[Self]) -> Option<(usize, usize)> {
        let copy_of = |(later, fingerprint): (usize, &Self)| {
            let earlier = logs[..later].iter().position(|earlier| earlier == fingerprint);
            earlier.filter(|_| fingerprint.rows > 0).map(|earlier| (earlier, later))
        };
        logs.iter().enumerate().find_map(copy_of)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(rows: &[[f64; 2]]) -> Fingerprint {
        let column = |i: usize| rows.iter().map(|row| row[i]).collect();
        Fingerprint::of(&Block {
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
