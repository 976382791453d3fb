//! A share of a manifest's rows, for one of several machines.

use std::ops::Range;

/// One of so many shares: rows that follow each other, so that the shares one after the other are the whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Which, from 1.
    number: usize,
    /// Of how many.
    of: usize,
}

impl Shard {
    /// The largest number of shares, so that their names sort as their numbers do.
    pub const MOST: usize = 99_999;

    /// The share `number`, from 1; `None` if there is no such one, or too many.
    pub fn new(number: usize, of: usize) -> Option<Self> {
        (1 <= number && number <= of && of <= Self::MOST).then_some(Self { number, of })
    }

    /// Its part of so many rows; no two shares differ by more than one row.
    pub fn rows(self, rows: usize) -> Range<usize> {
        let end = |number: usize| (rows as u128 * number as u128 / self.of as u128) as usize;
        end(self.number - 1)..end(self.number)
    }

    /// The name of what belongs to it, without an extension. Names sort in the order of the shares.
    pub fn stem(self) -> String {
        format!("part-{:05}-of-{:05}", self.number, self.of)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_even_and_make_the_whole_in_the_order_of_their_names() {
        for (rows, of) in [(0, 3), (2, 5), (25, 4), (1000, 7), (5, 5), (3, 1)] {
            let shards: Vec<Shard> = (1..=of).map(|k| Shard::new(k, of).unwrap()).collect();
            let parts = shards.iter().flat_map(|shard| shard.rows(rows));
            assert_eq!(parts.collect::<Vec<_>>(), (0..rows).collect::<Vec<_>>());
            let sizes = || shards.iter().map(|shard| shard.rows(rows).len());
            assert!(sizes().max().unwrap() - sizes().min().unwrap() <= 1);
            assert!(shards.iter().map(|shard| shard.stem()).is_sorted());
        }
        for (number, of) in [(0, 3), (4, 3), (0, 0), (1, 100_000)] {
            assert_eq!(Shard::new(number, of), None);
        }
    }
}
