//! Huber's M-estimator of regression, with less weight for distant rows, for each column of `Y` separately.
//!
//! Solves `Σ ψ(rᵢ/σ)·xᵢ = 0` with `ψ(u) = max(−k, min(k, u))`, k = 1.345 (95 % efficiency for normal errors), and σ
//! the median of `|r|` over 0.6745, like R's `MASS::rlm` by default. Modified residuals (Huber, Robust Statistics,
//! 1981, §7.8) replace iteratively reweighted least squares: `C += q·(XᵀX)⁻¹Xᵀψ`. A pass over the rows then costs a
//! gradient, not a factorisation per column of `Y`, and for q < 2 each step is certain to improve. A histogram with
//! logarithmic bins gives the median over all rows to 0.4 %; the next pass keeps the sizes near it, which makes the
//! median exact.
//!
//! Coefficients and σ advance together, one step per pass. If σ oscillates with few rows, steps are shortened.
//!
//! Huber's pseudo-residuals, `K·ψ(rᵢ/σ)·σ/mean ψ'`, give covariances of coefficients as in least squares (§7.6).

use faer::Mat;

use super::rows::{Reduction, RowChunk, RowSource, Shape};
use crate::magnitudes::FineMagnitudes;
use crate::r_factor::{LeastSquares, LeastSquaresError, RFactor, Ridge};
use crate::vectors::{add_multiple, dot};
use std::ops::Range;

/// Clipping threshold, in multiples of σ.
const CLIP: f64 = 1.345;
/// The third quartile of the standard normal distribution.
const QUARTILE: f64 = 0.674_489_750_196_081_7;
/// Maximum number of passes over many rows. Few rows can determine their own residuals, which shortens the steps. They
/// are allowed more passes, of the same total cost.
const MOST_PASSES: usize = 500;
const MANY: u64 = 100_000;
const MOST_SHORT_PASSES: usize = 20_000;
/// Size of the last step, in standard errors and in σ. The remaining distance is at most some ten times larger.
const STEP: f64 = 1e-8;
/// Number of passes after which steps of σ are shortened if they reverse.
const FREE_PASSES: usize = 20;
/// Factor that shortens a reversed step of σ, its lower limit, and factor that lengthens it again.
const SHORTER: f64 = 0.7;
const SHORTEST: f64 = 0.02;
const LONGER: f64 = 1.1;
/// Maximum number of rows for which all sizes are kept; for more, only sizes within [`NEAR`] of the last median are.
const ALL_KEPT: u64 = 10_000;
const NEAR: f64 = 0.01;
/// Rounding error of sums over rows, relative to their terms.
const ROUNDING: f64 = 64.0 * f64::EPSILON;
/// Smallest σ as a fraction of the RMS: if most rows are fitted without error, the others must keep some weight.
const SMALLEST: f64 = 1e-12;

/// # Panics
/// If `sizes` is empty.
pub(crate) fn clip_of_sizes(sizes: &mut [f64]) -> f64 {
    let count = sizes.len();
    CLIP * mean_of_ranks(sizes, [(count - 1) / 2, count / 2]) / QUARTILE
}

/// Mean of the sizes at two ranks, equal or consecutive.
fn mean_of_ranks(sizes: &mut [f64], [lower, upper]: [usize; 2]) -> f64 {
    let (below, &mut middle, _) = sizes.select_nth_unstable_by(upper, f64::total_cmp);
    let other = if lower == upper { middle } else { below.iter().copied().fold(0.0, f64::max) };
    0.5 * (middle + other)
}

struct Clipping {
    shape: Shape,
    coefficients: Mat<f64>,
    /// σ·k of each column of `Y`.
    clip: Vec<f64>,
    unit: Vec<f64>,
    /// Range in which all sizes are kept, in multiples of `unit`.
    near: Vec<Range<f64>>,
}

#[derive(Clone)]
struct Clipped<'a> {
    by: &'a Clipping,
    /// `XᵀΨ`, Ψ in units of `Y`.
    gradient: Mat<f64>,
    /// `ΨᵀΨ`.
    products: Mat<f64>,
    /// Number of residuals that were not clipped, per column of `Y`.
    inside: Vec<u64>,
    sizes: Vec<FineMagnitudes>,
    /// Number of sizes below the kept range, per column of `Y`; `kept` has the sizes within it.
    below: Vec<u64>,
    kept: Vec<Vec<f64>>,
}

