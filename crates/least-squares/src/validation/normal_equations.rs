//! Held-out errors from the normal equations of each fold, for rows that cannot be summed exactly.
//!
//! The sum of `[X | W]ᵀ[X | W]` over other folds gives the fit without a fold, for any ridge. Its errors on
//! the fold are
//!
//! ```text
//! ‖X_f·C − W_f‖² = W_fᵀW_f − 2·Cᵀ·X_fᵀW_f + Cᵀ·X_fᵀX_f·C
//! ```
//!
//! A choice needs errors with three digits. Condition numbers up to 10⁶, with columns scaled to norm one, leave that
//! many. The final fit never uses this method.

use std::collections::HashMap;

use crate::error::FitError;
use faer::linalg::solvers::Solve;
use faer::{Accum, Mat, MatRef, Side};

use super::selection::{ErrorsByRidge, Tried, choose};
use crate::features::Features;
use crate::grouped_rows::{GroupedRows, Run, count};
use crate::held_out_errors::HeldOutErrors;
use crate::model::{Basis, Model};
use crate::passes::{Workers, map};
use crate::solver::ReadingSums;
use crate::vectors::lower_product;
use shell_data::wrench::{Axis, PerAxis};

/// Maximum number of features of a family: beyond it, the covariance, with eigenvalues for each group, takes minutes.
const MOST_FEATURES: usize = 600;

const CHUNK: usize = 1024;

/// Squares of pivots below this, with columns of norm one, are rounding errors.
const LEAST_PIVOT: f64 = 1e-13;

#[derive(Clone, Debug)]
struct NormalEquations {
    features: usize,
    rows: u64,
    products: Mat<f64>,
}

impl NormalEquations {
    fn new(features: &Features, rows: &GroupedRows, runs: &[Run]) -> Self {
        let columns = features.len() + Axis::ALL.len();
        let mut products = Mat::zeros(columns, columns);
        let mut flat = vec![0.0; CHUNK * columns];
        for block in rows.copied(runs, CHUNK) {
            features.fill(&block.readings, 0..block.rows, &mut flat, CHUNK);
            let axes = flat.chunks_mut(CHUNK).skip(features.len());
            for (column, axis) in axes.zip(&block.wrench) {
                column[..block.rows].copy_from_slice(axis);
            }
            let part =
                MatRef::from_column_major_slice_with_stride(&flat, block.rows, columns, CHUNK);
            lower_product(products.as_mut(), Accum::Add, part.transpose());
        }
        for j in 0..columns {
            (0..j).for_each(|i| products[(i, j)] = products[(j, i)]);
        }
        Self { features: features.len(), rows: count(runs) as u64, products }
    }

    fn part(&self, positions: &[usize]) -> Self {
        let axes = self.features..self.features + Axis::ALL.len();
        let kept: Vec<usize> = positions.iter().copied().chain(axes).collect();
        let products =
            Mat::from_fn(kept.len(), kept.len(), |i, j| self.products[(kept[i], kept[j])]);
        Self { features: positions.len(), rows: self.rows, products }
    }

    fn without_each(folds: &[Self]) -> Vec<Self> {
        let rows: u64 = folds.iter().map(|of| of.rows).sum();
        let products = sums_without_each(folds.iter().map(|of| &of.products));
        let of_rest = |(fold, products): (&Self, Mat<f64>)| Self {
            features: fold.features,
            rows: rows - fold.rows,
            products,
        };
        folds.iter().zip(products).map(of_rest).collect()
    }

