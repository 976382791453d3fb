//! From rows to exact sums: blocks of rows, the plan by which they are summed, sums under way.

pub(crate) mod accumulator;
pub(crate) mod adder;
mod block_sums;
mod kernel;
mod limbs;
mod open_sums;
mod plan;

pub use self::accumulator::Accumulator;
pub use self::adder::Adder;
