//! From exact sums to coefficients, to errors on rows that are held out, and to the spread of the
//! coefficients from group to group.

pub(crate) mod cholesky;
mod double_double_matrix;
mod equations;
pub(crate) mod fit;
mod group_scatter;
pub(crate) mod held_out;
mod modular;
pub(crate) mod new_groups;
pub(crate) mod partition;
pub(crate) mod rank;
mod scales;
mod solver;

pub use self::fit::ExactFit;
pub use self::held_out::{HeldOutErrors, PartitionedMoments};
pub use self::new_groups::NewGroup;
pub use self::partition::PartMoments;
