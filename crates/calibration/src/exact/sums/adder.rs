//! Many accumulators of one worker, each of which learns from the rows of the others.

use super::accumulator::Accumulator;
use super::block_sums::Scratch;
use super::expected_rows::ExpectedRows;
use crate::exact::error::ExactError;
use crate::exact::moments::product_sums::Moments;
use crate::model::Basis;

/// Adds rows to [`Accumulator`]s of one basis so that they can be merged cheaply.
///
/// Merging is cheap between sums about the same centre in the same limbs. So each accumulator starts
/// with the latest plan of these, which saves work and has no influence on results. All use one
/// working memory.
#[derive(Clone, Debug)]
pub struct Adder {
    /// An accumulator without rows, to be copied.
    empty: Accumulator,
    latest: ExpectedRows,
    scratch: Scratch,
}

impl Adder {
    /// For rows of `channels` channels.
    pub fn new(basis: Basis, channels: usize) -> Self {
        Self {
            empty: Accumulator::new(basis, channels),
            latest: ExpectedRows::nothing(channels),
            scratch: Scratch::default(),
        }
    }

    /// Sums over zero rows.
    pub fn begin(&self) -> Accumulator {
        let mut sums = self.empty.clone();
        if self.latest.in_counts() {
            sums.expected = self.latest.clone();
        }
        sums
    }

    /// Adds rows to `sums`, as [`Accumulator::absorb`] does.
    ///
    /// # Errors
    /// [`ExactError`] if the rows cannot be summed exactly.
    ///
    /// # Panics
    /// If the numbers or lengths of columns are not as described there.
    pub fn add<C: AsRef<[f64]>>(
        &mut self,
        sums: &mut Accumulator,
        readings: &[C],
        wrench: &[C],
    ) -> Result<(), ExactError> {
        sums.expected.learn(&self.latest);
        let before = sums.expected.plan.clone();
        self.with_scratch(sums, |sums| sums.absorb(readings, wrench))?;
        if !sums.expected.has_plan(before.as_ref()) {
            self.latest = sums.expected.clone();
        }
        Ok(())
    }

    /// The sums over all rows of `sums`, as [`Accumulator::finish`] returns them.
    ///
    /// # Errors
    /// [`ExactError`] if they cannot be exact.
    pub fn finish(&mut self, mut sums: Accumulator) -> Result<Moments, ExactError> {
        self.with_scratch(&mut sums, Accumulator::sum_staged)?;
        sums.finish()
    }

    /// Runs `task` on sums that have the working memory of this adder.
    fn with_scratch<R>(
        &mut self,
        sums: &mut Accumulator,
        task: impl FnOnce(&mut Accumulator) -> R,
    ) -> R {
        std::mem::swap(&mut sums.scratch, &mut self.scratch);
        let result = task(sums);
        std::mem::swap(&mut sums.scratch, &mut self.scratch);
        result
    }
}
