//! Normal equations of each fold, composed of products of features and of memory terms.

use std::sync::Arc;

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};

use super::samples::SearchRows;
use least_squares::validation::comparison::FoldMean;
use least_squares::validation::normal_equations::NormalEquations;
use shell_data::wrench::{Axis, PerAxis};

/// λ on columns of norm one, which the condition numbers of memory terms require.
const RIDGE: f64 = 1e-10;

/// `AᵀB` of the rows of each fold.
fn products(samples: &SearchRows<'_>, a: &Mat<f64>, b: &Mat<f64>) -> Vec<Mat<f64>> {
    let of = |rows: &std::ops::Range<usize>| {
        let (a, b) = (a.subrows(rows.start, rows.len()), b.subrows(rows.start, rows.len()));
        let mut product = Mat::zeros(a.ncols(), b.ncols());
        matmul(product.as_mut(), Accum::Replace, a.transpose(), b, 1.0, Par::Seq);
        product
    };
    samples.folds.iter().map(of).collect()
}

/// Columns with their products with the features and with each other, fold by fold.
pub(super) struct ProductColumns {
    pub(super) columns: Mat<f64>,
    with_features: Vec<Mat<f64>>,
    with_each_other: Vec<Mat<f64>>,
}

impl ProductColumns {
    pub(super) fn new(samples: &SearchRows<'_>, columns: Mat<f64>) -> Self {
        Self {
            with_features: products(samples, &samples.features, &columns),
            with_each_other: products(samples, &columns, &columns),
            columns,
        }
    }
}

pub(super) struct MemoryColumns {
    pub(super) time_constant: f64,
    pub(super) terms: ProductColumns,
}

/// Equations for features and some memory terms.
pub(super) struct FoldEquations<'a> {
    pub(super) samples: &'a SearchRows<'a>,
    /// `XᵀX` of the features of each fold.
    features: Vec<Mat<f64>>,
    /// Variances of the axes; 0 for axes that do not vary.
    pub(super) variances: PerAxis<f64>,
}

/// Squared errors on each held-out fold, per axis.
#[derive(Clone, Debug)]
pub(super) struct FoldErrors {
    rows: u64,
    squares: PerAxis<f64>,
    /// Rows of each fold, and its errors relative to the variance of each axis, averaged over those that
    /// vary.
    scores: Vec<(u64, f64)>,
    /// Scores minus the part caused by noise of readings and loads.
    systematic: Vec<(u64, f64)>,
}

impl FoldErrors {
    pub(super) fn score(&self) -> f64 {
        FoldMean::new(&self.scores).value
    }

    /// Score minus the part of noise, which a search minimises. Terms that only average noise raise it.
    pub(super) fn systematic(&self) -> f64 {
        FoldMean::new(&self.systematic).value
    }

    /// Returns true if the errors of `later` are lower by more than a standard error, and by this share.
    pub(super) fn are_lowered_by(&self, later: &Self, share: f64) -> bool {
        let gain = gain(&self.scores, &later.scores);
        gain.value > gain.standard_error && gain.value > share * self.score()
    }

    /// Returns true if the errors are also lower by this share, both with and without the part of noise.
    pub(super) fn are_explained_by(&self, later: &Self, share: f64) -> bool {
        let least = share * self.score();
        let of = [(&self.scores, &later.scores), (&self.systematic, &later.systematic)];
        of.into_iter().all(|(before, after)| {
            let gain = gain(before, after);
            gain.value > gain.standard_error && gain.value > least
        })
    }

    /// Root mean square errors, N and N·m.
    pub(super) fn rms(&self) -> PerAxis<f64> {
        self.squares.map(|squares| (squares / self.rows as f64).sqrt())
    }
}

fn gain(before: &[(u64, f64)], after: &[(u64, f64)]) -> FoldMean {
    let lower = |(&(rows, before), (_, after)): (&(u64, f64), &(u64, f64))| (rows, before - after);
    FoldMean::new(&before.iter().zip(after).map(lower).collect::<Vec<_>>())
}

impl<'a> FoldEquations<'a> {
    pub(super) fn new(samples: &'a SearchRows<'a>) -> Self {
        let loads = samples.loads(0.0);
        let variance = |axis: usize| {
            let column = loads.col(axis);
            let mean = column.sum() / samples.rows() as f64;
            column.iter().map(|load| (load - mean) * (load - mean)).sum::<f64>()
                / samples.rows() as f64
        };
        Self {
            samples,
            features: products(samples, &samples.features, &samples.features),
            variances: std::array::from_fn(variance),
        }
    }

    /// Index of the constant feature.
    fn ones(&self) -> Option<usize> {
        self.samples.has_intercept.then(|| self.samples.features.ncols() - 1)
    }