impl<'a> Clipped<'a> {
    fn new(by: &'a Clipping) -> Self {
        let Shape { features: p, outputs: q } = by.shape;
        Self {
            by,
            gradient: Mat::zeros(p, q),
            products: Mat::zeros(q, q),
            inside: vec![0; q],
            sizes: vec![FineMagnitudes::default(); q],
            below: vec![0; q],
            kept: vec![Vec::new(); q],
        }
    }

    /// Median size of a column's residuals (mean of the middle two if even); `false` if it is from the histogram.
    fn median(&mut self, a: usize, rows: u64) -> (f64, bool) {
        let (kept, below) = (&mut self.kept[a], self.below[a]);
        let position = |rank: u64| rank.checked_sub(below).map(|position| position as usize);
        match [(rows - 1) / 2, rows / 2].map(position) {
            [Some(lower), Some(upper)] if upper < kept.len() => {
                (mean_of_ranks(kept, [lower, upper]), true)
            }
            _ => (self.sizes[a].quantile(0.5), false),
        }
    }
}

impl Reduction for Clipped<'_> {
    const WIDE: bool = false;

    fn absorb(&mut self, chunk: &RowChunk<'_>) {
        let Clipping { shape, coefficients, clip, unit, near } = self.by;
        let Shape { features: p, outputs: q } = *shape;
        let rows = chunk.rows;
        let mut residuals: Vec<f64> = (p..p + q).flat_map(|j| chunk.column(j)).copied().collect();
        for (a, residual) in residuals.chunks_mut(rows.max(1)).enumerate() {
            for j in 0..p {
                let c = coefficients[(j, a)];
                add_multiple(residual, -c, chunk.column(j));
            }
            let clip = clip[a];
            let unit = unit[a].recip();
            let near = near[a].clone();
            for r in residual.iter_mut() {
                let size = r.abs() * unit;
                self.sizes[a].add(size);
                self.below[a] += u64::from(size < near.start);
                if near.contains(&size) {
                    self.kept[a].push(size);
                }
                self.inside[a] += u64::from(r.abs() <= clip);
                *r = r.clamp(-clip, clip);
            }
        }
        let clipped = |a: usize| &residuals[a * rows..][..rows];
        for a in 0..q {
            for j in 0..p {
                self.gradient[(j, a)] += dot(clipped(a), chunk.column(j));
            }
            for b in 0..=a {
                self.products[(b, a)] += dot(clipped(a), clipped(b));
            }
        }
    }

    fn merge(&mut self, later: Self) {
        self.gradient += later.gradient;
        self.products += later.products;
        self.inside.iter_mut().zip(later.inside).for_each(|(sum, n)| *sum += n);
        self.sizes.iter_mut().zip(&later.sizes).for_each(|(sum, sizes)| sum.merge(sizes));
        self.below.iter_mut().zip(later.below).for_each(|(sum, n)| *sum += n);
        self.kept.iter_mut().zip(later.kept).for_each(|(kept, later)| kept.extend(later));
    }
}

