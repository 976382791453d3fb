//! Groups of rows relative to a fit of all of them: the [scatter](crate::sandwich) of its coefficients over the
//! groups, and fits without some groups.
//!
//! With the `F` of the fit, `F·Fᵀ = (XᵀX + Λ)⁻¹`, the columns of `M = X·F` are orthonormal, but for a ridge.
//! A group has
//!
//! ```text
//! M_g = X_g·F    E_g = W_g − X_g·C    K_g = M_gᵀM_g    u_g = M_gᵀE_g
//! ```
//!
//! and the fit without it, with the same penalties Λ, is `C − F·(I − K_g)⁻¹·u_g`. No row is factored or read
//! again. These equations are well conditioned for any features, so errors grow with κ(X), as those of `M`,
//! and not with its square.

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
use crate::uncertainty::score_of;
use shell_data::wrench::{Axis, PerAxis};

/// Number of rows whose features are computed together, or the number of features if that is more.
const CHUNK: usize = 1024;

/// Groups relative to a fit of all their rows.
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

/// A fit without some groups.
struct FitWithout {
    /// `U` with `UᵀU = I − K`: the factor of this fit is `F·U⁻¹`.
    root: UpperTriangle,
    /// The change of the coefficients, in units of `F`: features × 6.
    change: Mat<f64>,
    /// The products of its residuals.
    residual_products: Mat<f64>,
}

impl<'a> FittedGroups<'a> {
    /// Reduces groups of rows in memory, each with its label.
    ///
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
            Ok(FittedGroup::from_rows((*label).clone(), (rows, runs), &features, solution))
        };
        let groups: Vec<_> = rows.groups().zip(labels).collect();
        Ok(Self { solution, groups: map(&groups, workers, reduce)? })
    }

    /// Converts the R factors of groups, with any centres.
    ///
    /// # Errors
    /// [`FitError::NearlyDependent`] if features of the solution were not kept.
    pub fn from_factors(
        rows: &FactoredGroups,
        solution: &'a Solution,
        workers: Workers<'_>,
    ) -> Result<Self, FitError> {
        let convert = |(label, rows): &(String, FactoredRows)| {
            let change = rows.change(&solution.model, &solution.scaling);
            let change = change.ok_or(FitError::NearlyDependent)?;
            let (r, z) = rows.r_factor.significant_rows();
            let x = &r * change;
            let mut group = FittedGroup::new(label.clone(), rows.rows(), x.ncols());
            let errors = z - &x * &solution.coefficients;
            let ones: Vec<f64> = r.col(r.ncols() - 1).iter().copied().collect();
            group.add(x.as_ref(), errors, &ones, solution);
            group.products += rows.r_factor.rest_products();
            Ok(group)
        };
        Ok(Self { solution, groups: map(&rows.groups, workers, convert)? })
    }

    /// Number of groups.
    pub fn count(&self) -> usize {
        self.groups.len()
    }

    /// The scatter of the coefficients over the groups, on request with its degrees of freedom. Omits the bias
    /// from a ridge or a truncation.
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

    /// The errors of the fit on a group.
    pub(crate) fn errors(&self, group: usize) -> PerAxis<HeldOutErrors> {
        self.groups[group].errors()
    }

    /// The mean variance of predictions on a group that comes from the coefficients, if these scatter as in
    /// `scatter`.
    pub(crate) fn variance(&self, group: usize, scatter: &GroupScatter) -> PerAxis<f64> {
        self.groups[group].variance(&scatter.scores)
    }

    /// The mean and the scatter of the errors on a group, in standard errors, from the fit to all others;
    /// `None` if these do not determine it.
    pub(crate) fn score_without(&self, held_out: usize) -> Option<PerAxis<(f64, f64)>> {
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
        let share = without.share(&group.share, &inverse);
        let variance = scatter.scores.each_ref().map(|scores| {
            let square = |score: &Vec<f64>| share.square(score);
            scores.iter().map(square).sum::<f64>() / group.rows.max(1) as f64
        });
        let errors = group.errors_after(&without.change);
        Some(score_of(&errors, &variance, &scatter, self.solution.rows - group.rows))
    }

    /// Like [`score_without`](Self::score_without) for each of the groups of a file, from the fit without the
    /// file, in standard errors of the fit to all rows.
    pub(crate) fn scores_of_file(
        &self,
        file: Range<usize>,
        scatter: &GroupScatter,
    ) -> Option<Vec<PerAxis<(f64, f64)>>> {
        let squares = scatter.scores.each_ref().map(|scores| {
            let columns = Mat::from_fn(self.solution.factor.nrows(), scores.len(), |i, j| scores[j][i]);
            gram(columns.as_ref())
        });
        let mut shares = SymmetricMatrix::zeros(self.solution.factor.nrows());
        let mut variances = Vec::with_capacity(file.len());
        for group in &self.groups[file.clone()] {
            let share = group.share.gram();
            let rows = group.rows.max(1) as f64;
            variances.push(squares.each_ref().map(|of| share.trace_of_product(of) / rows));
            shares.add(&share);
        }
        let without = self.without(file.clone(), shares)?;
        let score = |(group, variance): (&FittedGroup, PerAxis<f64>)| {
            let errors = group.errors_after(&without.change);
            score_of(&errors, &variance, scatter, self.solution.rows)
        };
        Some(self.groups[file].iter().zip(variances).map(score).collect())
    }

    /// The fit without some groups, whose `K_g` add up to `shares`; `None` if the others do not determine it.
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

