//! Trust in a calibration outside its training data, beyond the [errors on held-out
//! rows](cross_validation): [`plateaus`] finds groups in recordings, [`excitation`] measures the
//! coverage of the six axes, [`leaks`] finds poses on both sides of a split, and [`outliers`] finds
//! rows that stand out.

pub mod excitation;
pub mod leaks;
pub mod outliers;
pub mod plateaus;

pub use least_squares::validation::{comparison, cross_validation, grouped, selection};
