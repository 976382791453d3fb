//! Trust in a calibration beyond its training data and the [errors on held-out
//! rows](cross_validation): [`pose_finder`] finds groups, [`excitation`] measures the coverage of the
//! axes, [`leaks`] finds poses on both sides of a split, and [`outliers`] corrupt rows.

pub mod excitation;
pub mod leaks;
pub mod outliers;
pub mod pose_finder;

pub use least_squares::validation::{comparison, cross_validation, grouped, selection};
