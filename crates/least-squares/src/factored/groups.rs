use std::collections::HashMap;

use super::rows::FactoredRows;
use crate::error::FitError;
use crate::grouped_rows::MAX_GROUPS;
use crate::grouped_rows::{GroupedRows, Run};
use crate::model::Model;
use crate::passes::{Workers, map};
use crate::scaling::Scaling;
use shell_data::block::Block;

const MEMORY: usize = 512 << 20;

/// R factors of groups, in the order of their first rows.
#[derive(Clone, Debug, PartialEq)]
pub struct FactoredGroups {
    pub groups: Vec<(String, FactoredRows)>,
}

/// Groups under construction. Rows are factored in batches of fixed size, so results do not depend on block lengths.
#[derive(Debug)]
pub struct GroupFactors {
    empty: FactoredRows,
    groups: Vec<Group>,
    positions: HashMap<String, usize>,
}

#[derive(Debug)]
struct Group {
    label: String,
    rows: FactoredRows,
    waiting: Block,
}

impl GroupFactors {
    /// Starts with no groups; features as in [`FactoredRows::new`].
    pub fn new(model: Model, scaling: Scaling) -> Self {
        let empty = FactoredRows::new(model, scaling);
        Self { empty, groups: Vec::new(), positions: HashMap::new() }
    }

    pub fn group_count(&self) -> usize {
        self.groups.len()
    }

    /// # Errors
    /// [`FitError`] if there are too many groups, or a row that cannot be fitted.
    pub fn add(&mut self, block: &Block, labels: &[(String, usize)]) -> Result<(), FitError> {
        let (mut start, at_once) = (0, self.empty.r_factor.block_rows());
        for (label, rows) in labels {
            let position = self.position(label)?;
            let (group, end) = (&mut self.groups[position], start + rows);
            while start < end {
                let room = at_once - group.waiting.rows;
                let part = start..end.min(start + room);
                start = part.end;
                group.waiting.append(block, part);
                if group.waiting.rows == at_once {
                    group.settle()?;
                }
            }
        }
        Ok(())
    }

    fn position(&mut self, label: &str) -> Result<usize, FitError> {
        if let Some(&position) = self.positions.get(label) {
            return Ok(position);
        }
        let position = self.groups.len();
        check_group_count(position + 1, self.empty.r_factor.whole().ncols())?;
        let group =
            Group { label: label.to_owned(), rows: self.empty.clone(), waiting: Block::default() };
        self.groups.push(group);
        self.positions.insert(label.to_owned(), position);
        Ok(position)
    }

    /// # Errors
    /// [`FitError`] if a row cannot be fitted.
    pub fn finish(mut self) -> Result<FactoredGroups, FitError> {
        for group in self.groups.iter_mut().filter(|group| group.waiting.rows > 0) {
            group.settle()?;
        }
        let groups = self.groups.into_iter().map(|group| (group.label, group.rows)).collect();
        Ok(FactoredGroups { groups })
    }
}

impl Group {
    fn settle(&mut self) -> Result<(), FitError> {
        self.rows.absorb(&std::mem::take(&mut self.waiting))
    }
}

/// # Errors
/// [`FitError::TooManyGroups`] if matrices of this order for that many groups take too much memory.
pub(crate) fn check_group_count(groups: usize, order: usize) -> Result<(), FitError> {
    let limit = MAX_GROUPS.min(MEMORY / (order * order * size_of::<f64>()));
    if groups > limit {
        return Err(FitError::TooManyGroups { limit });
    }
    Ok(())
}

