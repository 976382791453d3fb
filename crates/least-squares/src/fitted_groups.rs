//! Groups of rows relative to a fit of all rows: [scatter](crate::sandwich) of coefficients, and fits without groups.
//!
//! The fit has the factor `F`, `F·Fᵀ = (XᵀX + Λ)⁻¹`. Without a ridge, `M = X·F` has orthonormal columns. A group has
//!
//! ```text
//! M_g = X_g·F    E_g = W_g − X_g·C    K_g = M_gᵀM_g    u_g = M_gᵀE_g
//! ```
//!
//! and the coefficients without it, with the same penalties Λ, are `C − F·(I − K_g)⁻¹·u_g`. No other pass over the rows
//! is needed. For any features, errors of these equations grow with κ(X), as the errors of `M` do, not with its square.

use std::ops::Range;

use faer::linalg::matmul::triangular::{BlockStructure, matmul};
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::{Accum, Mat, MatRef, Par};

use crate::error::FitError;
use crate::factored::{FactoredGroups, FactoredRows, check_group_count};
use crate::features::Features;
use crate::grouped_rows::{GroupedRows, Run, count};
use crate::held_out_errors::HeldOutErrors;
use crate::passes::{Workers, map, on_threads};
use crate::sandwich::{ALONE, GroupScatter, Part, ScatterSums, corrected, corrected_rows, gram};
use crate::satterthwaite;
use crate::solution::Solution;
use crate::symmetric::{SymmetricMatrix, UpperTriangle, add_multiple, congruence, product};
use crate::uncertainty::{GroupScore, score_of};
use shell_data::block::Block;
use shell_data::wrench::{Axis, PerAxis};

/// Number of rows whose features are computed together, or the number of features if that is more.
const CHUNK: usize = 1024;

#[derive(Debug)]
pub struct FittedGroups<'a> {
    solution: &'a Solution,
    groups: Vec<FittedGroup>,
}

#[derive(Debug)]
struct FittedGroup {
    label: String,
    rows: u64,
    share: Share,
    /// `M_gᵀ·1`.
    column_sums: Vec<f64>,
    /// `E_gᵀ·1`.
    sums: PerAxis<f64>,
    /// `E_gᵀE_g`.
    products: Mat<f64>,
}

/// `K_g` and `u_g`, or a smaller matrix that determines them.
#[derive(Debug)]
enum Share {
    /// `M_g` and `E_g`, or an orthogonal transformation of both, with fewer rows than features.
    Rows { features: Mat<f64>, errors: Mat<f64> },
    /// `K_g` and `u_g`.
    Products { gram: SymmetricMatrix, scores: Mat<f64> },
}

struct FitWithout {
    /// `U` with `UᵀU = I − K`: the factor of this fit is `F·U⁻¹`.
    root: UpperTriangle,
    /// Change of the coefficients, in units of `F`: features × 6.
    change: Mat<f64>,
    residual_products: Mat<f64>,
}

impl<'a> FittedGroups<'a> {
    /// # Errors
    /// [`FitError::TooManyGroups`] if they take too much memory; [`FitError::Interrupted`].
    pub fn from_rows(
        rows: &GroupedRows,
        labels: &[String],
        solution: &'a Solution,
        workers: Workers<'_>,
    ) -> Result<Self, FitError> {
        let features = Features::new(solution.model, solution.scaling.clone());
        check_group_count(labels.len(), features.len() + Axis::ALL.len())?;
        let reduce = |(runs, label): &(&[Run], &String)| {
            let at_once = CHUNK.max(features.len());
            let mut group = FittedGroup::new((*label).clone(), count(runs), features.len());
            rows.copied(runs, at_once)
                .for_each(|block| group.add_block(&block, &features, solution));
            Ok(group)
        };
        let groups: Vec<_> = rows.groups().zip(labels).collect();
        Ok(Self { solution, groups: map(&groups, workers, reduce)? })
    }

