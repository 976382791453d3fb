//! Accumulators on any thread, each of which learns from what the others have met.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::accumulator::Accumulator;
use super::block_sums::Scratch;
use super::expected::Expected;
use crate::exact::error::ExactError;
use crate::exact::moments::layout::Layout;
use crate::exact::moments::product_sums::Moments;
use crate::model::Basis;

/// Adds rows to [`Accumulator`]s so that they can be merged cheaply.
///
/// Merging is cheap between sums about the same centre in the same limbs. So each accumulator begins
/// with the latest choice of these, which saves work and has no influence on results.
#[derive(Debug)]
pub struct Adder {
    basis: Basis,
    layout: Arc<Layout>,
    latest: Mutex<Expected>,
    /// Working memory that waits to be used again.
    scratches: Mutex<Vec<Scratch>>,
}

impl Adder {
    /// For rows of `channels` channels.
    pub fn new(basis: Basis, channels: usize) -> Self {
        Self {
            basis,
            layout: Arc::new(Layout::new(basis, channels)),
            latest: Mutex::new(Expected::nothing(channels)),
            scratches: Mutex::default(),
        }
    }

    /// Prepares for rows such as these. Those that cannot be summed exactly are of no account yet.
    pub fn expect<C: AsRef<[f64]>>(&self, readings: &[C], wrench: &[C]) {
        let mut latest = lock(&self.latest);
        latest.expect_readings(readings);
        latest.expect_wrench(wrench);
    }

    /// Sums over no rows.
    pub fn begin(&self) -> Accumulator {
        let latest = lock(&self.latest);
        let expected = match latest.in_counts() {
            true => latest.clone(),
            false => Expected::nothing(self.layout.channels()),
        };
        Accumulator::with_layout(self.basis, self.layout.clone(), expected)
    }

    /// Adds rows to `sums`, as [`Accumulator::absorb`] does.
    ///
    /// # Errors
    /// [`ExactError`] if the rows cannot be summed exactly.
    ///
    /// # Panics
    /// If the numbers or lengths of columns are not as said there.
    pub fn add<C: AsRef<[f64]>>(
        &self,
        sums: &mut Accumulator,
        readings: &[C],
        wrench: &[C],
    ) -> Result<(), ExactError> {
        sums.expected.learn(&lock(&self.latest));
        let choice = |sums: &Accumulator| sums.expected.choice.as_ref().map(Arc::as_ptr);
        let before = choice(sums);
        self.lend_scratch(sums);
        sums.absorb(readings, wrench)?;
        self.take_scratch_back(sums);
        if choice(sums) != before {
            let mut expected = sums.expected.clone();
            let mut latest = lock(&self.latest);
            // What another thread has met in the meantime counts too.
            expected.learn(&latest);
            *latest = expected;
        }
        Ok(())
    }

    /// Adds the rows of `later`, as [`Accumulator::merge`] does.
    ///
    /// # Errors
    /// [`ExactError`] if the rows of both cannot be summed exactly.
    pub fn merge(&self, sums: &mut Accumulator, later: Accumulator) -> Result<(), ExactError> {
        self.lend_scratch(sums);
        sums.merge(later)?;
        self.take_scratch_back(sums);
        Ok(())
    }

    /// The sums over all rows of `sums`, as [`Accumulator::finish`] has them.
    ///
    /// # Errors
    /// [`ExactError`] if they cannot be exact.
    pub fn finish(&self, mut sums: Accumulator) -> Result<Moments, ExactError> {
        self.lend_scratch(&mut sums);
        sums.sum_staged()?;
        self.take_scratch_back(&mut sums);
        sums.finish()
    }

    fn lend_scratch(&self, sums: &mut Accumulator) {
        sums.scratch = lock(&self.scratches).pop().unwrap_or_default();
    }

    fn take_scratch_back(&self, sums: &mut Accumulator) {
        lock(&self.scratches).push(std::mem::take(&mut sums.scratch));
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // A poisoned lock means that a thread has panicked, and the panic will be passed on.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
