//! Normal equations of each fold, from products of features, memory terms and loads. The features
//! `X` are eliminated once from the equations of all rows outside a fold, `XᵀX = L·Lᵀ`. Memory
//! terms `M` then need only small equations, with the matrix `MᵀM − VᵀV`, `V = L⁻¹·XᵀM`; a lag
//! changes only their right side. Products with loads at a lag between two periods are
//! interpolated.

use std::sync::{Arc, OnceLock};

use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::{
    solve_lower_triangular_in_place, solve_upper_triangular_in_place,
};
use faer::{Accum, Mat, MatRef, Par, Side};

use super::errors::FoldErrors;
use super::samples::SearchRows;
use least_squares::validation::normal_equations::sums_without_each;
use shell_data::wrench::{Axis, PerAxis};

/// Ridge λ on columns of norm one, needed because memory terms are ill-conditioned.
const RIDGE: f64 = 1e-10;

/// Largest lag that is searched, in periods.
const FARTHEST: usize = 64;

/// Number of knots for loads at a lag and their slope; the lag is between the second and the third.
const KNOTS: usize = 4;

/// Products of columns, summed over the rows of each fold, and over those of each [fit](FoldEquations::fits).
struct FoldSums {
    folds: Vec<Mat<f64>>,
    fits: Vec<Mat<f64>>,
}

impl FoldSums {
    /// Computes `AᵀB` for the columns `a` and `b`.
    fn new(samples: &SearchRows<'_>, a: &Mat<f64>, b: &Mat<f64>) -> Self {
        let of = |rows: &std::ops::Range<usize>| {
            let (a, b) = (a.subrows(rows.start, rows.len()), b.subrows(rows.start, rows.len()));
            let mut product = Mat::zeros(a.ncols(), b.ncols());
            matmul(product.as_mut(), Accum::Replace, a.transpose(), b, 1.0, Par::Seq);
            product
        };
        Self::from_folds(samples.folds.iter().map(of).collect())
    }

    fn from_folds(folds: Vec<Mat<f64>>) -> Self {
        let mut all = Mat::zeros(folds[0].nrows(), folds[0].ncols());
        folds.iter().for_each(|of| all += of);
        let mut fits = sums_without_each(folds.iter());
        fits.push(all);
        Self { folds, fits }
    }

    fn on(&self, fold: Option<usize>) -> MatRef<'_, f64> {
        fold.map_or(self.fits[self.folds.len()].as_ref(), |fold| self.folds[fold].as_ref())
    }
}

/// Cholesky factor `L` of products scaled to columns of norm one, plus the ridge; and the norms of the columns.
struct ScaledFactor {
    norms: Vec<f64>,
    lower: Mat<f64>,
}

/// Norms of the columns, from their products; 1 for a column of zeros.
fn norms(products: MatRef<'_, f64>) -> Vec<f64> {
    let norm = |j: usize| Some(products[(j, j)].sqrt()).filter(|norm| *norm > 0.0);
    (0..products.ncols()).map(|j| norm(j).unwrap_or(1.0)).collect()
}

fn divide_rows(of: &mut Mat<f64>, norms: &[f64]) {
    for column in of.col_iter_mut() {
        column.iter_mut().zip(norms).for_each(|(value, norm)| *value /= norm);
    }
}

impl ScaledFactor {
    /// Factors the products, without a ridge on column `free`. `None` if rounding has made them indefinite.
    fn new(products: MatRef<'_, f64>, free: Option<usize>) -> Option<Self> {
        let norms = norms(products);
        let n = norms.len();
        let mut scaled = Mat::from_fn(n, n, |i, j| products[(i, j)] / norms[i] / norms[j]);
        (0..n).filter(|&j| free != Some(j)).for_each(|j| scaled[(j, j)] += RIDGE);
        let lower = scaled.llt(Side::Lower).ok()?.L().to_owned();
        Some(Self { norms, lower })
    }

    /// Returns `L⁻¹·D⁻¹·B`, where `D` is the diagonal matrix of the norms.
    fn eliminate(&self, mut products: Mat<f64>) -> Mat<f64> {
        divide_rows(&mut products, &self.norms);
        solve_lower_triangular_in_place(self.lower.as_ref(), products.as_mut(), Par::Seq);
        products
    }

