//! The share of one worker thread in a pass over blocks.

use super::pass::Pass;
use crate::FitError;
use shell_data::block::Block;

/// Reduces the blocks that one worker gets.
///
/// Where order matters ([`Pass::ANY_ORDER`] is false), every block leaves a partial of its own, to
/// be merged in the order of the blocks. Where it does not, the worker adds all its blocks to one
/// partial, which is merged with those of the other workers at the end.
#[derive(Debug)]
pub struct PassWorker<'a, P: Pass> {
    pass: &'a P,
    partial: Option<P::Partial>,
}

impl<'a, P: Pass> PassWorker<'a, P> {
    /// A worker without rows.
    pub fn new(pass: &'a P) -> Self {
        Self { pass, partial: None }
    }

    /// Reduces a block; returns its partial where that is to be merged in the order of the blocks.
    ///
    /// # Errors
    /// As [`Pass::absorb`].
    pub fn reduce(&mut self, block: &Block) -> Result<Option<P::Partial>, FitError> {
        if !P::ANY_ORDER {
            return self.pass.reduce(block).map(Some);
        }
        let partial = self.partial.get_or_insert_with(|| self.pass.empty());
        self.pass.absorb(partial, block)?;
        Ok(None)
    }

    /// Adds the rows of all `workers` to `all`.
    pub fn merge(workers: impl IntoIterator<Item = Self>, all: &mut P::Partial) {
        for Self { pass, partial } in workers {
            if let Some(partial) = partial {
                pass.merge(all, partial);
            }
        }
    }
}
