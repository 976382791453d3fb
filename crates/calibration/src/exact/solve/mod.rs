//! From exact sums to coefficients, to errors on rows that are held out, and to the spread of the
//! coefficients from group to group.

pub(crate) mod by_group;
pub(crate) mod cholesky;
mod equations;
pub(crate) mod fit;
pub(crate) mod held_out;
mod modular;
mod multipliers;
pub(crate) mod parts;
pub(crate) mod rank;
mod scales;
mod solver;
mod symmetric;

pub use self::by_group::{ByGroup, GroupsError};
pub use self::fit::{Fit, SolveError};
pub use self::held_out::HeldOut;
pub use self::parts::{Part, Parts};
pub use self::rank::{RankLoss, Relation};
