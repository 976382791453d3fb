//! Exact sums in a form that does not depend on how they were computed, and what can be done with
//! them without rounding: merging, subtracting, moving the origin, counting in finer units.

pub(crate) mod channel;
mod document;
pub(crate) mod layout;
pub(crate) mod planes;
pub(crate) mod product_sums;
pub(crate) mod rounding;
pub(crate) mod scaled;
pub(crate) mod unit;

pub use self::product_sums::Moments;