impl FittedGroup {
    /// A group of `rows` rows, before they are added.
    fn new(label: String, rows: u64, features: usize) -> Self {
        let axes = Axis::ALL.len();
        let share =
            Share::Rows { features: Mat::zeros(0, features), errors: Mat::zeros(0, axes) };
        let (column_sums, products) = (vec![0.0; features], Mat::zeros(axes, axes));
        Self { label, rows, share, column_sums, sums: [0.0; 6], products }
    }

    fn from_rows(
        label: String,
        (rows, runs): (&GroupedRows, &[Run]),
        features: &Features,
        solution: &Solution,
    ) -> Self {
        let (columns, count) = (features.len(), count(runs));
        let at_once = CHUNK.max(columns).min(count);
        let mut group = Self::new(label, count as u64, columns);
        let mut flat = vec![0.0; at_once * columns];
        for block in rows.copied(runs, at_once) {
            features.fill(&block.readings, 0..block.rows, &mut flat, at_once);
            let x =
                MatRef::from_column_major_slice_with_stride(&flat, block.rows, columns, at_once);
            let mut errors = Mat::zeros(block.rows, Axis::ALL.len());
            for (column, axis) in errors.col_iter_mut().zip(&block.wrench) {
                column.iter_mut().zip(axis).for_each(|(to, load)| *to = *load);
            }
            errors -= x * &solution.coefficients;
            group.add(x, errors, &vec![1.0; block.rows], solution);
        }
        group
    }

    /// Adds rows with the features `x` and the errors `errors`, or an orthogonal transformation of both and of
    /// a column of ones.
    fn add(&mut self, x: MatRef<'_, f64>, errors: Mat<f64>, ones: &[f64], solution: &Solution) {
        use BlockStructure::{Rectangular, TriangularUpper};
        let mut features = Mat::zeros(x.nrows(), x.ncols());
        let factor = solution.factor.as_ref();
        let to = features.as_mut();
        matmul(to, Rectangular, Accum::Replace, x, Rectangular, factor, TriangularUpper, 1.0, Par::Seq);
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

    /// The errors of the fit.
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

    /// The mean over the rows of the variance of `M·v`, summed over the `v` of each axis.
    fn variance(&self, scores: &PerAxis<Vec<Vec<f64>>>) -> PerAxis<f64> {
        scores.each_ref().map(|scores| {
            let square = |score: &Vec<f64>| self.share.square(score);
            scores.iter().map(square).sum::<f64>() / self.rows.max(1) as f64
        })
    }
}

impl Share {
    /// The part in the scatter, and `K_g` if it was computed or `wants_share` is true.
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
                let score =
                    std::array::from_fn(|axis| scores.col(axis).iter().copied().collect());
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
    /// The share of a group in this fit. `inverse` is `U⁻¹`.
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

/// Replaces each column by a function of it.
fn by_column(columns: &Mat<f64>, of: impl Fn(Vec<f64>) -> Vec<f64>) -> Mat<f64> {
    let new: Vec<_> = columns.col_iter().map(|column| of(column.iter().copied().collect())).collect();
    Mat::from_fn(columns.nrows(), columns.ncols(), |i, j| new[j][i])
}
