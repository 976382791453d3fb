//! From exact sums to coefficients, to errors on rows that are held out, and to the spread of the
//! coefficients from group to group.

pub(crate) mod double_double_matrix;
mod equations;
mod group_scatter;
pub(crate) mod held_out;
pub(crate) mod rank;

pub use self::held_out::{ExactFit, HeldOutErrors, PartMoments, PartitionedMoments};
