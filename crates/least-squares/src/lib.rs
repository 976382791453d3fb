//! Linear least squares over many rows: features of readings on one side, six loads on the other.
//!
//! ```text
//! rows ─▶ features ─▶ sums, all or by group ─▶ solution ─▶ errors on groups held out, covariance
//! ```
//!
//! Rows are reduced to small, mergeable results: [`exact`] sums of integer readings, with the same
//! bits in any order, or [R factors](factored) of any readings. Either kind of [`sums`] supports
//! [cross-validation](validation), model selection and the [covariance of coefficients](uncertainty). [`solver`]
//! instead makes [`passes`] over rows in memory and solves by one of several [methods]. No files, clocks or printing.

#![forbid(unsafe_code)]

pub mod block_ranges;
pub mod double_double;
pub mod error;
pub mod exact;
pub mod factored;
pub mod features;
pub mod fitted_groups;
pub mod grouped_rows;
pub mod held_out_errors;
pub mod magnitudes;
pub mod methods;
pub mod model;
pub mod passes;
pub mod polynomial;
pub mod quality;
pub mod r_factor;
pub mod random_split;
pub mod rank_loss;
pub mod reading_ranges;
pub mod sandwich;
mod satterthwaite;
pub mod scaling;
pub mod solution;
pub mod solver;
pub mod sums;
pub mod symmetric;
pub mod uncertainty;
pub mod validation;
mod vectors;
