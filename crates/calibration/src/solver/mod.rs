//! From rows to coefficients: what all solvers have in common.
//!
//! A solver reduces blocks of rows to partial fits, merges partial fits in the order of the rows
//! and solves what is left. Memory does not grow with the number of rows, and blocks may be
//! reduced on several threads.

mod family;

pub use self::family::{SolverKind, exact_moments, fit, fit_by};
pub use crate::passes::{Pass, Rows, Workers};
pub use crate::solution::Solution;

use crate::FitError;
use crate::double_double::DoubleDouble;
use crate::model::Model;
use crate::reading_ranges::ReadingRanges;
use crate::scaling::{ChannelSample, Scaling};
use shell_data::block::Block;

/// The input of a solver besides the rows.
#[derive(Clone, Debug, PartialEq)]
pub struct FitProblem {
    /// The features.
    pub model: Model,
    /// Centre and scale of the readings.
    pub scaling: Scaling,
    /// λ ≥ 0 of a ridge on columns of norm one; the intercept is not penalised. 0 for none.
    pub ridge: f64,
}

/// What is known of the readings of all rows, for centre and scale where the answer depends on them.
///
/// A least-squares fit is the same about any centre. A penalty is not: it is on the coefficients of
/// the powers of readings about the centre. A sample of the rows would make the answer depend on their
/// order; the mean of all of them does not.
#[derive(Clone, Debug)]
pub struct ReadingSums {
    ranges: ReadingRanges,
    /// Exact as long as readings span fewer than some fifty binary places.
    sums: Vec<DoubleDouble>,
    integers: Vec<bool>,
}

impl ReadingSums {
    /// The result for zero rows.
    pub fn new(channels: usize) -> Self {
        Self {
            ranges: ReadingRanges::new(channels),
            sums: vec![DoubleDouble::ZERO; channels],
            integers: vec![true; channels],
        }
    }

    /// Centre and scale of the rows; `intercept` says whether readings are shifted at all.
    pub fn scaling(&self, intercept: bool) -> Scaling {
        let Self { ranges, sums, integers } = self;
        let channel = |i: usize| ChannelSample {
            min: ranges.channels[i].min,
            max: ranges.channels[i].max,
            mean: sums[i].to_f64() / ranges.rows as f64,
            integers: integers[i],
        };
        Scaling::from_channels((0..sums.len()).map(channel), intercept)
    }
}

impl Pass for ReadingSums {
    const ANY_ORDER: bool = true;

    fn absorb(&mut self, block: &Block) -> Result<(), FitError> {
        self.ranges.merge(&ReadingRanges::from_block(block, self.sums.len())?);
        for (channel, column) in block.readings.iter().enumerate() {
            let sum = &mut self.sums[channel];
            *sum = column.iter().fold(*sum, |sum, &s| sum + DoubleDouble::from(s));
            self.integers[channel] &= column.iter().all(|s| s.fract() == 0.0);
        }
        Ok(())
    }

    fn merge(&mut self, later: Self) -> Result<(), FitError> {
        self.ranges.merge(&later.ranges);
        self.sums.iter_mut().zip(later.sums).for_each(|(sum, more)| *sum += more);
        self.integers.iter_mut().zip(later.integers).for_each(|(all, more)| *all &= more);
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
        let scaling = |columns: &[&[f64]]| {
            let (empty, mut all) = (ReadingSums::new(1), ReadingSums::new(1));
            for column in columns {
                let readings = vec![column.to_vec()];
                let block = Block { rows: column.len(), readings, ..Block::default() };
                all.merge(Rows::from(&block).reduce(&empty).unwrap()).unwrap();
            }
            all.scaling(true)
        };
        let mut sorted = column.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        let (head, tail) = column.split_at(311);
        assert_eq!(scaling(&[&column]), scaling(&[&sorted]));
        assert_eq!(scaling(&[&column]), scaling(&[tail, head]));
        assert_eq!(scaling(&[&column]), Scaling::from_sample(std::slice::from_ref(&column), true));
    }
}