    /// # Errors
    /// [`FitError::NearlyDependent`] if the R factors lack features of the solution.
    pub fn from_factors(
        rows: &FactoredGroups,
        solution: &'a Solution,
        workers: Workers<'_>,
    ) -> Result<Self, FitError> {
        let convert = |(label, rows): &(String, FactoredRows)| {
            let change = rows.change(&solution.model, &solution.scaling);
            let change = change.ok_or(FitError::NearlyDependent)?;
            let (r, z) = rows.r_factor.significant_rows();
            let (x, coefficients) = (&r * &change, &change * &solution.coefficients);
            let mut group = FittedGroup::new(label.clone(), rows.rows() as usize, x.ncols());
            let errors = z - &r * &coefficients;
            let ones: Vec<f64> = r.col(r.ncols() - 1).iter().copied().collect();
            group.add(x.as_ref(), errors, &ones, solution);
            group.products = rows.r_factor.residual_products(coefficients.as_ref());
            Ok(group)
        };
        Ok(Self { solution, groups: map(&rows.groups, workers, convert)? })
    }

    pub fn count(&self) -> usize {
        self.groups.len()
    }

    /// Scatter of the coefficients over the groups, without the bias from a ridge or a truncation.
    ///
    /// # Errors
    /// [`FitError`] if some group alone determines a coefficient, or the features are too nearly dependent.
    pub fn scatter(
        &self,
        with_degrees: bool,
        workers: Workers<'_>,
    ) -> Result<GroupScatter, FitError> {
        let combinations =
            if with_degrees { satterthwaite::coefficients(self.solution) } else { Vec::new() };
        let mut sums = ScatterSums::new(self.solution, combinations.len());
        let adds_up = sums.defect.is_some();
        let groups: Vec<_> = self.groups.iter().filter(|group| group.rows > 0).collect();
        let mut added = groups.iter();
        let work = |(): &mut (), group: &&FittedGroup| group.share.part(adds_up, &combinations);
        let add = |(share, part): (Option<SymmetricMatrix>, Option<Part>)| {
            share.iter().for_each(|share| sums.take_off(share));
            let group = added.next().expect("a result for each group");
            sums.add(&group.label, part, &group.errors());
            Ok(())
        };
        on_threads(&groups, |_| 0, workers, || (), work, add)?;
        sums.finish(&UpperTriangle::new(&self.solution.factor))
    }

    pub(crate) fn errors(&self, group: usize) -> PerAxis<HeldOutErrors> {
        self.groups[group].errors()
    }

    /// Mean variance of predictions on a group, if the coefficients scatter as in `scatter`.
    pub(crate) fn variance(&self, group: usize, scatter: &GroupScatter) -> PerAxis<f64> {
        let FittedGroup { share, rows, .. } = &self.groups[group];
        share.variance(scatter, *rows)
    }

    /// Mean and scatter of a group's errors, in standard errors of the fit to all others; `None` without such a fit.
    pub(crate) fn score_without(&self, held_out: usize) -> Option<GroupScore> {
        let group = &self.groups[held_out];
        let without = self.without(held_out..held_out + 1, group.share.gram())?;
        let mut sums = ScatterSums::of_products(&without.residual_products);
        let inverse = without.root.clone().inverse();
        for (position, other) in self.groups.iter().enumerate() {
            if position != held_out && other.rows > 0 {
                let (_, part) = without.share(&other.share, &inverse).part(false, &[]).ok()?;
                sums.add(&other.label, part, &other.errors_after(&without.change));
            }
        }
        let size = self.solution.factor.nrows();
        let identity = UpperTriangle::from_fn(size, |i, j| f64::from(u8::from(i == j)));
        let scatter = sums.finish(&identity).ok()?;
        let variance = without.share(&group.share, &inverse).variance(&scatter, group.rows);
        let errors = group.errors_after(&without.change);
        Some(score_of(&errors, &variance, &scatter, self.solution.rows - group.rows))
    }

