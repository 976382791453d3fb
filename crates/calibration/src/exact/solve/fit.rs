//! The result of a fit to exact sums.

use super::cholesky::{AxisRow, axis_row};
use super::partition::EquationScales;
use crate::double_double::DoubleDouble;
use crate::solution::Solution;
use shell_data::wrench::PerAxis;

/// A solution, and what the sums say about its errors on other sums.
#[derive(Clone, Debug)]
pub struct ExactFit {
    /// The solution. Scales are powers of two, centres zero without an intercept.
    pub solution: Solution,
    /// Its coefficients with all their digits: one row per feature, in N and N·m.
    pub coefficients: Vec<PerAxis<DoubleDouble>>,
    /// Those of the features of readings that are counted in the units of the sums, in N and N·m.
    pub(crate) scales: EquationScales,
    /// How much larger a feature is than one that is counted so: one where units are powers of two.
    pub(crate) stretch: Vec<DoubleDouble>,
}

impl ExactFit {
    /// The coefficients for features as they are counted, axes as lanes.
    pub(crate) fn counted_coefficients(&self) -> Vec<AxisRow> {
        let row = |(row, &stretch): (&PerAxis<DoubleDouble>, &DoubleDouble)| -> AxisRow {
            axis_row(|axis| row[axis] * stretch)
        };
        self.coefficients.iter().zip(&self.stretch).map(row).collect()
    }
}
