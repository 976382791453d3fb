//! Sums of blocks of rows on any thread, each begun with what the others have met.

use std::sync::{Mutex, MutexGuard, PoisonError};

use super::ExactError;
use super::accumulator::Accumulator;
use super::block_sums::Scratch;
use crate::calibration::model::Basis;

/// Sums blocks of rows, one [`Accumulator`] each, so that they can be merged cheaply.
///
/// Merging is cheap between sums about the same centre in the same limbs. So each block begins
/// with the latest choice of these, which saves work and has no influence on results.
#[derive(Debug)]
pub struct Adder {
    latest: Mutex<Accumulator>,
    /// Working memory that waits to be used again.
    scratches: Mutex<Vec<Scratch>>,
}

impl Adder {
    /// Sums rows of `channels` channels.
    pub fn new(basis: Basis, channels: usize) -> Self {
        let latest = Mutex::new(Accumulator::new(basis, channels));
        Self { latest, scratches: Mutex::default() }
    }

    /// Prepares for rows such as these. Those that cannot be summed exactly are of no account yet.
    pub fn expect<C: AsRef<[f64]>>(&self, readings: &[C], wrench: &[C]) {
        lock(&self.latest).expect(readings, wrench);
    }

    /// The sums over some rows, as in [`Accumulator::absorb`].
    ///
    /// # Errors
    /// [`ExactError`] if the rows cannot be summed exactly.
    ///
    /// # Panics
    /// If the numbers or lengths of columns are not as said there.
    pub fn sum<C: AsRef<[f64]>>(
        &self,
        readings: &[C],
        wrench: &[C],
    ) -> Result<Accumulator, ExactError> {
        let mut sums = lock(&self.latest).fork();
        let start = sums.choice();
        sums.take_scratch(lock(&self.scratches).pop().unwrap_or_default());
        sums.absorb(readings, wrench)?;
        lock(&self.scratches).push(sums.settle()?);
        if sums.choice() != start {
            let mut latest = lock(&self.latest);
            // What another thread has met in the meantime counts too.
            sums.expect_as(&latest);
            *latest = sums.fork();
        }
        Ok(sums)
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // A poisoned lock means that a thread has panicked, and the panic will be passed on.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
