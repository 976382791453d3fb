//! Standard errors and intervals by group for a fit by Huber's M-estimator.
//!
//! The solution satisfies `Σ ψ(rᵢ/σ)·xᵢ = 0`, so least squares with the pseudo-responses `yᵢ* = xᵢᵀC + σ·ψ(rᵢ/σ) /
//! mean ψ'` gives the same coefficients, and the scatter of its scores over groups is the sandwich of the
//! M-estimator: `(Σψ'xxᵀ)⁻¹ (Σ_g s_g·s_gᵀ) (Σψ'xxᵀ)⁻¹`, with `s_g` a group's sum of `σ·ψ·x` (Huber, Robust
//! Statistics, 1981, §7.6, with groups instead of rows). Errors on held-out groups are not clipped: an interval must
//! cover rows as they are.

use super::covariance::Covariance;
use super::new_groups::{of_scores, score_of};
use crate::error::FitError;
use crate::fitted_groups::FittedGroups;
use crate::grouped_rows::GroupedRows;
use crate::methods::clip_of_sizes as clip_of;
use crate::passes::Workers;
use crate::polynomial::Polynomial;
use crate::reading_ranges::ReadingRanges;
use crate::solver::{self, FitProblem, Solution, SolverKind};
use shell_data::block::Block;
use shell_data::dataset::Dataset;
use shell_data::wrench::{Axes, PerAxis};

impl Covariance {
    /// Covariance of a solution by Huber's M-estimator, with errors correlated within the groups of `block`. `ridge`
    /// is the requested value.
    ///
    /// # Errors
    /// [`FitError`] if there are too few groups, or the model cannot be fitted without one of them.
    pub fn from_clipped_groups(
        block: &Block,
        solution: &Solution,
        ridge: f64,
        workers: Workers<'_>,
    ) -> Result<Self, FitError> {
        let (rows, labels) = grouped(&clipped(block, solution)?);
        let groups = FittedGroups::from_rows(&rows, &labels, solution, workers)?;
        let score = |group: usize| {
            let label = &labels[group..=group];
            let rest = part(block, |of| *of != label[0]);
            let problem =
                FitProblem { model: solution.model, scaling: solution.scaling.clone(), ridge };
            let (without, _) = solver::fit(SolverKind::Huber, problem, &(&rest).into()).ok()?;
            let (others, labels) = grouped(&clipped(&rest, &without).ok()?);
            let one = Workers::ONE;
            let others = FittedGroups::from_rows(&others, &labels, &without, one).ok()?;
            let scatter = others.scatter(false, one).ok()?;
            let (held_out, _) = grouped(&part(block, |of| *of == label[0]));
            let held_out = FittedGroups::from_rows(&held_out, label, &without, one).ok()?;
            let variance = held_out.variance(0, &scatter);
            Some(score_of(&held_out.errors(0), &variance, &scatter, without.rows))
        };
        let intervals = |_: &_| of_scores(labels.len(), workers, score);
        Self::with_intervals(&groups, solution.rows, workers, intervals)
    }
}

fn grouped(block: &Block) -> (GroupedRows, Vec<String>) {
    GroupedRows::from_labels(&Dataset::from_blocks("rows", Axes::ALL, vec![block.clone()]))
}

/// Rows with pseudo-responses in place of the wrench.
fn clipped(block: &Block, solution: &Solution) -> Result<Block, FitError> {
    ReadingRanges::from_block(block, solution.model.columns())?;
    let mut predicted: PerAxis<Vec<f64>> = PerAxis::default();
    Polynomial::from(solution).wrench(&block.readings, block.rows, &mut predicted);
    let mut pseudo = block.clone();
    for (predicted, wrench) in predicted.iter().zip(&mut pseudo.wrench) {
        let sizes: Vec<f64> =
            predicted.iter().zip(&*wrench).map(|(fit, w)| (w - fit).abs()).collect();
        let clip = clip_of(&mut sizes.clone());
        let inside = sizes.iter().filter(|&&size| size <= clip).count().max(1);
        let magnification = sizes.len() as f64 / inside as f64;
        for (w, fit) in wrench.iter_mut().zip(predicted) {
            *w = fit + magnification * (*w - fit).clamp(-clip, clip);
        }
    }
    Ok(pseudo)
}

