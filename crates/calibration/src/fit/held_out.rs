//! Rows of a fit, each converted by a model that was fitted without its group.

use std::collections::{BTreeSet, HashMap};

use super::evaluation::{GroupedErrors, errors_by_group};
use super::refits::{FOLDS, PolynomialProblem, fold_of_groups, solve};
use super::{Fit, FitMethod};
use crate::conversion::{Calibration, Kind};
use least_squares::error::FitError;
use least_squares::grouped_rows::{GroupedRows, Run};
use least_squares::passes::{Rows, Workers, map};
use sensor_physics::PhysicsCalibration;
use shell_data::block::Block;
use shell_data::dataset::{BLOCK_ROWS, LabelledBlock};
use shell_data::wrench::PerAxis;

#[derive(Clone, Debug)]
pub struct HeldOutModels {
    fold_of: HashMap<String, usize>,
    models: Vec<Calibration>,
}

impl HeldOutModels {
    /// For each fold by which `fit` was judged, fits the model again without that fold. `None` if there are no
    /// groups, or if rows have weights.
    ///
    /// # Errors
    /// [`FitError`] if the rows outside of a fold do not determine the model.
    pub fn new(fit: &Fit, workers: Workers<'_>) -> Result<Option<Self>, FitError> {
        let (rows, labels) = GroupedRows::from_labels(&fit.used);
        let folds = fit.cross_validation.as_ref().map_or(FOLDS, |found| found.folds);
        let folds = folds.min(labels.len());
        if fit.group_by.is_none() || folds < 2 || fit.used.has_weights() {
            return Ok(None);
        }
        let fold_of = fold_of_groups(&rows, folds)?;
        let models = match &fit.method {
            FitMethod::Polynomial { solution, solver, truncate } => {
                let (model, ridge) = (solution.model, solution.ridge);
                let problem =
                    PolynomialProblem { model, solver: *solver, ridge, truncate: *truncate };
                problem.without_each(&rows.regrouped(&fold_of), workers)?
            }
            FitMethod::Physics(physics) => {
                let without = |fold: &usize| {
                    let groups = fold_of.iter().enumerate().filter(|(_, of)| **of == *fold);
                    let groups: BTreeSet<u64> = groups.map(|(group, _)| group as u64).collect();
                    let model = PhysicsCalibration::new(physics.choice.without(&groups), [1.0; 6]);
                    Ok(Calibration::from_kind(Kind::Physics(Box::new(model))))
                };
                map(&(0..folds).collect::<Vec<_>>(), workers, without)?
            }
        };
        Ok(Some(Self { fold_of: labels.into_iter().zip(fold_of).collect(), models }))
    }

    /// Converts the rows of a block of the fit, N and N·m.
    pub fn wrench(&self, block: &LabelledBlock, wrench: &mut PerAxis<Vec<f64>>) {
        wrench.iter_mut().for_each(Vec::clear);
        let (mut start, mut part) = (0, PerAxis::default());
        for (label, rows) in block.labels.iter().filter(|(_, rows)| *rows > 0) {
            let mut run = Block::default();
            run.append(&block.rows, start..start + rows);
            start += rows;
            self.models[self.fold_of[label]].wrench(&run.readings, &mut part);
            wrench.iter_mut().zip(&part).for_each(|(all, part)| all.extend(part));
        }
    }

    /// Errors on each group, and the loads of about `sample` rows.
    ///
    /// # Errors
    /// [`FitError::Interrupted`].
    pub fn errors(
        &self,
        fit: &Fit,
        sample: u64,
        workers: Workers<'_>,
    ) -> Result<GroupedErrors, FitError> {
        errors_by_group(|block, wrench| self.wrench(block, wrench), &fit.used, sample, workers)
    }
}

impl PolynomialProblem {
    fn without_each(
        &self,
        groups: &GroupedRows,
        workers: Workers<'_>,
    ) -> Result<Vec<Calibration>, FitError> {
        let copy = |runs: &[Run]| groups.copied(runs, BLOCK_ROWS).collect::<Vec<Block>>();
        let copies: Vec<Vec<Block>> = groups.groups().map(copy).collect();
        let sample = groups.sample();
        let fit = |&position: &usize| {
            let one = Workers { threads: 1, ..workers };
            let kept = copies.iter().enumerate().filter(|(at, _)| *at != position);
            let rows = Rows::from_blocks(kept.flat_map(|(_, blocks)| blocks), one);
            let solved = solve(self, None, &rows, Some(&sample))?;
            Ok(Calibration::from_solution(&solved.solution, &solved.ranges))
        };
        map(&(0..copies.len()).collect::<Vec<_>>(), workers, fit)
    }
}
