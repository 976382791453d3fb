//! Exact sums in a form that does not depend on how they were computed, and what can be done with
//! them without rounding: merging, subtracting, moving the origin, counting in finer units.

pub(crate) mod integers;
pub(crate) mod layout;
pub(crate) mod product_sums;
pub(crate) mod readings;
mod stored;

pub use self::product_sums::Moments;
pub use self::readings::{ChannelRange, ReadingUnit};
pub use self::stored::{StoredIntegers, StoredMoments};
