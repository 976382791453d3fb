//! One pass over blocks on several threads.

use std::sync::{Mutex, PoisonError};

use super::Pass;
use crate::FitError;
use shell_data::block::Block;

/// Reduces blocks on any thread.
///
/// Where order matters, every block leaves a partial of its own behind, to be merged in the order of
/// the blocks. Where it does not, a block is added to whatever partial is at hand, and there are
/// only as many of these as there are threads.
pub struct Reducer<'a, P: Pass> {
    pass: &'a P,
    /// Those that no thread is adding to.
    idle: Mutex<Vec<P::Partial>>,
}

impl<'a, P: Pass> Reducer<'a, P> {
    /// No blocks yet.
    pub fn new(pass: &'a P) -> Self {
        Self { pass, idle: Mutex::default() }
    }

    /// Takes up the rows of a block; what it returns is to be handed to [`Self::merge`].
    ///
    /// # Errors
    /// As [`Pass::absorb`].
    pub fn reduce(&self, block: &Block) -> Result<Option<P::Partial>, FitError> {
        if !P::ANY_ORDER {
            return self.pass.reduce(block).map(Some);
        }
        let idle = || self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        let at_hand = idle().pop();
        let mut partial = at_hand.unwrap_or_else(|| self.pass.empty());
        self.pass.absorb(&mut partial, block)?;
        idle().push(partial);
        Ok(None)
    }

    /// Merges what blocks have left behind, in their order.
    pub fn merge(&self, all: &mut P::Partial, block: Option<P::Partial>) {
        if let Some(block) = block {
            self.pass.merge(all, block);
        }
    }

    /// What all blocks leave behind, after `all` that were merged.
    pub fn finish(self, all: P::Partial) -> P::Partial {
        let idle = self.idle.into_inner().unwrap_or_else(PoisonError::into_inner);
        idle.into_iter().fold(all, |mut all, partial| {
            self.pass.merge(&mut all, partial);
            all
        })
    }
}