    /// Scores of the groups of each file, like [`score_without`](Self::score_without), but from the fit without the
    /// file and in standard errors of the fit to all rows.
    pub(crate) fn scores_of_files(
        &self,
        files: &[Range<usize>],
        scatter: &GroupScatter,
        workers: Workers<'_>,
    ) -> Option<Vec<Vec<GroupScore>>> {
        let size = self.solution.factor.nrows();
        let squares = scatter.scores.each_ref().map(|scores| {
            gram(Mat::from_fn(size, scores.len(), |i, group| scores[group][i]).as_ref())
        });
        let of_file = |file: &Range<usize>| {
            let mut shares = SymmetricMatrix::zeros(size);
            let mut variances = Vec::with_capacity(file.len());
            for group in &self.groups[file.clone()] {
                let (share, rows) = (group.share.gram(), group.rows.max(1) as f64);
                variances.push(squares.each_ref().map(|of| share.trace_of_product(of) / rows));
                shares.add(&share);
            }
            let without = self.without(file.clone(), shares);
            let score = |(group, variance): (&FittedGroup, PerAxis<f64>)| {
                let errors = group.errors_after(&without.as_ref()?.change);
                Some(score_of(&errors, &variance, scatter, self.solution.rows))
            };
            let groups = self.groups[file.clone()].iter().zip(variances);
            Ok(groups.map(score).collect::<Option<Vec<_>>>())
        };
        map(files, workers, of_file).ok()?.into_iter().collect()
    }

    /// Fit without some groups, whose `K_g` add up to `shares`; `None` if the others do not determine it.
    fn without(&self, groups: Range<usize>, shares: SymmetricMatrix) -> Option<FitWithout> {
        let size = shares.size;
        let mut scores = Mat::zeros(size, Axis::ALL.len());
        let mut residual_products = self.solution.residual_products.clone();
        for group in &self.groups[groups] {
            scores += group.share.scores();
            residual_products -= &group.products;
        }
        let mut left = SymmetricMatrix::identity(size);
        (0..size).for_each(|i| add_multiple(left.row_mut(i), -1.0, shares.row(i)));
        let root = left.cholesky()?;
        if (0..size).any(|i| root.row(i)[0].powi(2) < ALONE) {
            return None;
        }
        let change = -by_column(&scores, |score| root.solve(score));
        residual_products += scores.transpose() * &change;
        Some(FitWithout { root, change, residual_products })
    }
}

impl Solution {
    /// Solution without some of its rows, with condition and rank unchanged; `None` if too few digits would remain.
    pub fn without(&self, rows: &Block) -> Option<Self> {
        let features = Features::new(self.model, self.scaling.clone());
        let mut group = FittedGroup::new(String::new(), rows.rows, features.len());
        group.add_block(rows, &features, self);
        let share = group.share.gram();
        let fitted = FittedGroups { solution: self, groups: vec![group] };
        let FitWithout { root, change, residual_products } = fitted.without(0..1, share)?;
        let (mut factor, root) = (self.factor.clone(), root.matrix());
        let columns = factor.as_mut().transpose_mut();
        solve_lower_triangular_in_place(root.transpose(), columns, Par::Seq);
        Some(Self {
            coefficients: &self.coefficients + &self.factor * change,
            factor,
            residual_products,
            rows: self.rows - rows.rows as u64,
            scaling: self.scaling.clone(),
            ..*self
        })
    }
}

impl FittedGroup {
    fn new(label: String, rows: usize, features: usize) -> Self {
        let (rows, axes) = (rows as u64, Axis::ALL.len());
        let share = Share::Rows { features: Mat::zeros(0, features), errors: Mat::zeros(0, axes) };
        let (column_sums, products) = (vec![0.0; features], Mat::zeros(axes, axes));
        Self { label, rows, share, column_sums, sums: [0.0; 6], products }
    }

    fn add_block(&mut self, block: &Block, features: &Features, solution: &Solution) {
        let (rows, columns) = (block.rows, features.len());
        let mut flat = vec![0.0; rows * columns];
        features.fill(&block.readings, 0..rows, &mut flat, rows);
        let x = MatRef::from_column_major_slice(&flat, rows, columns);
        let loads = Mat::from_fn(rows, Axis::ALL.len(), |row, axis| block.wrench[axis][row]);
        let errors = loads - x * &solution.coefficients;
        self.add(x, errors, &vec![1.0; rows], solution);
    }