pub(super) fn solve<R: RowSource>(rows: &mut R, ridge: Ridge) -> Result<LeastSquares, R::Error> {
    let shape = rows.shape();
    let Shape { features: p, outputs: q } = shape;
    let r_factor = rows.pass(&RFactor::new(p, q))?;
    let mut solved = r_factor.solve(ridge)?;
    let n = solved.rows as f64;
    let norms: Vec<f64> = r_factor.r().col_iter().map(|column| column.norm_l2()).collect();
    let penalties = ridge.penalties(&norms);
    let rms = |a: usize| (solved.residual_products[(a, a)] / n).sqrt();
    let mut sigma: Vec<f64> = (0..q).map(rms).collect();
    let unit: Vec<f64> = sigma.iter().map(|&s| if s > 0.0 { s } else { 1.0 }).collect();
    let as_dear = MOST_PASSES as u64 * MANY / solved.rows.max(1);
    let most_passes = (as_dear as usize).clamp(MOST_PASSES, MOST_SHORT_PASSES);
    let rounding = |solved: &LeastSquares, a: usize| {
        let terms = (0..p).map(|j| solved.coefficients[(j, a)].abs() * norms[j]);
        ROUNDING * terms.sum::<f64>() / n.sqrt()
    };
    // Per column of `Y`: the fraction of its step that σ takes, and the previous step.
    let mut pace = vec![1.0_f64; q];
    let mut before = vec![0.0_f64; q];
    for pass_number in 0..most_passes {
        let clip = sigma.iter().map(|&s| if s > 0.0 { CLIP * s } else { f64::MAX }).collect();
        let coefficients = solved.coefficients.clone();
        let near = |a: usize| match solved.rows {
            ..=ALL_KEPT => 0.0..f64::INFINITY,
            _ => {
                let median = sigma[a] * QUARTILE / unit[a];
                median * (1.0 - NEAR)..median * (1.0 + NEAR)
            }
        };
        let near = (0..q).map(near).collect();
        let clipping = Clipping { shape, coefficients, clip, unit: unit.clone(), near };
        let mut clipped = rows.pass(&Clipped::new(&clipping))?;
        let medians: Vec<_> = (0..q).map(|a| clipped.median(a, solved.rows)).collect();
        let Clipped { mut gradient, products, inside, .. } = clipped;
        for a in 0..q {
            for j in 0..p {
                gradient[(j, a)] -= penalties[j] * solved.coefficients[(j, a)];
            }
        }
        let inner = solved.factor.transpose() * &gradient;
        let step = &solved.factor * &inner;
        // Mean of ψ': the share of unclipped rows. Above 1/2, a step lengthened by its inverse is certain to improve.
        let share = |a: usize| inside[a] as f64 / n;
        let mut settled = true;
        for a in 0..q {
            let step_length = share(a).max(1.0 / 1.9).recip();
            for j in 0..p {
                solved.coefficients[(j, a)] += step_length * step[(j, a)];
            }
            let rounding = rounding(&solved, a);
            let (median, is_exact) = medians[a];
            let scale = (median.max(SMALLEST) * unit[a] / QUARTILE).max(rounding);
            settled &= inner.col(a).norm_l2() <= STEP * sigma[a] + n.sqrt() * rounding;
            if sigma[a] <= 0.0 {
                continue;
            }
            let way = (scale / sigma[a]).ln();
            settled &= is_exact && way.abs() <= STEP + rounding / sigma[a];
            if pass_number >= FREE_PASSES {
                pace[a] = match way * before[a] < 0.0 {
                    true => (pace[a] * SHORTER).max(SHORTEST),
                    false => (pace[a] * LONGER).min(1.0),
                };
            }
            before[a] = way;
            sigma[a] *= (pace[a] * way).exp();
        }
        solved.residual_products = Mat::from_fn(q, q, |a, b| {
            let correction = |a: usize| {
                let m = share(a).max(1.0 / n);
                (1.0 + p as f64 / n * (1.0 - m) / m) / m
            };
            products[(a.min(b), a.max(b))] * correction(a) * correction(b)
        });
        if settled {
            let finite = solved.coefficients.is_all_finite();
            return if finite { Ok(solved) } else { Err(LeastSquaresError::NotFinite.into()) };
        }
    }
    Err(LeastSquaresError::NotConverged { passes: most_passes }.into())
}

#[cfg(test)]
mod tests {
    use super::super::SolverKind;
    use super::super::dense::{Dense, solve_dense};
    use faer::linalg::solvers::SolveLstsq;
    use system_tests::random::Random;

    use super::*;

