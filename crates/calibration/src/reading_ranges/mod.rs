//! Which readings a calibration has seen: rows, and the range of each channel.
//!
//! Found in the same pass as the fit, whatever the solver. It says where a calibration may be
//! trusted, and names channels that never moved.

mod block;
mod ranges;

pub use self::ranges::{ReadingRange, ReadingRanges};
