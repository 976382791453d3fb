//! How far a calibration can be trusted on what it was not trained on: what [errors on held-out rows](cross_validation) do not
//! say.
//!
//! [`plateaus`] finds groups where none are named, [`excitation`] says how well the training loads cover the six axes,
//! [`leaks`] which rows are on both sides of a split, [`outliers`] which rows stand out.

pub mod excitation;
pub mod leaks;
pub mod outliers;
pub mod plateaus;

pub use least_squares::validation::{comparison, cross_validation, grouped, selection};
