//! Errors on held-out rows, and the choice of a model by these errors.
//!
//! Rows of one recording, or of one pose, resemble each other, so a random split tests a model on
//! rows much like its training rows. Rows are therefore held out by group: [`grouped`] sums them in
//! one pass, [`cross_validation`] fits without each group from those sums, and [`selection`]
//! compares models. Without exact sums, subtracting a group would cancel: [`factored`] merges the R factors of the
//! other groups, and [`normal_equations`] adds up the equations of the other groups for choices that need only three
//! digits.

pub mod comparison;
pub mod cross_validation;
pub mod factored;
pub mod grouped;
pub mod normal_equations;
pub mod selection;
