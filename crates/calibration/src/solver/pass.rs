//! One pass over the rows.

use crate::FitError;
use shell_data::block::Block;

/// A pass over the rows of a log, block by block.
pub trait Pass: Sync {
    /// The result of reducing some of the rows.
    type Partial: Send;

    /// Whether `merge` is commutative and associative, bit for bit: the partial does not depend on the
    /// order and grouping of the rows.
    const ANY_ORDER: bool = false;

    /// The partial of zero rows, the identity of [`Self::merge`].
    fn empty(&self) -> Self::Partial;

    /// Adds the rows of a block. May be called on any thread.
    ///
    /// # Errors
    /// [`FitError`] where the solver cannot work with these readings or wrenches; what is left is
    /// of no further use.
    fn absorb(&self, partial: &mut Self::Partial, block: &Block) -> Result<(), FitError>;

    /// Adds the rows of `later` to those of `earlier`.
    fn merge(&self, earlier: &mut Self::Partial, later: Self::Partial);

    /// Of the rows of a block.
    ///
    /// # Errors
    /// As [`Self::absorb`].
    fn reduce(&self, block: &Block) -> Result<Self::Partial, FitError> {
        let mut partial = self.empty();
        self.absorb(&mut partial, block)?;
        Ok(partial)
    }
}