    fn gram(&self) -> MatRef<'_, f64> {
        self.products.submatrix(0, 0, self.features, self.features)
    }

    fn right(&self) -> MatRef<'_, f64> {
        self.products.submatrix(0, self.features, self.features, Axis::ALL.len())
    }

    /// Coefficients, features × 6, with a ridge on columns of norm one, except `free`; `None` if undetermined.
    fn solve(&self, ridge: f64, free: Option<usize>) -> Option<Mat<f64>> {
        let p = self.features;
        if self.rows < p as u64 && ridge == 0.0 || !self.products.is_all_finite() {
            return None;
        }
        let norm = |j: usize| Some(self.products[(j, j)].sqrt()).filter(|norm| *norm > 0.0);
        let norms: Vec<f64> = (0..p).map(|j| norm(j).unwrap_or(1.0)).collect();
        let mut scaled = Mat::from_fn(p, p, |i, j| self.products[(i, j)] / norms[i] / norms[j]);
        for j in (0..p).filter(|&j| free != Some(j)) {
            scaled[(j, j)] += ridge;
        }
        let cholesky = scaled.llt(Side::Lower).ok()?;
        let lower = cholesky.L();
        if (0..p).any(|j| lower[(j, j)] * lower[(j, j)] < LEAST_PIVOT) {
            return None;
        }
        let right = Mat::from_fn(p, Axis::ALL.len(), |i, axis| self.right()[(i, axis)] / norms[i]);
        let mut solved = cholesky.solve(&right);
        for (i, norm) in norms.iter().enumerate() {
            solved.row_mut(i).iter_mut().for_each(|c| *c /= norm);
        }
        Some(solved)
    }

    /// Errors of `coefficients` on these rows. `ones` is the position of the constant feature.
    fn errors(&self, coefficients: MatRef<'_, f64>, ones: Option<usize>) -> PerAxis<HeldOutErrors> {
        let (p, explained) = (self.features, self.gram() * coefficients);
        std::array::from_fn(|axis| {
            let (own, of) = (coefficients.col(axis), self.right().col(axis));
            let square = self.products[(p + axis, p + axis)];
            let squares =
                square - 2.0 * (own.transpose() * of) + own.transpose() * explained.col(axis);
            let sum = ones.map_or(0.0, |ones| explained[(ones, axis)] - of[ones]);
            // Cancellation may leave a negative number, which is impossible for a sum of squares.
            HeldOutErrors { rows: self.rows, sum, squares: squares.max(0.0) }
        })
    }
}

/// Sums of all other matrices, for each one. Adding from both ends keeps rounding errors of a large one out of its sum.
pub fn sums_without_each<'a>(
    parts: impl DoubleEndedIterator<Item = &'a Mat<f64>> + ExactSizeIterator + Clone,
) -> Vec<Mat<f64>> {
    let zeros = |of: &Mat<f64>| Mat::zeros(of.nrows(), of.ncols());
    let mut sums: Vec<Mat<f64>> = Vec::with_capacity(parts.len());
    let mut before: Option<Mat<f64>> = None;
    for part in parts.clone() {
        let sum = before.get_or_insert_with(|| zeros(part));
        sums.push(sum.clone());
        *sum += part;
    }
    let mut after: Option<Mat<f64>> = None;
    for (sum, part) in sums.iter_mut().zip(parts).rev() {
        let behind = after.get_or_insert_with(|| zeros(part));
        *sum += &*behind;
        *behind += part;
    }
    sums
}

/// Positions of the terms of `part` among those of `whole`; `None` if `whole` lacks some.
fn positions(part: &Model, whole: &Model) -> Option<Vec<usize>> {
    let places: HashMap<_, _> = whole.terms().into_iter().zip(0..).collect();
    part.terms().iter().map(|term| places.get(term).copied()).collect()
}

