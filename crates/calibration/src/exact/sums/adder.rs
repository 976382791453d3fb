//! Many accumulators of one worker, each of which learns from the rows of the others.

use std::sync::Arc;

use super::accumulator::Accumulator;
use super::block_sums::Scratch;
use crate::exact::error::ExactError;
use crate::exact::moments::product_sums::Moments;
use crate::model::Basis;

/// Adds rows to [`Accumulator`]s of one basis.
///
/// A new plan closes the sums by the one before, so each expects what the others do, and begins with
/// the latest plan: that saves work and has no influence on results. All use one working memory.
#[derive(Clone, Debug)]
pub struct Adder {
    /// An accumulator without rows, which expects what is known of all, to be copied.
    empty: Accumulator,
    scratch: Scratch,
}

impl Adder {
    /// For rows of `channels` channels.
    pub fn new(basis: Basis, channels: usize) -> Self {
        Self { empty: Accumulator::new(basis, channels), scratch: Scratch::default() }
    }

    /// Sums over zero rows.
    pub fn begin(&self) -> Accumulator {
        self.empty.clone()
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
        let plan = |of: &Accumulator| of.expected.plan.as_ref().map(Arc::as_ptr);
        sums.expected.learn(&self.empty.expected);
        let before = plan(sums);
        self.with_scratch(sums, |sums| sums.absorb(readings, wrench))?;
        if plan(sums) != before && sums.expected.in_counts() {
            self.empty.expected.clone_from(&sums.expected);
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
