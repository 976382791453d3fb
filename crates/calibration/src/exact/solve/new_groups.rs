//! What a fit to some groups of rows says of others, from sums alone.
//!
//! With `T·Tᵀ` the covariance of the coefficients of an axis, the mean over the rows of a group of the variance
//! that they bring is `tr(TᵀA_gT)/n`; its errors are as in [`held_out`](super::held_out).

use super::double_double_matrix::DoubleDoubleMatrix;
use super::fit::ExactFit;
use super::held_out::HeldOutErrors;
use crate::exact::moments::product_sums::Moments;
use crate::sandwich::GroupScatter;
use crate::symmetric::{UpperTriangle, trace_of_congruence};
use shell_data::wrench::PerAxis;

/// A group that was not fitted.
#[derive(Clone, Copy, Debug)]
pub struct NewGroup {
    /// The errors on its rows.
    pub errors: PerAxis<HeldOutErrors>,
    /// The variance of its rows that comes from the coefficients, on average, squares of N and N·m.
    pub variance: PerAxis<f64>,
}

impl ExactFit {
    /// What the fit, whose coefficients scatter by `scatter`, says of groups of rows.
    pub fn on_groups(&self, scatter: &GroupScatter, groups: &[&Moments]) -> Vec<NewGroup> {
        let (scales, coefficients) = (&self.scales, self.counted_coefficients());
        let stretch: Vec<f64> = self.stretch.iter().map(|s| s.to_f64()).collect();
        // Rows are features: from those of the fit to those that are counted.
        let factors = scatter.factors.each_ref().map(|factor| {
            UpperTriangle::from_fn(factor.nrows(), |i, j| stretch[i] * factor[(i, j)])
        });
        let of_group = |group: &&Moments| {
            let part = scales.part(group);
            let gram =
                DoubleDoubleMatrix::new(part.gram.iter().copied(), &scales.columns).rounded();
            let rows = part.rows.max(1) as f64;
            let variance =
                factors.each_ref().map(|factor| trace_of_congruence(factor, &gram).max(0.0) / rows);
            NewGroup { errors: scales.errors(&part, &coefficients), variance }
        };
        groups.iter().map(of_group).collect()
    }
}
