//! Many accumulators of one worker, each of which begins with what the others expect.

use super::accumulator::Accumulator;
use super::block_sums::Scratch;
use crate::exact::error::ExactError;
use crate::exact::moments::product_sums::Moments;
use crate::exact::moments::reading_unit::ReadingUnit;
use crate::model::Basis;

/// Adds rows to [`Accumulator`]s of one basis.
///
/// Each begins with the plan of the one that rows were last added to, which saves work and has no
/// influence on results. All use one working memory.
#[derive(Clone, Debug)]
pub struct Adder {
    /// An accumulator without rows, to be copied.
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
        self.with_scratch(sums, |sums| sums.absorb(readings, wrench))?;
        // Readings with fractions are too rare for their ranges to be shared.
        if sums.expected.channels.iter().all(|channel| channel.unit == ReadingUnit::COUNT) {
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