fn part(block: &Block, is_in: impl Fn(&String) -> bool) -> Block {
    let keep: Vec<bool> = (block.groups.iter())
        .flat_map(|(label, rows)| std::iter::repeat_n(is_in(label), *rows))
        .collect();
    block.kept(&keep)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Basis, Model};
    use crate::scaling::Scaling;
    use crate::uncertainty::CoefficientCovariance;
    use system_tests::random::Random;

    /// Groups of nine rows with similar errors; one row in twenty has a far larger error.
    fn wild_block(groups: usize, wild: f64) -> Block {
        let mut random = Random(5);
        let rows = 9 * groups;
        let mut block = Block { rows, ..Block::default() };
        block.readings = vec![Vec::new(); 2];
        block.wrench = vec![Vec::new(); 6];
        for group in 0..groups {
            let position = [random.normal(), random.normal()];
            let common = random.normal();
            for row in 0..9 {
                let readings = position.map(|position| position + 0.05 * random.normal());
                let far = if (9 * group + row) % 20 == 7 { wild } else { 0.0 };
                for (axis, column) in block.wrench.iter_mut().enumerate() {
                    let load = readings[axis % 2] * (axis as f64 + 1.0);
                    column.push(load + 0.3 * common + 0.1 * random.normal() + far);
                }
                block.readings.iter_mut().zip(readings).for_each(|(column, s)| column.push(s));
            }
            block.groups.push((group.to_string(), 9));
        }
        block
    }

    fn fit(kind: SolverKind, block: &Block) -> Solution {
        let model = Model { basis: Basis::Linear, intercept: true, channels: 2, memory: 0 };
        let scaling = Scaling::from_sample(&block.readings, true);
        let problem = FitProblem { model, scaling, ridge: 0.0 };
        solver::fit(kind, problem, &block.into()).unwrap().0
    }

    #[test]
    fn least_squares_of_pseudo_responses_is_the_robust_fit() {
        let block = wild_block(30, 40.0);
        let robust = fit(SolverKind::Huber, &block);
        let again = fit(SolverKind::RefinedTsqr, &clipped(&block, &robust).unwrap());
        // The robust fit stops at steps of 1e-8 of the standard errors; its remaining error may be some 1e-7.
        let difference = (&robust.coefficients - &again.coefficients).norm_max();
        assert!(difference < 1e-6, "{difference}");
        let plain = fit(SolverKind::RefinedTsqr, &block);
        assert!((&robust.coefficients - &plain.coefficients).norm_max() > 0.1);
    }

    #[test]
    fn errors_are_near_least_squares_and_outliers_hardly_widen_them() {
        let errors = |block: &Block, kind: SolverKind| {
            let solution = fit(kind, block);
            let found = match kind {
                SolverKind::Huber => {
                    Covariance::from_clipped_groups(block, &solution, 0.0, Workers::ONE)
                }
                _ => {
                    let ((rows, labels), one) = (grouped(block), Workers::ONE);
                    let rows = FittedGroups::from_rows(&rows, &labels, &solution, one).unwrap();
                    Covariance::from_fitted(&rows, None, solution.rows, one)
                }
            };
            let found = found.unwrap();
            let CoefficientCovariance::Groups { groups, factors, .. } = &found.coefficients else {
                panic!("by groups");
            };
            assert_eq!(*groups, 30);
            assert!(found.intervals.as_ref().unwrap().factors(0.95).is_ok());
            factors[0].iter().map(|column| column[0] * column[0]).sum::<f64>().sqrt()
        };
        let clean = wild_block(30, 0.0);
        let ratio = errors(&clean, SolverKind::Huber) / errors(&clean, SolverKind::RefinedTsqr);
        // For normal errors the variance is 1/0.95 times as large. Thirty groups determine it to some 13 %; both fits
        // use the same rows.
        assert!((0.8..1.3).contains(&ratio), "{ratio}");
        let wild = wild_block(30, 40.0);
        let ratio = errors(&wild, SolverKind::Huber) / errors(&clean, SolverKind::Huber);
        // With 5 % outliers the variance is 1.3 times as large (Huber 1964), for least squares some tens of times.
        assert!(ratio < 2.0, "{ratio}");
        assert!(errors(&wild, SolverKind::RefinedTsqr) > 3.0 * errors(&wild, SolverKind::Huber));
    }
}