    /// Brownlee's stack loss data: air flow, water temperature, acid concentration, loss.
    const STACK_LOSS: [[f64; 4]; 21] = [
        [80.0, 27.0, 89.0, 42.0],
        [80.0, 27.0, 88.0, 37.0],
        [75.0, 25.0, 90.0, 37.0],
        [62.0, 24.0, 87.0, 28.0],
        [62.0, 22.0, 87.0, 18.0],
        [62.0, 23.0, 87.0, 18.0],
        [62.0, 24.0, 93.0, 19.0],
        [62.0, 24.0, 93.0, 20.0],
        [58.0, 23.0, 87.0, 15.0],
        [58.0, 18.0, 80.0, 14.0],
        [58.0, 18.0, 89.0, 14.0],
        [58.0, 17.0, 88.0, 13.0],
        [58.0, 18.0, 82.0, 11.0],
        [58.0, 19.0, 93.0, 12.0],
        [50.0, 18.0, 89.0, 8.0],
        [50.0, 18.0, 86.0, 7.0],
        [50.0, 19.0, 72.0, 8.0],
        [50.0, 19.0, 79.0, 8.0],
        [50.0, 20.0, 80.0, 9.0],
        [56.0, 20.0, 82.0, 15.0],
        [70.0, 20.0, 91.0, 15.0],
    ];

    #[test]
    fn stack_loss_gives_the_published_robust_regression() {
        let x = Mat::from_fn(21, 4, |i, j| if j == 3 { 1.0 } else { STACK_LOSS[i][j] });
        let y = Mat::from_fn(21, 1, |i, _| STACK_LOSS[i][3]);
        let rows = Dense::new(x.as_ref(), None, y.as_ref());
        let solved = solve_dense(rows, SolverKind::Huber, Ridge::NONE).unwrap();
        // `summary(rlm(stack.loss ~ ., stackloss))`, Venables & Ripley, MASS, 4th ed., §6.5: coefficients and
        // standard errors.
        let published = [(0.8294, 0.1112), (0.9261, 0.3034), (-0.1278, 0.1289), (-41.0265, 9.8073)];
        let variance = solved.residual_products[(0, 0)] / 17.0;
        for (j, (coefficient, error)) in published.into_iter().enumerate() {
            // Tolerance: the printed digits, and the default convergence of `rlm`, 1e-4 of the residuals.
            let found = solved.coefficients[(j, 0)];
            assert!((found - coefficient).abs() < 2e-3 * error + 5e-5, "{j}: {found}");
            let row = solved.factor.row(j);
            let found = (variance * row.iter().map(|f| f * f).sum::<f64>()).sqrt();
            assert!((found / error - 1.0).abs() < 3e-3, "{j}: {found}");
        }
    }

    #[test]
    fn outliers_hardly_change_the_fit_and_clean_rows_give_least_squares() {
        let x = Mat::from_fn(200, 2, |i, j| if j == 0 { i as f64 } else { 1.0 });
        let wave = |i: usize| ((i * 37) % 19) as f64 / 19.0 - 0.5;
        let line = |i: usize| 3.0 * i as f64 - 7.0;
        let solve = |y: &Mat<f64>, method| {
            let rows = Dense::new(x.as_ref(), None, y.as_ref());
            solve_dense(rows, method, Ridge::NONE).unwrap().coefficients
        };
        let wild = Mat::from_fn(200, 1, |i, _| if i % 20 == 3 { 1e6 } else { line(i) + wave(i) });
        let robust = solve(&wild, SolverKind::Huber);
        assert!((robust[(0, 0)] - 3.0).abs() < 1e-2, "{}", robust[(0, 0)]);
        assert!((solve(&wild, SolverKind::Tsqr)[(0, 0)] - 3.0).abs() > 1.0);
        let exact = Mat::from_fn(200, 1, |i, _| line(i));
        let robust = solve(&exact, SolverKind::Huber);
        assert!((robust[(0, 0)] - 3.0).abs() < 1e-12 && (robust[(1, 0)] + 7.0).abs() < 1e-10);
    }

    /// Dense iteratively reweighted least squares by QR, with the median of all residuals. `None` without
    /// convergence.
    fn reweighted(x: &Mat<f64>, y: &Mat<f64>) -> Option<(Mat<f64>, f64)> {
        let (n, p) = (x.nrows(), x.ncols());
        let mut weights = vec![1.0; n];
        let mut before: Option<Mat<f64>> = None;
        for _ in 0..5000 {
            let weighted = Mat::from_fn(n, p, |i, j| x[(i, j)] * f64::sqrt(weights[i]));
            let target = Mat::from_fn(n, 1, |i, _| y[(i, 0)] * f64::sqrt(weights[i]));
            let found = weighted.qr().solve_lstsq(&target);
            let residual = y - x * &found;
            let mut sizes: Vec<f64> = residual.col(0).iter().map(|r| r.abs()).collect();
            sizes.sort_unstable_by(f64::total_cmp);
            let sigma = 0.5 * (sizes[(n - 1) / 2] + sizes[n / 2]) / QUARTILE;
            if let Some(before) = before
                && (x * (&found - before)).norm_l2() < 1e-11 * sigma
            {
                return Some((found, sigma));
            }
            for (weight, r) in weights.iter_mut().zip(residual.col(0).iter()) {
                *weight = (CLIP * sigma / r.abs()).min(1.0);
            }
            before = Some(found);
        }
        None
    }

