//! The exact solver: sums of products of integer readings without rounding.
//!
//! Readings are integers of at most 16 bits, features are products of up to three of them, so every
//! element of the normal equations `XᵀX·C = XᵀW` is an integer times a power of two. An
//! [`Accumulator`] sums them exactly, with ordinary vector arithmetic on integers that are small
//! enough; [`Moments`] is the result, the same for any order and grouping of the rows.
//! [`Moments::solve`] then moves the origin of every channel to its mean, still exactly, and solves
//! in double-double arithmetic, which carries twice the digits that forming `XᵀX` can cost. Loss of
//! rank is decided by integer arithmetic, not by a tolerance.
//!
//! Omitted: readings with fractions finer than 1/256 that are not decimals of few digits, and
//! wrenches whose magnitudes on one axis span more than 250 binary places. [`ExactError`] says so,
//! and another solver has to do.

mod error;
mod moments;
mod solve;
mod sums;

pub use self::error::{ExactError, MAX_ROWS};
pub use self::moments::{ChannelRange, Moments, ReadingUnit, StoredIntegers, StoredMoments};
pub use self::solve::{ExactFit, HeldOutErrors, NewGroup, PartMoments, PartitionedMoments};
pub use self::sums::{Accumulator, Adder};
