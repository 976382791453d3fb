//! How far a calibration can be trusted on what it was not trained on.
//!
//! Rows of one recording, or of one pose, resemble each other. A random split puts neighbours on both sides,
//! and a model is then tested on what it has all but seen. So rows are held out by group: [`grouped`] sums
//! them group by group in one pass, [`cross_validation`] fits without each group and finds the errors on it
//! from those sums, [`selection`] compares models by these errors, [`plateaus`] finds groups where none are
//! named, [`excitation`] says how well the training loads cover the six axes.
//!
//! Without exact sums, taking a group away from the whole would cancel: for readings that the exact solver
//! cannot take, `normal_equations` adds the other groups up instead.

pub mod comparison;
pub mod cross_validation;
pub mod excitation;
pub mod factored;
pub mod grouped;
pub mod leaks;
pub(crate) mod normal_equations;
pub mod outliers;
pub mod plateaus;
pub mod selection;