    /// Adds rows with features `x`, `errors` and a column `ones`, or an orthogonal transformation of all three.
    fn add(&mut self, x: MatRef<'_, f64>, errors: Mat<f64>, ones: &[f64], solution: &Solution) {
        use BlockStructure::{Rectangular, TriangularUpper};
        let mut features = Mat::zeros(x.nrows(), x.ncols());
        let factor = solution.factor.as_ref();
        let to = features.as_mut();
        matmul(
            to,
            Rectangular,
            Accum::Replace,
            x,
            Rectangular,
            factor,
            TriangularUpper,
            1.0,
            Par::Seq,
        );
        self.products += errors.transpose() * &errors;
        let sum = |column: faer::ColRef<'_, f64>| -> f64 {
            column.iter().zip(ones).map(|(x, one)| x * one).sum()
        };
        for (total, column) in self.sums.iter_mut().zip(errors.col_iter()) {
            *total += sum(column);
        }
        for (total, column) in self.column_sums.iter_mut().zip(features.col_iter()) {
            *total += sum(column);
        }
        match &mut self.share {
            Share::Rows { features: rows, .. } if x.nrows() < x.ncols() && rows.nrows() == 0 => {
                self.share = Share::Rows { features, errors };
            }
            Share::Rows { .. } => {
                let scores = features.transpose() * &errors;
                self.share = Share::Products { gram: gram(features.transpose()), scores };
            }
            Share::Products { gram: all, scores } => {
                all.add(&gram(features.transpose()));
                *scores += features.transpose() * &errors;
            }
        }
    }

    fn errors(&self) -> PerAxis<HeldOutErrors> {
        self.errors_after(&Mat::zeros(self.column_sums.len(), Axis::ALL.len()))
    }

    /// The errors after a change of the coefficients, in units of `F`.
    fn errors_after(&self, change: &Mat<f64>) -> PerAxis<HeldOutErrors> {
        // ‖M·δ − E‖² = ‖E‖² + (M·δ)ᵀ(M·δ − 2·E)
        let (left, right) = match &self.share {
            Share::Rows { features, errors } => {
                let moved = features * change;
                let rest = &moved - errors - errors;
                (moved, rest)
            }
            Share::Products { gram, scores } => {
                let moved = gram_times(gram, change);
                (change.clone(), moved - scores - scores)
            }
        };
        std::array::from_fn(|axis| {
            let sums = self.column_sums.iter().zip(change.col(axis).iter());
            let moved = left.col(axis).transpose() * right.col(axis);
            HeldOutErrors {
                rows: self.rows,
                sum: sums.map(|(sum, change)| sum * change).sum::<f64>() - self.sums[axis],
                // Cancellation may leave a negative number.
                squares: (self.products[(axis, axis)] + moved).max(0.0),
            }
        })
    }
}

impl Share {
    /// Contribution to the scatter, and `K_g` if it was computed or `wants_share` is true.
    fn part(
        &self,
        wants_share: bool,
        coefficients: &[Vec<f64>],
    ) -> Result<(Option<SymmetricMatrix>, Option<Part>), FitError> {
        match self {
            Self::Rows { features, errors } => {
                corrected_rows(features.as_ref(), errors.as_ref(), wants_share, coefficients)
            }
            Self::Products { gram, scores } => {
                let score = std::array::from_fn(|axis| scores.col(axis).iter().copied().collect());
                Ok((Some(gram.clone()), corrected(gram, score, coefficients)?))
            }
        }
    }

    /// `K_g`.
    fn gram(&self) -> SymmetricMatrix {
        match self {
            Self::Rows { features, .. } => gram(features.transpose()),
            Self::Products { gram, .. } => gram.clone(),
        }
    }

