//! The exact solver: sums of products of integer readings without rounding.
//!
//! Readings are integers of at most 16 bits, and features are products of up to three, so every
//! element of the normal equations `XᵀX·C = XᵀW` is an integer times a power of two. An
//! [`Accumulator`] sums them exactly, with vector arithmetic on small integers; the [`ExactSums`]
//! do not depend on the order of the rows. [`ExactSums::solve`] moves the origin of every channel
//! to its mean, still exactly, and solves in double-double, whose extra digits replace those that
//! forming `XᵀX` can cost. Integer arithmetic decides the rank, not a tolerance.
//!
//! Readings with fractions finer than 1/256 that are not short decimals, and wrenches that span more than 255 binary
//! places on an axis, give an [`ExactError`]: use another solver.

mod accumulator;
mod block_sums;
mod double_double_matrix;
mod equations;
mod held_out;
mod integers;
mod layout;
mod limbs;
mod plan;
mod product_sums;
mod rank;
mod readings;
mod stored;

pub use self::accumulator::{Accumulator, Adder};
pub use self::held_out::{ExactFit, PartSums, PartitionedSums};
pub use self::product_sums::ExactSums;
pub use self::readings::{ChannelRange, ReadingUnit};
pub use self::stored::{StoredIntegers, StoredSums};
pub use crate::error::{ExactError, MAX_ROWS};
