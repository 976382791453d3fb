//! Errors on rows that were held out, and the choice of a model by them.
//!
//! Rows of one recording, or of one pose, resemble each other. A random split puts neighbours on both sides,
//! and a model is then tested on what it has all but seen. So rows are held out by group: [`grouped`] sums
//! them group by group in one pass, [`cross_validation`] fits without each group and finds the errors on it
//! from those sums, [`selection`] compares models by these errors.
//!
//! Without exact sums, taking a group away from the whole would cancel: for readings that the exact solver
//! cannot take, [`factored`] merges the R factors of the others, and [`normal_equations`] adds theirs up for choices
//! that need three digits.

pub mod comparison;
pub mod cross_validation;
pub mod factored;
pub mod grouped;
pub mod normal_equations;
pub mod selection;
