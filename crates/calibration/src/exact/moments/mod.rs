//! Exact sums in a form that does not depend on how they were computed, and what can be done with
//! them without rounding: merging, subtracting, moving the origin, counting in finer units.

pub(crate) mod channel_range;
pub(crate) mod layout;
mod possible;
pub(crate) mod product_sums;
pub(crate) mod reading_unit;
pub(crate) mod rounding;
pub(crate) mod scaled_integers;
mod stored;

pub use self::channel_range::ChannelRange;
pub use self::product_sums::Moments;
pub use self::reading_unit::ReadingUnit;
pub use self::stored::{StoredIntegers, StoredMoments};
