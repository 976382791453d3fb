//! The exact solver: sums of products of integer readings without rounding.
//!
//! Readings are integers of at most 16 bits, and features are products of up to three readings, so every
//! element of the normal equations `XᵀX·C = XᵀW` is an integer times a power of two. An [`Accumulator`] sums
//! them exactly, with ordinary vector arithmetic on sufficiently small integers. The result, [`ExactSums`],
//! does not depend on the order and grouping of the rows. [`ExactSums::solve`] then moves the origin of every
//! channel to its mean, still exactly, and solves in double-double arithmetic, whose extra digits replace
//! those that forming `XᵀX` can cost. Loss of rank is decided by integer arithmetic, not by a tolerance.
//!
//! Not supported: readings with fractions finer than 1/256 that are not decimals of few digits, and wrenches
//! whose magnitudes on one axis span more than 250 binary places. For these, summation fails with an
//! [`ExactError`]; use another solver.

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
