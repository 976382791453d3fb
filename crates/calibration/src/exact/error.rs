//! Why sums cannot be exact.

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