    #[test]
    fn reweighted_least_squares_gives_the_same_fit() {
        let mut random = Random(3);
        let mut unit = move || random.unit();
        let mut compared = 0;
        for case in 0..300 {
            let p = 2 + case % 8;
            let n = match case {
                299 => 30_000,
                _ => 3 * p + 5 + (case * 37) % (36 * p),
            };
            let wild = [0.05, 0.15, 0.25][case % 3];
            let size = [1.0, 5.0, 50.0][case / 3 % 3];
            let mut normal = || (0..12).map(|_| unit()).sum::<f64>() - 6.0;
            let x = Mat::from_fn(n, p, |_, j| if j == 0 { 1.0 } else { normal() });
            let y = Mat::from_fn(n, 1, |i, _| {
                let is_wild = normal().abs() < 1.25 * wild;
                x.row(i).iter().sum::<f64>() + 0.1 * normal() + if is_wild { size } else { 0.0 }
            });
            let Some((expected, sigma)) = reweighted(&x, &y) else { continue };
            compared += 1;
            let rows = Dense::new(x.as_ref(), None, y.as_ref());
            let solved = solve_dense(rows, SolverKind::Huber, Ridge::NONE)
                .unwrap_or_else(|error| panic!("{case}, {n} rows, {p} columns: {error}"));
            let off = &x * (&solved.coefficients - expected);
            let off = off.col(0).iter().map(|d| d.abs()).fold(0.0, f64::max);
            // Both stop some ten steps of 1e-8 short of the solution.
            assert!(off < 1e-6 * sigma, "{case}, {n} rows, {p} columns: {} sigma", off / sigma);
        }
        assert!(compared >= 290, "{compared}");
    }

    #[test]
    fn a_few_rows_have_a_solution_of_the_equations() {
        let mut random = Random(7);
        let mut unit = move || random.unit();
        for case in 0..400 {
            let p = 1 + case % 5;
            // With fewer rows than twice the columns, outliers cannot be identified.
            let n = 2 * p + 2 + case % 17;
            let x = Mat::from_fn(n, p, |_, j| if j == 0 { 1.0 } else { unit() - 0.5 });
            let y = Mat::from_fn(n, 1, |i, _| {
                x.row(i).iter().sum::<f64>() + 0.1 * unit() + if unit() < 0.25 { 50.0 } else { 0.0 }
            });
            let rows = Dense::new(x.as_ref(), None, y.as_ref());
            let solved = solve_dense(rows, SolverKind::Huber, Ridge::NONE)
                .unwrap_or_else(|error| panic!("{n} rows, {p} columns: {error}"));
            let residual = &y - &x * &solved.coefficients;
            let mut sizes: Vec<f64> = residual.col(0).iter().map(|r| r.abs()).collect();
            sizes.sort_unstable_by(f64::total_cmp);
            // The converged σ follows from the sizes of these residuals. Clipped with it, they must be orthogonal to
            // the columns.
            let solves = |sigma: f64| {
                let clip = CLIP * sigma;
                (0..p).all(|j| {
                    let terms = (0..n).map(|i| residual[(i, 0)].clamp(-clip, clip) * x[(i, j)]);
                    terms.sum::<f64>().abs() <= 0.05 * clip
                })
            };
            let (low, high) = (sizes[0].max(1e-9) / QUARTILE, sizes[n - 1] / QUARTILE);
            let grid = (0..=4000).map(|k| low * (high / low).powf(f64::from(k) / 4000.0));
            assert!(grid.into_iter().any(solves), "{case}: {n} rows, {p} columns");
        }
    }
}