    /// `u_g`, features × 6.
    fn scores(&self) -> Mat<f64> {
        match self {
            Self::Rows { features, errors } => features.transpose() * errors,
            Self::Products { scores, .. } => scores.clone(),
        }
    }

    /// Mean over the rows of the prediction variance, if coefficients scatter as in `scatter`.
    fn variance(&self, scatter: &GroupScatter, rows: u64) -> PerAxis<f64> {
        let mean = |scores: &Vec<Vec<f64>>| {
            scores.iter().map(|score| self.square(score)).sum::<f64>() / rows.max(1) as f64
        };
        scatter.scores.each_ref().map(mean)
    }

    /// `‖M_g·v‖²`.
    fn square(&self, v: &[f64]) -> f64 {
        match self {
            Self::Rows { features, .. } => {
                let v = faer::ColRef::from_slice(v);
                (features * v).squared_norm_l2()
            }
            Self::Products { gram, .. } => product(v, &gram.times(v)),
        }
    }
}

impl FitWithout {
    /// Share of a group in this fit. `inverse` is `U⁻¹`.
    fn share(&self, share: &Share, inverse: &UpperTriangle) -> Share {
        match share {
            Share::Rows { features, errors } => {
                let (mut turned, root) = (features.clone(), self.root.matrix());
                let columns = turned.as_mut().transpose_mut();
                solve_lower_triangular_in_place(root.transpose(), columns, Par::Seq);
                Share::Rows { features: turned, errors: errors - features * &self.change }
            }
            Share::Products { gram, scores } => {
                let scores = scores - gram_times(gram, &self.change);
                let turned = by_column(&scores, |score| self.root.forward(score));
                Share::Products { gram: congruence(inverse, gram), scores: turned }
            }
        }
    }
}

fn gram_times(gram: &SymmetricMatrix, columns: &Mat<f64>) -> Mat<f64> {
    by_column(columns, |column| gram.times(&column))
}

