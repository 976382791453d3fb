//! Rows of any numbers, kept as what a QR factorisation leaves of them.
//!
//! Where rows cannot be summed exactly (volts, averages, anything with all the digits of a double), the
//! R factor of their features and wrench takes the place of the sums ([`FactoredRows`]):
//!
//! ```text
//! [X | W] = Q · | R  Z |
//!               | 0  E |
//! ```
//!
//! Whatever the sums of some rows say of a fit, the R factor says as well: `X_gᵀX_g = RᵀR`, `X_gᵀ(W_g − X_g·C) =
//! Rᵀ(Z − R·C)`, and products of residuals are those of `Z − R·C` and `E`. Squares are never formed and nothing is
//! taken away from a sum, so errors grow with the condition number and not with its square. R factors of groups of
//! rows merge to that of all ([`FactoredGroups`]).
//!
//! Features are always summed with a constant, so they can be expressed about another centre:
//! R factors of recordings that were made apart merge, and the features of a smaller model are among those of a
//! larger one. What depends on the order of the rows is the last digits, no more.

mod groups;
mod rows;
mod stored;

pub use self::groups::{FactoredGroups, GroupFactors};
pub use self::rows::FactoredRows;