    /// Returns `D⁻¹·L⁻ᵀ·B`.
    fn substitute(&self, mut eliminated: Mat<f64>) -> Mat<f64> {
        let upper = self.lower.transpose();
        solve_upper_triangular_in_place(upper, eliminated.as_mut(), Par::Seq);
        divide_rows(&mut eliminated, &self.norms);
        eliminated
    }
}

struct Knot {
    columns: Mat<f64>,
    with_features: FoldSums,
    eliminated: Vec<Mat<f64>>,
    /// Products of the loads of each axis at this knot with those at this and the next knots, fold by fold.
    with_next: [OnceLock<Vec<PerAxis<f64>>>; KNOTS],
}

pub(super) struct MemoryColumns {
    pub(super) time_constant: f64,
    columns: Mat<f64>,
    with_features: FoldSums,
    with_each_other: FoldSums,
    /// Norms of the columns, and `V`, for each fit.
    eliminated: Vec<(Vec<f64>, Mat<f64>)>,
    with_loads: Vec<OnceLock<FoldSums>>,
}

#[derive(Clone)]
pub(super) struct TermSet {
    pub(super) terms: Vec<Arc<MemoryColumns>>,
    products: Arc<FoldSums>,
    /// `L` of `MᵀM − VᵀV`, for each fit.
    factors: Arc<Vec<Mat<f64>>>,
}

impl TermSet {
    pub(super) fn time_constants(&self) -> Vec<f64> {
        self.terms.iter().map(|of| of.time_constant).collect()
    }
}

/// Loads at a lag, or their slope: a combination of the loads at a few knots.
#[derive(Clone, Copy)]
struct Blend {
    first: usize,
    weights: [f64; KNOTS],
}

impl Blend {
    fn knots(&self) -> impl Iterator<Item = (usize, f64)> {
        let knots = (self.first..).zip(self.weights);
        knots.filter(|(_, weight)| *weight != 0.0)
    }

    fn of<'m>(&self, part: impl Fn(usize) -> MatRef<'m, f64>) -> Mat<f64> {
        let (rows, columns) = (part(self.first + 1).nrows(), Axis::ALL.len());
        let mut sum = Mat::zeros(rows, columns);
        self.knots().for_each(|(knot, weight)| sum += part(knot) * faer::Scale(weight));
        sum
    }
}

/// Coefficients of a fit, features × 6 and memory terms × 6.
struct Coefficients {
    features: Mat<f64>,
    terms: Mat<f64>,
}

type Fitted<'a> = (Blend, &'a Coefficients);

/// Sums of `r·r`, `r·D⊥` and `D⊥·D⊥`, for the residual `r` and the unexplained part `D⊥` of the loads' slope.
#[derive(Clone, Copy)]
pub(super) struct LagSums {
    pub(super) residual: PerAxis<f64>,
    pub(super) both: PerAxis<f64>,
    pub(super) slope: PerAxis<f64>,
}

pub(super) struct FoldEquations<'a> {
    pub(super) samples: &'a SearchRows<'a>,
    origin: f64,
    features: FoldSums,
    /// Factors of the features' products: for each fold, over all rows outside it; the last, over all rows.
    fits: Vec<ScaledFactor>,
    knots: Vec<OnceLock<Knot>>,
    /// Variance of the loads; 0 for axes that do not vary.
    pub(super) variances: PerAxis<f64>,
}

impl<'a> FoldEquations<'a> {
    /// Creates equations for lags near `origin`; `None` if rounding makes the features' products indefinite.
    pub(super) fn new(samples: &'a SearchRows<'a>, origin: f64) -> Option<Self> {
        let loads = samples.loads(0.0);
        let variance = |axis: usize| {
            let column = loads.col(axis);
            let mean = column.sum() / samples.rows() as f64;
            column.iter().map(|load| (load - mean) * (load - mean)).sum::<f64>()
                / samples.rows() as f64
        };
        let features = FoldSums::new(samples, &samples.features, &samples.features);
        let ones = samples.has_intercept.then(|| samples.features.ncols() - 1);
        let fits = features.fits.iter().map(|of| ScaledFactor::new(of.as_ref(), ones));
        Some(Self {
            samples,
            origin,
            fits: fits.collect::<Option<_>>()?,
            features,
            knots: (0..=2 * FARTHEST).map(|_| OnceLock::new()).collect(),
            variances: std::array::from_fn(variance),
        })
    }

