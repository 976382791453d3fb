//! Centre and scale from all rows, where the answer depends on them.
//!
//! A least-squares fit is the same about any centre. A penalty is not: it is on the coefficients of
//! the powers of readings about the centre. A sample of the rows would make the answer depend on their
//! order; the mean of all of them does not.

use crate::FitError;
use crate::double_double::DoubleDouble;
use crate::passes::Pass;
use crate::reading_ranges::ReadingRanges;
use crate::scaling::{ChannelSample, Scaling};
use shell_data::block::Block;

/// The pass that finds them.
#[derive(Clone, Copy, Debug)]
pub struct Centring {
    /// Number of channels.
    pub channels: usize,
    /// Whether readings are shifted at all.
    pub intercept: bool,
}

/// What is known of the readings of some rows.
#[derive(Clone, Debug)]
pub struct ReadingSums {
    ranges: ReadingRanges,
    /// Exact as long as readings span fewer than some fifty binary places.
    sums: Vec<DoubleDouble>,
    integers: Vec<bool>,
}

impl Centring {
    /// Centre and scale of the rows in the sums.
    pub fn scaling(&self, sums: &ReadingSums) -> Scaling {
        let ReadingSums { ranges, sums, integers } = sums;
        let channel = |i: usize| ChannelSample {
            min: ranges.channels[i].min,
            max: ranges.channels[i].max,
            mean: sums[i].to_f64() / ranges.rows as f64,
            integers: integers[i],
        };
        Scaling::from_channels((0..self.channels).map(channel), self.intercept)
    }
}

impl Pass for Centring {
    type Partial = ReadingSums;

    const ANY_ORDER: bool = true;

    fn empty(&self) -> ReadingSums {
        ReadingSums {
            ranges: ReadingRanges::new(self.channels),
            sums: vec![DoubleDouble::ZERO; self.channels],
            integers: vec![true; self.channels],
        }
    }

    fn absorb(&self, partial: &mut ReadingSums, block: &Block) -> Result<(), FitError> {
        partial.ranges.merge(&ReadingRanges::from_block(block, self.channels)?);
        for (channel, column) in block.readings.iter().enumerate() {
            let sum = &mut partial.sums[channel];
            *sum = column.iter().fold(*sum, |sum, &s| sum + DoubleDouble::from(s));
            partial.integers[channel] &= column.iter().all(|s| s.fract() == 0.0);
        }
        Ok(())
    }

    fn merge(&self, earlier: &mut ReadingSums, later: ReadingSums) -> Result<(), FitError> {
        earlier.ranges.merge(&later.ranges);
        earlier.sums.iter_mut().zip(later.sums).for_each(|(sum, more)| *sum += more);
        earlier.integers.iter_mut().zip(later.integers).for_each(|(all, more)| *all &= more);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::passes::Rows;

    #[test]
    fn the_centre_is_the_mean_of_all_rows_in_any_order() {
        let column: Vec<f64> = (0..1000).map(|i| f64::from(i * 7919 % 4001) / 10.0).collect();
        let centring = Centring { channels: 1, intercept: true };
        let scaling = |columns: &[&[f64]]| {
            let mut all = centring.empty();
            for column in columns {
                let readings = vec![column.to_vec()];
                let block = Block { rows: column.len(), readings, ..Block::default() };
                centring.merge(&mut all, Rows::from(&block).reduce(&centring).unwrap()).unwrap();
            }
            centring.scaling(&all)
        };
        let mut sorted = column.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        let (head, tail) = column.split_at(311);
        assert_eq!(scaling(&[&column]), scaling(&[&sorted]));
        assert_eq!(scaling(&[&column]), scaling(&[tail, head]));
        assert_eq!(scaling(&[&column]), Scaling::from_sample(std::slice::from_ref(&column), true));
    }
}
