//! Rows with arbitrary readings, reduced to their R factor.
//!
//! Volts, averages, and other readings with all the digits of a double cannot be summed exactly.
//! Their sums are replaced by the R factor of features and wrench ([`FactoredRows`]):
//!
//! ```text
//! [X | W] = Q · | R  Z |
//!               | 0  E |
//! ```
//!
//! For the R factor of a group g, `X_gᵀX_g = RᵀR` and `X_gᵀ(W_g − X_g·C) = Rᵀ(Z − R·C)`. The products of residuals come
//! from `Z − R·C` and `E`. No squares are formed or subtracted, so errors grow with the condition number and not with
//! its square. R factors of groups merge to the R factor of all rows ([`FactoredGroups`]).
//!
//! Features always include a constant, so an R factor can be changed to another centre. R factors
//! of separate recordings can therefore be merged, and smaller models are contained in larger ones.
//! The order of the rows affects only the last digits.

mod groups;
mod rows;
mod stored;

pub(crate) use self::groups::check_group_count;
pub use self::groups::{FactoredGroups, GroupFactors};
pub use self::rows::FactoredRows;