    /// Loads at a lag, and their slope. The slope spans one period in each direction, so that its noise does not
    /// correlate with that of the loads. `None` for a lag too far from the origin.
    fn blends(&self, lag: f64) -> Option<[Blend; 2]> {
        let period = self.samples.clock.period;
        let at = (lag - self.origin) / period + FARTHEST as f64;
        let before = at.floor();
        let is_known = before >= 1.0 && before + 2.0 <= (2 * FARTHEST) as f64;
        let (first, share) = (is_known.then_some(before as usize - 1)?, at - before);
        let (low, high) = (0.5 * (1.0 - share) / period, 0.5 * share / period);
        let loads = Blend { first, weights: [0.0, 1.0 - share, share, 0.0] };
        let slope = Blend { first, weights: [-low, -high, low, high] };
        Some([loads, slope])
    }

    fn knot(&self, at: usize) -> &Knot {
        self.knots[at].get_or_init(|| {
            let by = self.origin + (at as f64 - FARTHEST as f64) * self.samples.clock.period;
            let columns = self.samples.loads(by);
            let with_features = FoldSums::new(self.samples, &self.samples.features, &columns);
            let eliminated = self.eliminated(&with_features);
            Knot { columns, with_features, eliminated, with_next: Default::default() }
        })
    }

    fn eliminated(&self, with_features: &FoldSums) -> Vec<Mat<f64>> {
        let products = with_features.fits.iter().cloned();
        self.fits.iter().zip(products).map(|(fit, products)| fit.eliminate(products)).collect()
    }

    fn load_products(&self, a: usize, b: usize, fold: Option<usize>) -> PerAxis<f64> {
        let (low, high) = (self.knot(a.min(b)), self.knot(a.max(b)));
        let of_folds = low.with_next[a.abs_diff(b)].get_or_init(|| {
            let of = |rows: &std::ops::Range<usize>| {
                std::array::from_fn(|axis| {
                    let [low, high] =
                        [low, high].map(|of| of.columns.col(axis).subrows(rows.start, rows.len()));
                    low.transpose() * high
                })
            };
            self.samples.folds.iter().map(of).collect()
        });
        let mut sum = [0.0; 6];
        let folds = fold.map_or(0..of_folds.len(), |fold| fold..fold + 1);
        for of in &of_folds[folds] {
            sum.iter_mut().zip(of).for_each(|(sum, of)| *sum += of);
        }
        sum
    }

    pub(super) fn no_terms(&self) -> TermSet {
        let none = || Mat::zeros(0, 0);
        let products = FoldSums::from_folds(self.samples.folds.iter().map(|_| none()).collect());
        let factors = Arc::new(self.fits.iter().map(|_| none()).collect());
        TermSet { terms: Vec::new(), products: Arc::new(products), factors }
    }

    pub(super) fn memory(&self, time_constant: f64) -> Arc<MemoryColumns> {
        let columns = self.samples.memory_terms(time_constant);
        let with_features = FoldSums::new(self.samples, &self.samples.features, &columns);
        let with_each_other = FoldSums::new(self.samples, &columns, &columns);
        let fits = self.fits.iter().zip(&with_features.fits).zip(&with_each_other.fits);
        let eliminated = fits.map(|((fit, with_features), own)| {
            let (norms, mut products) = (norms(own.as_ref()), with_features.clone());
            for (column, norm) in products.col_iter_mut().zip(&norms) {
                column.iter_mut().for_each(|value| *value /= norm);
            }
            (norms, fit.eliminate(products))
        });
        Arc::new(MemoryColumns {
            time_constant,
            eliminated: eliminated.collect(),
            columns,
            with_features,
            with_each_other,
            with_loads: (0..=2 * FARTHEST).map(|_| OnceLock::new()).collect(),
        })
    }

