//! From rows to exact sums: blocks of rows, the plan by which they are summed, sums under way.

pub(crate) mod accumulator;
mod block_sums;
mod limbs;
mod plan;

pub use self::accumulator::{Accumulator, Adder};