impl FactoredGroups {
    /// Factors groups of rows in memory, each with its label; features as in [`FactoredRows::new`].
    ///
    /// # Errors
    /// As [`GroupFactors::add`]; [`FitError::Interrupted`].
    pub fn from_rows(
        rows: &GroupedRows,
        labels: Vec<String>,
        (model, scaling): (Model, Scaling),
        workers: Workers<'_>,
    ) -> Result<Self, FitError> {
        let empty = FactoredRows::new(model, scaling);
        check_group_count(labels.len(), empty.r_factor.whole().ncols())?;
        let factor = |runs: &&[Run]| {
            let mut factored = empty.clone();
            let mut blocks = rows.copied(runs, empty.r_factor.block_rows());
            blocks.try_for_each(|block| factored.absorb(&block))?;
            Ok(factored)
        };
        let factored = map(&rows.groups().collect::<Vec<_>>(), workers, factor)?;
        Ok(Self { groups: labels.into_iter().zip(factored).collect() })
    }

    /// R factor of all groups together; `None` if there are no groups.
    pub fn total(&self) -> Option<FactoredRows> {
        FactoredRows::merged(self.groups.iter().map(|(_, rows)| rows))
    }

    /// Merges, for each group, all other groups; `None` with fewer than two. It subtracts nothing, and takes fewer
    /// than three merges per group.
    pub fn without_each(&self) -> Option<Vec<FactoredRows>> {
        let merged = |earlier: &FactoredRows, later: &FactoredRows| {
            let mut all = earlier.clone();
            all.merge(later);
            all
        };
        let rows = |group: usize| &self.groups[group].1;
        let last = self.groups.len().checked_sub(1).filter(|&last| last > 0)?;
        let mut after = vec![rows(last).clone()];
        for group in (1..last).rev() {
            after.push(merged(rows(group), &after[after.len() - 1]));
        }
        let mut before = rows(0).clone();
        let mut others: Vec<FactoredRows> = after.pop().into_iter().collect();
        for group in 1..last {
            others.extend(after.pop().map(|after| merged(&before, &after)));
            before.merge(rows(group));
        }
        others.push(before);
        Some(others)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::factored::GroupFactors;
    use crate::features::Features;
    use crate::fitted_groups::FittedGroups;
    use crate::model::{Basis, Model};
    use crate::passes::Workers;
    use crate::scaling::Scaling;
    use crate::solution::Solution;
    use crate::solver::{self, FitProblem, SolverKind};
    use crate::uncertainty::Covariance;
    use faer::{Mat, Side};
    use shell_data::block::Block;
    use system_tests::random::Random;

    /// Groups of one to seven rows, fewer than features, with similar errors within a group. The second channel is
    /// the first plus noise of size `apart`.
    fn block(apart: f64) -> Block {
        let mut random = Random(16);
        let mut noise = |scale: f64| scale * (2.0 * random.unit() - 1.0);
        let sizes: Vec<usize> = (0..40).map(|group| 1 + group * 5 % 7).collect();
        let (mut readings, mut wrench) = (vec![Vec::new(); 2], vec![Vec::new(); 6]);
        for &rows in &sizes {
            let (position, common) = (noise(1.0), [(); 6].map(|()| noise(0.3)));
            for _ in 0..rows {
                let first = 1.3 + position + noise(0.2);
                readings[0].push(first);
                readings[1].push(first + noise(apart));
                for (axis, column) in wrench.iter_mut().enumerate() {
                    column.push(first * (1.0 + axis as f64) + common[axis] + noise(0.1));
                }
            }
        }
        let rows = readings[0].len();
        let groups = sizes.iter().enumerate().map(|(i, &rows)| (i.to_string(), rows)).collect();
        Block { rows, readings, wrench, groups, ..Block::default() }
    }

    fn model_of(basis: Basis) -> Model {
        Model { basis, intercept: true, channels: 2, memory: 0 }
    }

    fn fitted(block: &Block, model: Model) -> (Solution, FactoredGroups) {
        let scaling = Scaling::from_sample(&block.readings, model.intercept);
        let problem = FitProblem { model, scaling, ridge: 0.0 };
        let (solution, _) = solver::fit(SolverKind::RefinedTsqr, problem, &block.into()).unwrap();
        let scaling = Scaling::from_sample(&block.readings, true);
        let mut groups = GroupFactors::new(model, scaling);
        groups.add(block, &block.groups).unwrap();
        (solution, groups.finish().unwrap())
    }

    /// Variances of predictions and products of residuals from singular values, which are accurate for any condition.
    fn dense(x: &Mat<f64>, block: &Block) -> (Vec<Mat<f64>>, Mat<f64>) {
        let (n, svd) = (x.nrows(), x.thin_svd().unwrap());
        let u = svd.U();
        let y = Mat::from_fn(n, 6, |row, axis| block.wrench[axis][row]);
        let e = &y - u * (u.transpose() * &y);
        let mut variances = vec![Mat::zeros(n, n); 6];
        let (mut products, mut start) = (Mat::zeros(6, 6), 0);
        for (_, rows) in &block.groups {
            let (ug, eg) = (u.subrows(start, *rows), e.subrows(start, *rows));
            let rest = Mat::<f64>::identity(*rows, *rows) - ug * ug.transpose();
            let eigen = rest.self_adjoint_eigen(Side::Lower).unwrap();
            let power = |exponent: f64| {
                let values = eigen.S().column_vector();
                let scaled =
                    Mat::from_fn(*rows, *rows, |i, j| eigen.U()[(i, j)] * values[j].powf(exponent));
                scaled * eigen.U().transpose()
            };
            let v = u * (ug.transpose() * (power(-0.5) * eg));
            for (axis, variances) in variances.iter_mut().enumerate() {
                *variances += v.col(axis) * v.col(axis).transpose();
            }
            products += eg.transpose() * (power(-1.0) * eg);
            start += rows;
        }
        (variances, products)
    }

    #[test]
    fn r_factors_give_the_same_results_as_rows_by_definition() {
        for (basis, intercept, apart) in [
            (Basis::Cubic, true, 0.5),
            (Basis::Quadratic, false, 0.5),
            (Basis::Linear, true, 1e-4),
            (Basis::Linear, true, 1e-7),
            (Basis::Linear, true, 1e-10),
        ] {
            let block = block(apart);
            let model = Model { basis, intercept, channels: 2, memory: 0 };
            let (solution, groups) = fitted(&block, model);
            let features = Features::new(model, solution.scaling.clone());
            let (n, p) = (block.rows, features.len());
            let mut columns = vec![0.0; n * p];
            features.fill(&block.readings, 0..n, &mut columns, n);
            let x = Mat::from_fn(n, p, |row, j| columns[j * n + row]);
            let (variances, products) = dense(&x, &block);
            let groups = FittedGroups::from_factors(&groups, &solution, Workers::ONE).unwrap();
            let found = groups.scatter(true, Workers::ONE).unwrap();
            assert_eq!(found.groups, 40);
            // Both sides find the directions of the features to ε·κ; a hundred covers the sums of rounding errors.
            let tolerance = 100.0 * f64::EPSILON * solution.condition + 1e-12;
            assert!(apart > 1e-9 || solution.condition > 1e9, "{}", solution.condition);
            for axis in 0..6 {
                let spread = &x * &found.factors[axis];
                for row in 0..n {
                    let variance = spread.row(row).squared_norm_l2();
                    let ratio = variance / variances[axis][(row, row)];
                    assert!((ratio - 1.0).abs() < tolerance, "{basis:?} {apart} {ratio}");
                }
                for b in 0..6 {
                    let difference = found.residual_products[axis][b] - products[(axis, b)];
                    assert!(difference.abs() < tolerance * products.norm_max(), "{axis} {b}");
                }
            }
        }
    }

    #[test]
    fn merged_r_factors_equal_that_of_all_rows_for_any_centre() {
        let block = block(0.5);
        let half = block.rows / 2;
        let part = |first: bool, centre: f64| {
            let is_in = |row: usize| (row < half) == first;
            let part = block.kept(&(0..block.rows).map(is_in).collect::<Vec<_>>());
            let scaling = Scaling { centre: vec![centre; 2], scale: vec![0.5; 2] };
            let mut rows = FactoredRows::new(model_of(Basis::Poly3), scaling);
            rows.absorb(&part).unwrap();
            rows
        };
        let mut merged = part(true, 1.25);
        merged.merge(&part(false, 3.0));
        assert_eq!(merged.rows(), block.rows as u64);
        for (basis, intercept) in [
            (Basis::Poly3, true),
            (Basis::Cubic, true),
            (Basis::Linear, true),
            (Basis::Linear, false),
        ] {
            let model = Model { basis, intercept, channels: 2, memory: 0 };
            let (expected, _) = fitted(&block, model);
            let found = merged.solve(&model, 0.0).unwrap();
            assert_eq!(found.scaling, expected.scaling, "about the mean of all rows");
            // Condition numbers below 1e3 with either centre.
            let difference = (&found.coefficients - &expected.coefficients).norm_max();
            assert!(
                difference < 1e-11 * expected.coefficients.norm_max(),
                "{basis:?} {difference}"
            );
            let quality = merged.quality(&found).unwrap();
            for (axis, found) in quality.into_iter().enumerate() {
                let rms = (expected.residual_products[(axis, axis)] / block.rows as f64).sqrt();
                assert!((found.rms / rms - 1.0).abs() < 1e-11);
                let column = &block.wrench[axis];
                let mean = column.iter().sum::<f64>() / block.rows as f64;
                let total = column.iter().map(|w| (w - mean).powi(2)).sum::<f64>();
                let r_squared = 1.0 - rms * rms * block.rows as f64 / total;
                assert!((found.r_squared.unwrap() - r_squared).abs() < 1e-11);
            }
        }
        let larger = Model { basis: Basis::Poly3, intercept: true, channels: 3, memory: 0 };
        assert!(merged.solve(&larger, 0.0).is_err());
    }

    #[test]
    fn a_group_that_alone_moves_a_channel_is_named_and_one_group_is_too_few() {
        let mut block = block(0.5);
        let alone: Vec<bool> = (block.groups.iter().enumerate())
            .flat_map(|(group, (_, rows))| std::iter::repeat_n(group == 4, *rows))
            .collect();
        for (reading, alone) in block.readings[1].iter_mut().zip(alone) {
            *reading = if alone { *reading } else { 1.0 };
        }
        let model = Model { basis: Basis::Linear, intercept: true, channels: 2, memory: 0 };
        let (solution, mut groups) = fitted(&block, model);
        let refused = |groups: &FactoredGroups| {
            let groups = FittedGroups::from_factors(groups, &solution, Workers::ONE).unwrap();
            Covariance::from_fitted(&groups, None, solution.rows, Workers::ONE).unwrap_err()
        };
        assert_eq!(refused(&groups), FitError::Alone { groups: vec!["4".to_owned()] });
        groups.groups.truncate(1);
        assert_eq!(refused(&groups), FitError::TooFewGroups { found: 1 });
    }

    #[test]
    fn blocks_of_any_length_give_the_same_bits() {
        let all = block(0.5);
        let mut scattered = GroupFactors::new(model_of(Basis::Cubic), Scaling::identity(2));
        let mut whole = GroupFactors::new(model_of(Basis::Cubic), Scaling::identity(2));
        for _ in 0..40 {
            whole.add(&all, &all.groups).unwrap();
            for start in (0..all.rows).step_by(11) {
                let is_in = |row: usize| (start..start + 11).contains(&row);
                let part = all.kept(&(0..all.rows).map(is_in).collect::<Vec<_>>());
                scattered.add(&part, &part.groups).unwrap();
            }
        }
        assert_eq!(scattered.finish().unwrap(), whole.finish().unwrap());
    }
}