    fn with_loads<'m>(&self, terms: &'m MemoryColumns, knot: usize) -> &'m FoldSums {
        let loads = || FoldSums::new(self.samples, &terms.columns, &self.knot(knot).columns);
        terms.with_loads[knot].get_or_init(loads)
    }

    /// Returns the set with `new` at a position, in place of the term there or after the last. `None` if
    /// rounding makes its equations indefinite.
    pub(super) fn with(
        &self,
        set: &TermSet,
        position: usize,
        new: &Arc<MemoryColumns>,
    ) -> Option<TermSet> {
        let mut terms = set.terms.clone();
        match terms.get_mut(position) {
            Some(old) => *old = Arc::clone(new),
            None => terms.push(Arc::clone(new)),
        }
        let width = new.columns.ncols();
        let between: Vec<Option<FoldSums>> = (terms.iter().enumerate())
            .map(|(at, other)| {
                let product = || FoldSums::new(self.samples, &new.columns, &other.columns);
                (at != position).then(product)
            })
            .collect();
        let all = width * terms.len();
        let of_fold = |fold: usize| {
            let (mut products, known) = (Mat::zeros(all, all), set.products.on(Some(fold)));
            let (rows, columns) = known.shape();
            products.submatrix_mut(0, 0, rows, columns).copy_from(known);
            for (at, between) in between.iter().enumerate() {
                let block = between.as_ref().unwrap_or(&new.with_each_other).on(Some(fold));
                let [own, other] = [position * width, at * width];
                products.submatrix_mut(own, other, width, width).copy_from(block);
                let mut mirrored = products.submatrix_mut(other, own, width, width);
                mirrored.copy_from(block.transpose());
            }
            products
        };
        let products = FoldSums::from_folds((0..self.samples.folds.len()).map(of_fold).collect());
        let factor = |(fit, mut left): (usize, Mat<f64>)| {
            for (i, a) in terms.iter().enumerate() {
                for (j, b) in terms.iter().enumerate().take(i + 1) {
                    let ([a_norms, b_norms], [a, b]) = (
                        [a, b].map(|of| &of.eliminated[fit].0),
                        [a, b].map(|of| &of.eliminated[fit].1),
                    );
                    let mut block = left.submatrix_mut(i * width, j * width, width, width);
                    for column in 0..width {
                        for row in 0..width {
                            block[(row, column)] /= a_norms[row] * b_norms[column];
                        }
                    }
                    matmul(block, Accum::Add, a.transpose(), b, -1.0, Par::Seq);
                }
            }
            (0..all).for_each(|j| left[(j, j)] += RIDGE);
            Some(left.llt(Side::Lower).ok()?.L().to_owned())
        };
        let factors: Option<_> = products.fits.iter().cloned().enumerate().map(factor).collect();
        Some(TermSet { terms, products: Arc::new(products), factors: Arc::new(factors?) })
    }

    fn solve(&self, set: &TermSet, fit: usize, blend: Blend) -> Coefficients {
        let mut left = blend.of(|knot| self.knot(knot).eliminated[fit].as_ref());
        let width = set.terms.first().map_or(0, |of| of.columns.ncols());
        let mut terms = Mat::zeros(width * set.terms.len(), Axis::ALL.len());
        for (at, of) in set.terms.iter().enumerate() {
            let (norms, eliminated) = &of.eliminated[fit];
            let mut products = blend.of(|knot| self.with_loads(of, knot).fits[fit].as_ref());
            divide_rows(&mut products, norms);
            let own = eliminated.transpose();
            matmul(products.as_mut(), Accum::Add, own, left.as_ref(), -1.0, Par::Seq);
            terms.subrows_mut(at * width, width).copy_from(&products);
        }
        if !set.terms.is_empty() {
            let lower = set.factors[fit].as_ref();
            solve_lower_triangular_in_place(lower, terms.as_mut(), Par::Seq);
            solve_upper_triangular_in_place(lower.transpose(), terms.as_mut(), Par::Seq);
        }
        for (at, of) in set.terms.iter().enumerate() {
            let (norms, eliminated) = &of.eliminated[fit];
            let mut own = terms.subrows_mut(at * width, width);
            matmul(left.as_mut(), Accum::Add, eliminated, own.as_ref(), -1.0, Par::Seq);
            for column in own.as_mut().col_iter_mut() {
                column.iter_mut().zip(norms).for_each(|(value, norm)| *value /= norm);
            }
        }
        Coefficients { features: self.fits[fit].substitute(left), terms }
    }

    /// `Σ r_a·r_b` on each axis, over the rows of a fold or all rows.
    fn residual_products(
        &self,
        set: &TermSet,
        fold: Option<usize>,
        (a, of_a): Fitted<'_>,
        (b, of_b): Fitted<'_>,
    ) -> PerAxis<f64> {
        let mut sums = [0.0; 6];
        for (knot_a, weight_a) in a.knots() {
            for (knot_b, weight_b) in b.knots() {
                let products = self.load_products(knot_a, knot_b, fold);
                for (sum, product) in sums.iter_mut().zip(products) {
                    *sum += weight_a * weight_b * product;
                }
            }
        }
        let mut add = |a: MatRef<'_, f64>, b: MatRef<'_, f64>, sign: f64| {
            for (axis, sum) in sums.iter_mut().enumerate() {
                *sum += sign * (a.col(axis).transpose() * b.col(axis));
            }
        };
        let with_features = |blend: Blend| blend.of(|knot| self.knot(knot).with_features.on(fold));
        let mut explained = self.features.on(fold) * &of_b.features;
        let mut of_terms = set.products.on(fold) * &of_b.terms;
        for (at, of) in set.terms.iter().enumerate() {
            let width = of.columns.ncols();
            let [own_a, own_b] = [of_a, of_b].map(|of| of.terms.subrows(at * width, width));
            let products = of.with_features.on(fold);
            matmul(explained.as_mut(), Accum::Add, products, own_b, 1.0, Par::Seq);
            let own = of_terms.subrows_mut(at * width, width);
            matmul(own, Accum::Add, products.transpose(), of_b.features.as_ref(), 1.0, Par::Seq);
            let with_loads = |blend: Blend| blend.of(|knot| self.with_loads(of, knot).on(fold));
            add(own_a, with_loads(b).as_ref(), -1.0);
            add(own_b, with_loads(a).as_ref(), -1.0);
        }
        add(of_a.features.as_ref(), explained.as_ref(), 1.0);
        add(of_a.terms.as_ref(), of_terms.as_ref(), 1.0);
        add(of_a.features.as_ref(), with_features(b).as_ref(), -1.0);
        add(of_b.features.as_ref(), with_features(a).as_ref(), -1.0);
        sums
    }

    /// Errors on each fold, at a lag, of the fit without it. `None` for a lag too far from the origin.
    pub(super) fn errors(&self, set: &TermSet, lag: f64) -> Option<FoldErrors> {
        let [loads, _] = self.blends(lag)?;
        let load_noise = self.samples.noise_of_loads(lag);
        let time_constants = set.time_constants();
        let mut errors =
            FoldErrors { rows: 0, squares: [0.0; 6], scores: Vec::new(), systematic: Vec::new() };
        let varying: Vec<usize> = (0..6).filter(|&axis| self.variances[axis] > 0.0).collect();
        for (fold, of_fold) in self.samples.folds.iter().enumerate() {
            let rest = self.solve(set, fold, loads);
            let fitted = (loads, &rest);
            // Cancellation may leave a negative number, which is impossible for a sum of squares.
            let found = self
                .residual_products(set, Some(fold), fitted, fitted)
                .map(|squares| squares.max(0.0));
            let rows = of_fold.len() as u64;
            let noise = self.samples.noise.of_wrench(&rest.features, &rest.terms, &time_constants);
            let mean = |of: &dyn Fn(usize) -> f64| {
                let relative = varying.iter().map(|&axis| of(axis) / self.variances[axis]);
                relative.sum::<f64>() / varying.len().max(1) as f64
            };
            let score = mean(&|axis| found[axis] / rows as f64);
            let noise = mean(&|axis| noise[axis] + load_noise[axis]);
            errors.rows += rows;
            errors.squares.iter_mut().zip(found).for_each(|(sum, of)| *sum += of);
            errors.scores.push((rows, score));
            errors.systematic.push((rows, score - noise));
        }
        Some(errors)
    }

    /// Sums over all rows at a lag and, if `by_fold`, `both` for each fold. `None` for a lag too far from the origin.
    pub(super) fn lag_sums(
        &self,
        set: &TermSet,
        lag: f64,
        by_fold: bool,
    ) -> Option<(LagSums, Vec<PerAxis<f64>>)> {
        let [loads, slope] = self.blends(lag)?;
        let all = self.samples.folds.len();
        let [residual, unexplained] = [loads, slope].map(|of| self.solve(set, all, of));
        let (residual, unexplained) = ((loads, &residual), (slope, &unexplained));
        let sums = LagSums {
            residual: self.residual_products(set, None, residual, residual),
            both: self.residual_products(set, None, residual, unexplained),
            slope: self.residual_products(set, None, unexplained, unexplained),
        };
        let of_fold = |fold| self.residual_products(set, Some(fold), residual, unexplained);
        Some((sums, (0..all).filter(|_| by_fold).map(of_fold).collect()))
    }
}
