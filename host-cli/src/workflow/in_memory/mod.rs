//! Fits to rows in memory: what [`fit`](super::fit), [`physics`](super::physics) and
//! [`model_choice`](super::model_choice) do for logs, for callers that have arrays.
//!
//! Rows are taken in blocks of [`BLOCK_ROWS`], on several threads, wherever and in whatever layout the
//! caller keeps them. Coefficients, covariance and held-out errors are the bits that a log of the same rows
//! gives.

mod fit;
mod physics;
mod rows;

pub use fit::{RowFit, RowFitOptions, fit, sum};
pub use physics::{PhysicsRowFit, fit_physics};
pub use rows::{BLOCK_ROWS, RowSource};