    fn of_folds(
        &self,
        terms: &[Arc<MemoryColumns>],
        loads: &ProductColumns,
    ) -> Vec<NormalEquations> {
        let terms: Vec<&ProductColumns> = terms.iter().map(|of| &of.terms).collect();
        let with = |of: &&ProductColumns| products(self.samples, &of.columns, &loads.columns);
        let with_loads: Vec<_> = terms.iter().map(with).collect();
        let mut between = Vec::new();
        for (i, a) in terms.iter().enumerate() {
            for (j, b) in terms.iter().enumerate().skip(i + 1) {
                between.push((i, j, products(self.samples, &a.columns, &b.columns)));
            }
        }
        let p = self.samples.features.ncols();
        let width = terms.first().map_or(0, |of| of.columns.ncols());
        let start = |term: usize| p + term * width;
        let all = start(terms.len());
        let of_fold = |fold: usize| {
            let mut whole = Mat::zeros(all + Axis::ALL.len(), all + Axis::ALL.len());
            let mut put = |row: usize, column: usize, part: MatRef<'_, f64>| {
                whole.submatrix_mut(row, column, part.nrows(), part.ncols()).copy_from(part);
                let mut other = whole.submatrix_mut(column, row, part.ncols(), part.nrows());
                other.copy_from(part.transpose());
            };
            put(0, 0, self.features[fold].as_ref());
            put(0, all, loads.with_features[fold].as_ref());
            put(all, all, loads.with_each_other[fold].as_ref());
            for (term, of) in terms.iter().enumerate() {
                put(0, start(term), of.with_features[fold].as_ref());
                put(start(term), start(term), of.with_each_other[fold].as_ref());
                put(start(term), all, with_loads[term][fold].as_ref());
            }
            for (a, b, product) in &between {
                put(start(*a), start(*b), product[fold].as_ref());
            }
            let rows = self.samples.folds[fold].len() as u64;
            NormalEquations { features: all, rows, products: whole }
        };
        (0..self.samples.folds.len()).map(of_fold).collect()
    }

    /// Errors on each fold of fits without it, at a lag; `None` if a fit fails.
    pub(super) fn errors(&self, terms: &[Arc<MemoryColumns>], lag: f64) -> Option<FoldErrors> {
        let loads = ProductColumns::new(self.samples, self.samples.loads(lag));
        let folds = self.of_folds(terms, &loads);
        let load_noise = self.samples.noise_of_loads(lag);
        let time_constants: Vec<f64> = terms.iter().map(|of| of.time_constant).collect();
        let mut errors =
            FoldErrors { rows: 0, squares: [0.0; 6], scores: Vec::new(), systematic: Vec::new() };
        let varying: Vec<usize> = (0..6).filter(|&axis| self.variances[axis] > 0.0).collect();
        for (position, fold) in folds.iter().enumerate() {
            let rest = NormalEquations::all_but(&folds, position)?.solve(RIDGE, self.ones())?;
            let found = fold.errors(rest.as_ref(), self.ones());
            let rows = self.samples.folds[position].len() as u64;
            let noise = self.samples.noise.of_wrench(rest.as_ref(), &time_constants);
            let mean = |of: &dyn Fn(usize) -> f64| {
                let relative = varying.iter().map(|&axis| of(axis) / self.variances[axis]);
                relative.sum::<f64>() / varying.len().max(1) as f64
            };
            let score = mean(&|axis| found[axis].squares / rows as f64);
            let noise = mean(&|axis| noise[axis] + load_noise[axis]);
            errors.rows += rows;
            errors.squares.iter_mut().zip(&found).for_each(|(sum, of)| *sum += of.squares);
            errors.scores.push((rows, score));
            errors.systematic.push((rows, score - noise));
        }
        Some(errors)
    }

    /// Residual of columns (rows × 6) after a fit of all features and memory terms.
    pub(super) fn unexplained(
        &self,
        terms: &[Arc<MemoryColumns>],
        columns: &ProductColumns,
    ) -> Option<Mat<f64>> {
        let folds = self.of_folds(terms, columns);
        let (first, others) = folds.split_first()?;
        let mut all = first.clone();
        others.iter().for_each(|other| all.add(other));
        let coefficients = all.solve(RIDGE, self.ones())?;
        let p = self.samples.features.ncols();
        let mut left = columns.columns.clone();
        let mut take_off = |part: &Mat<f64>, start: usize| {
            let own = coefficients.subrows(start, part.ncols());
            matmul(left.as_mut(), Accum::Add, part, own, -1.0, Par::Seq);
        };
        take_off(&self.samples.features, 0);
        for (term, of) in terms.iter().enumerate() {
            let part = &of.terms.columns;
            take_off(part, p + term * part.ncols());
        }
        Some(left)
    }
}
