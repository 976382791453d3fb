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
pub use self::held_out::{ExactFit, HeldOutErrors, PartMoments, PartitionedMoments};
pub use self::product_sums::Moments;
pub use self::readings::{ChannelRange, ReadingUnit};
pub use self::stored::{StoredIntegers, StoredMoments};

use shell_data::wrench::Axis;

/// Rows that fit: sums of 2³⁰ sixth powers of 16-bit readings stay below 2¹²⁶.
pub const MAX_ROWS: u64 = 1 << 30;

/// Why sums cannot be exact.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ExactError {
    /// A reading is not an integer, nor one over a power of two or ten.
    #[error("reading `{value}` of channel `s{}` is not an integer of 16 bits, nor that over a power of two or ten", channel + 1)]
    NotAnInteger {
        /// The channel, from 0.
        channel: usize,
        /// The reading.
        value: f64,
    },
    /// The readings of a channel span more than 16 bits.
    #[error("readings of channel `s{}` span more than 16 bits", channel + 1)]
    TooWide {
        /// The channel, from 0.
        channel: usize,
    },
    /// A component of the wrench is infinite or not a number.
    #[error("`{}` is not finite in some row", axis.name())]
    NotFinite {
        /// The axis.
        axis: Axis,
    },
    /// The magnitudes on an axis differ too much for fixed-point numbers.
    #[error("the magnitudes of `{}` span too many powers of two", axis.name())]
    TooManyPlaces {
        /// The axis.
        axis: Axis,
    },
    /// There are memory terms, which are no integers.
    #[error("memory terms are not integers")]
    MemoryTerms,
    /// More than [`MAX_ROWS`] rows.
    #[error("more than `{MAX_ROWS}` rows")]
    TooManyRows,
}
