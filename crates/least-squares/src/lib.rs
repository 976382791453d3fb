//! Least squares of many rows: features of readings on one side, six loads on the other.
//!
//! ```text
//! rows ─▶ features ─▶ sums, all or by group ─▶ solution ─▶ errors on groups held out, covariance
//! ```
//!
//! Rows leave little behind, which can be merged: [`exact`] sums of integer readings, the same bits in any order, or
//! [R factors](factored) of readings of any kind. Either, as [`sums`], [holds groups out](validation), chooses a model, and
//! says [how coefficients scatter](uncertainty) without the rows. [`solver`] goes over rows where they are, on several
//! threads ([`passes`]), by one of several [methods]. Other crates know which sensor a reading is from, and how a model of
//! one is fitted. Pure: no files, no clocks, no printing.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod block_ranges;
pub mod double_double;
pub mod error;
pub mod exact;
pub mod factored;
pub mod features;
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
pub mod scaling;
pub mod solution;
pub mod solver;
pub mod sums;
pub mod symmetric;
pub mod uncertainty;
pub mod validation;
mod vectors;
