//! Trust in a calibration for data outside its training, beyond the [errors on held-out
//! rows](cross_validation).
//!
//! [`plateaus`] finds groups in recordings without named groups, [`excitation`] measures how well the
//! training loads cover the six axes, [`leaks`] finds rows on both sides of a split, and [`outliers`] finds
//! rows that stand out.

pub mod excitation;
pub mod leaks;
pub mod outliers;
pub mod plateaus;

pub use least_squares::validation::{comparison, cross_validation, grouped, selection};