/// Compares the families of features by errors on each held-out group, with `ridges` (and larger ones, as
/// [`select`](super::selection::select) does). `model` defines everything but the family.
///
/// # Errors
/// [`FitError`] if there are too few groups, a row is not finite, or no model can be fitted.
pub fn select(
    rows: &GroupedRows,
    model: Model,
    ridges: &[f64],
    workers: Workers<'_>,
) -> Result<Tried, FitError> {
    let groups: Vec<_> = rows.groups().collect();
    if groups.len() < 2 {
        return Err(FitError::TooFewGroups { found: groups.len() });
    }
    let sums = rows.all(workers).reduce(&ReadingSums::new(model.columns()))?;
    let scaling = sums.scaling(model.intercept);
    let model = |basis| Model { basis, ..model };
    let families = Basis::ALL.map(model).into_iter().filter(|of| of.term_count() <= MOST_FEATURES);
    // From the largest on, each family that is not part of an earlier one.
    let mut summed: Vec<(Model, Vec<NormalEquations>)> = Vec::new();
    for family in families.rev() {
        if summed.iter().all(|(larger, _)| positions(&family, larger).is_none()) {
            let features = Features::new(family, scaling.clone());
            let equations =
                map(&groups, workers, |runs| Ok(NormalEquations::new(&features, rows, runs)))?;
            summed.push((family, equations));
        }
    }
    let errors_of = |basis: Basis| -> Option<ErrorsByRidge<'_>> {
        let model = model(basis);
        let of_larger = |(larger, folds): &(Model, Vec<NormalEquations>)| {
            let positions = positions(&model, larger)?;
            Some(folds.iter().map(|of| of.part(&positions)).collect())
        };
        let folds: Vec<NormalEquations> = summed.iter().find_map(of_larger)?;
        let rests = NormalEquations::without_each(&folds);
        let pairs: Vec<_> = folds.into_iter().zip(rests).collect();
        let ones = model.intercept.then(|| model.term_count() - 1);
        Some(Box::new(move |ridge| {
            let errors = |(fold, rest): &(NormalEquations, NormalEquations)| {
                let coefficients = rest.solve(ridge, ones);
                Ok(coefficients.map(|of| fold.errors(of.as_ref(), ones)))
            };
            map(&pairs, workers, errors).ok()?.into_iter().collect()
        }))
    };
    let variances = Axis::ALL.map(|axis| {
        let all = rows.spread(&rows.runs, axis.index());
        all.squares / all.count.max(1) as f64
    });
    choose(model, ridges, variances, errors_of)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::validation::grouped::{Apart, GroupSums, RandomSplit};
    use crate::validation::selection;
    use shell_data::block::Block;
    use shell_data::dataset::Dataset;
    use shell_data::wrench::Axes;
    use system_tests::random::Random;

    fn noise(i: usize) -> f64 {
        2.0 * Random(i as u64).unit() - 1.0
    }

    #[test]
    fn sums_without_each_matrix_beside_a_large_one_are_exact() {
        let parts = [1.0, 2f64.powi(80), 2.0, 4.0].map(|part| Mat::from_fn(1, 1, |_, _| part));
        let sums: Vec<f64> =
            sums_without_each(parts.iter()).iter().map(|sum| sum[(0, 0)]).collect();
        // Subtracting the large one from the sum would give 0: the others are below half its last digit.
        assert_eq!(sums, [2f64.powi(80), 7.0, 2f64.powi(80), 2f64.powi(80)]);
    }

    #[test]
    fn errors_equal_those_of_exact_sums() {
        let fold = |group: usize| -> Block {
            let rows = 40 + group;
            let of = |column: usize, row: usize| noise(group * 4000 + row * 31 + column);
            let reading =
                |c: usize| (0..rows).map(|row| (1500.0 + 700.0 * of(c, row)).round()).collect();
            let readings: Vec<Vec<f64>> = (0..3).map(reading).collect();
            let load = |axis: usize, row: usize| {
                let s = |c: usize| (readings[c][row] - 1500.0) / 700.0;
                s(axis % 3) + 0.3 * s(0) * s(2) - 0.2 * s(1).powi(3) + 0.1 * of(9 + axis, row)
            };
            let wrench =
                (0..6).map(|axis| (0..rows).map(|row| load(axis, row)).collect()).collect();
            let groups = vec![(group.to_string(), rows)];
            Block { rows, wrench, readings, groups, ..Block::default() }
        };
        let folds: Vec<Block> = (0..7).map(fold).collect();
        let mut sums = GroupSums::new(Basis::Poly3, 3, Apart::Groups, RandomSplit::default());
        let mut worker = sums.worker();
        for fold in &folds {
            sums.add(worker.add(fold, &fold.groups).unwrap()).unwrap();
        }
        let sums = sums.finish([worker]).unwrap();
        let ridges = [0.0, 1e-6, 1e-2];
        let exact = selection::select(&sums, true, &ridges).unwrap().selection;
        let model = Model { basis: Basis::Poly3, intercept: true, channels: 3, memory: 0 };
        let of = |folds: Vec<Block>| {
            GroupedRows::from_labels(&Dataset::from_blocks("folds", Axes::ALL, folds)).0
        };
        let one = of(folds[..1].to_vec());
        let tried = select(&of(folds), model, &ridges, Workers::ONE).unwrap();
        let total = HeldOutErrors::total(tried.chosen_errors());
        let found = tried.selection;
        assert_eq!(total.map(|of| of.rms()), found.candidates[found.chosen].errors.unwrap().rms);
        assert_eq!((found.folds, found.best, found.chosen), (7, exact.best, exact.chosen));
        assert_eq!(found.candidates.len(), exact.candidates.len());
        for (found, exact) in found.candidates.iter().zip(&exact.candidates) {
            let (found, exact) = (found.errors.unwrap(), exact.errors.unwrap());
            // Condition numbers below 100, squared in double precision.
            assert!((found.score / exact.score - 1.0).abs() < 1e-9, "{found:?} {exact:?}");
            assert!((found.standard_error / exact.standard_error - 1.0).abs() < 1e-7);
            let pairs = found.rms.iter().zip(exact.rms);
            assert!(pairs.clone().all(|(a, b)| (a / b - 1.0).abs() < 1e-9), "{found:?} {exact:?}");
        }
        let few = select(&one, model, &ridges, Workers::ONE).unwrap_err();
        assert_eq!(few, FitError::TooFewGroups { found: 1 });
    }
}