fn by_column(columns: &Mat<f64>, of: impl Fn(Vec<f64>) -> Vec<f64>) -> Mat<f64> {
    let new: Vec<_> =
        columns.col_iter().map(|column| of(column.iter().copied().collect())).collect();
    Mat::from_fn(columns.nrows(), columns.ncols(), |i, j| new[j][i])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::factored::GroupFactors;
    use crate::model::{Basis, Model};
    use crate::scaling::Scaling;
    use crate::solver::{self, FitProblem, SolverKind};
    use shell_data::dataset::Dataset;
    use shell_data::wrench::Axes;
    use system_tests::random::Random;

    /// Groups of four and of nine rows, fewer and more than the six features.
    fn block() -> Block {
        let mut random = Random(7);
        let sizes: Vec<usize> = (0..24).map(|group| [4, 9][group % 2]).collect();
        let mut block = Block { readings: vec![Vec::new(); 2], ..Block::default() };
        block.wrench = vec![Vec::new(); 6];
        for (group, &rows) in sizes.iter().enumerate() {
            let position = [random.normal(), random.normal()];
            let common = random.normal();
            for _ in 0..rows {
                let readings = position.map(|position| 3.0 + position + 0.3 * random.normal());
                for (axis, column) in block.wrench.iter_mut().enumerate() {
                    let load = readings[axis % 2] * (axis as f64 + 1.0);
                    column.push(load + 0.3 * common + 0.1 * random.normal());
                }
                block.readings.iter_mut().zip(readings).for_each(|(column, s)| column.push(s));
            }
            block.groups.push((group.to_string(), rows));
            block.rows += rows;
        }
        block
    }

    fn part(block: &Block, is_in: impl Fn(usize) -> bool) -> Block {
        let of_group = |(group, (_, rows)): (usize, &(String, usize))| {
            std::iter::repeat_n(is_in(group), *rows)
        };
        block.kept(&block.groups.iter().enumerate().flat_map(of_group).collect::<Vec<_>>())
    }

    fn solution(block: &Block) -> Solution {
        let model = Model { basis: Basis::Quadratic, intercept: true, channels: 2, memory: 0 };
        let scaling = Scaling { centre: vec![3.0; 2], scale: vec![1.0; 2] };
        let problem = FitProblem { model, scaling, ridge: 0.0 };
        solver::fit(SolverKind::Tsqr, problem, &block.into()).unwrap().0
    }

    fn fitted<'a>(block: &Block, solution: &'a Solution) -> FittedGroups<'a> {
        let data = Dataset::from_blocks("rows", Axes::ALL, vec![block.clone()]);
        let (rows, labels) = GroupedRows::from_labels(&data);
        FittedGroups::from_rows(&rows, &labels, solution, Workers::ONE).unwrap()
    }

    fn assert_close(found: &GroupScore, expected: &GroupScore) {
        for (found, expected) in found.iter().zip(expected) {
            // Condition numbers below 100 in double precision.
            assert!(
                (found.0 - expected.0).abs() < 1e-11 * (1.0 + expected.0),
                "{found:?} {expected:?}"
            );
            assert!(
                (found.1 - expected.1).abs() < 1e-11 * (1.0 + expected.1),
                "{found:?} {expected:?}"
            );
        }
    }

    #[test]
    fn scores_of_groups_and_files_equal_those_of_fits_to_the_other_rows() {
        let block = block();
        let all = solution(&block);
        let groups = fitted(&block, &all);
        let of_all = groups.scatter(true, Workers::ONE).unwrap();
        for group in [0, 5, 16] {
            let rest = part(&block, |of| of != group);
            let without = solution(&rest);
            let scatter = fitted(&rest, &without).scatter(false, Workers::ONE).unwrap();
            let held_out = fitted(&part(&block, |of| of == group), &without);
            let (errors, variance) = (held_out.errors(0), held_out.variance(0, &scatter));
            let expected = score_of(&errors, &variance, &scatter, without.rows);
            assert_close(&groups.score_without(group).unwrap(), &expected);
        }
        let without = solution(&part(&block, |of| !(3..7).contains(&of)));
        let held_out = fitted(&part(&block, |of| (3..7).contains(&of)), &without);
        let found = groups.scores_of_files(std::slice::from_ref(&(3..7)), &of_all, Workers::ONE);
        for (at, found) in found.unwrap()[0].iter().enumerate() {
            let variance = groups.variance(3 + at, &of_all);
            let expected = score_of(&held_out.errors(at), &variance, &of_all, all.rows);
            assert_close(found, &expected);
        }
    }

    #[test]
    fn r_factors_about_another_centre_give_the_same_as_rows() {
        let mut block = block();
        // A group of nine rows in which a channel does not move: the R factor has rows without features.
        let before = block.groups[..7].iter().map(|(_, rows)| rows).sum::<usize>();
        block.readings[1][before..before + 9].fill(3.5);
        let all = solution(&block);
        let mut factors = GroupFactors::new(all.model, Scaling::identity(2));
        factors.add(&block, &block.groups).unwrap();
        let factors = factors.finish().unwrap();
        let of_factors = FittedGroups::from_factors(&factors, &all, Workers::ONE).unwrap();
        let of_rows = fitted(&block, &all);
        for group in [4, 7] {
            let expected = of_rows.score_without(group).unwrap();
            assert_close(&of_factors.score_without(group).unwrap(), &expected);
            for (found, expected) in of_factors.errors(group).iter().zip(of_rows.errors(group)) {
                assert!((found.squares / expected.squares - 1.0).abs() < 1e-11);
            }
        }
    }

    #[test]
    fn groups_that_alone_determine_a_coefficient_have_no_score() {
        let mut block = block();
        let moved = block.groups[..3].iter().map(|(_, rows)| rows).sum::<usize>();
        block.readings[1][moved..].fill(3.0);
        let all = solution(&block);
        let fitted = fitted(&block, &all);
        let mut shares = SymmetricMatrix::zeros(6);
        fitted.groups[..3].iter().for_each(|group| shares.add(&group.share.gram()));
        assert!(fitted.without(0..3, shares).is_none());
    }
}
