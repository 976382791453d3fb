//! Errors on held-out rows, and the choice of a model by these errors.
//!
//! Rows of one recording, or of one pose, resemble each other. A random split puts similar rows on both
//! sides, so a model is tested on rows much like those it was trained on. Therefore rows are held out by
//! group: [`grouped`] sums them group by group in one pass, [`cross_validation`] fits without each group and
//! computes the errors on it from those sums, and [`selection`] compares models by these errors.
//!
//! Without exact sums, subtracting a group from the total would cancel. For readings that the exact solver
//! cannot take, [`factored`] merges the R factors of the other groups, and [`normal_equations`] adds up the
//! normal equations of the others for choices that need only three digits.

pub mod comparison;
pub mod cross_validation;
pub mod factored;
pub mod grouped;
pub mod normal_equations;
pub mod selection;
