//! Huber's M-estimator of regression: each column of `Y` on its own, rows far off count less.
//!
//! Solves `Σ ψ(rᵢ/σ)·xᵢ = 0` with `ψ(u) = max(−k, min(k, u))`, k = 1.345 (95 % efficiency for
//! normal errors), and σ the median of `|r|` over 0.6745, as R's `MASS::rlm` does by default. These
//! are the equations that iteratively reweighted least squares solves. Here they are solved by
//! modified residuals (Huber, Robust Statistics, 1981, §7.8): clip the residuals, and correct by the
//! least-squares fit of what is left, `C += q·(XᵀX)⁻¹Xᵀψ`. Every pass over the rows then costs a
//! gradient and no factorisation, which would be one for each column of `Y`, and for
//! q < 2 each step is certain to improve. The median of all rows is read off a histogram of
//! logarithmic bins, to four parts in a thousand at worst, and nearer where rows are many.
//!
//! Products of residuals are those of Huber's pseudo-residuals, `K·ψ(rᵢ/σ)·σ/mean ψ'`, so that
//! covariances of coefficients follow from them as in least squares (§7.6).

use faer::Mat;

use super::qr::FormTriangle;
use super::rows::{Reduction, RowChunk, Rows, Shape};
use crate::magnitudes::FineMagnitudes;
use crate::triangle::{LeastSquares, LeastSquaresError, Ridge};
use crate::vectors::{add_multiple, dot};

/// Residuals are clipped beyond this many σ.
const CLIP: f64 = 1.345;
/// The third quartile of the standard normal distribution.
const QUARTILE: f64 = 0.674_489_750_196_081_7;
/// Passes over many rows; over few, where some decide their own residuals and steps are short,
/// as many more as cost the same.
const MOST_PASSES: usize = 100;
/// Rows that count as many.
const MANY: u64 = 100_000;
/// Passes over however few rows.
const MOST_SHORT_PASSES: usize = 20_000;
/// Passes end when a step is smaller than this share of the standard errors.
const STEP: f64 = 1e-6;
/// σ stays as it is after so many passes, which a median of few rows may need to come to rest.
const SCALE_PASSES: usize = 20;
/// It also stays while it would change by less than this share.
const SCALE: f64 = 1e-4;
/// The smallest σ, as a share of the RMS: where most rows are fitted without error, others must not
/// count for nothing.
const SMALLEST: f64 = 1e-12;

/// Forms the gradient of clipped residuals.
struct FormClipped {
    shape: Shape,
    coefficients: Mat<f64>,
    /// Where each column of `Y` is clipped, σ·k.
    clip: Vec<f64>,
    /// What sizes of residuals are counted in.
    unit: Vec<f64>,
}

/// What clipped residuals add up to.
#[derive(Clone)]
struct Clipped {
    /// `XᵀΨ`, Ψ in units of `Y`.
    gradient: Mat<f64>,
    /// `ΨᵀΨ`.
    products: Mat<f64>,
    /// Residuals that were not clipped, per column of `Y`.
    inside: Vec<u64>,
    sizes: Vec<FineMagnitudes>,
}

impl Reduction for FormClipped {
    type Partial = Clipped;
    type Scratch = Vec<f64>;
    const WIDE: bool = false;

    fn empty(&self) -> Clipped {
        let Shape { features: p, outputs: q } = self.shape;
        Clipped {
            gradient: Mat::zeros(p, q),
            products: Mat::zeros(q, q),
            inside: vec![0; q],
            sizes: vec![FineMagnitudes::new(); q],
        }
    }

    fn scratch(&self) -> Vec<f64> {
        Vec::new()
    }

    fn absorb(&self, sums: &mut Clipped, chunk: &RowChunk<'_>, residuals: &mut Vec<f64>) {
        let Shape { features: p, outputs: q } = self.shape;
        let rows = chunk.rows;
        residuals.clear();
        (0..q).for_each(|a| residuals.extend(chunk.column(p + a)));
        for (a, residual) in residuals.chunks_mut(rows.max(1)).enumerate() {
            for j in 0..p {
                let c = self.coefficients[(j, a)];
                add_multiple(residual, -c, chunk.column(j));
            }
            let clip = self.clip[a];
            let unit = self.unit[a].recip();
            for r in residual.iter_mut() {
                sums.sizes[a].add(r.abs() * unit);
                sums.inside[a] += u64::from(r.abs() <= clip);
                *r = r.clamp(-clip, clip);
            }
        }
        let clipped = |a: usize| &residuals[a * rows..][..rows];
        for a in 0..q {
            for j in 0..p {
                sums.gradient[(j, a)] += dot(clipped(a), chunk.column(j));
            }
            for b in 0..=a {
                sums.products[(b, a)] += dot(clipped(a), clipped(b));
            }
        }
    }

    fn merge(&self, earlier: &mut Clipped, later: Clipped) {
        earlier.gradient += later.gradient;
        earlier.products += later.products;
        earlier.inside.iter_mut().zip(later.inside).for_each(|(sum, n)| *sum += n);
        earlier.sizes.iter_mut().zip(&later.sizes).for_each(|(sum, sizes)| sum.merge(sizes));
    }
}

/// Solves by least squares and modified residuals.
pub(super) fn solve<R: Rows>(rows: &mut R, ridge: Ridge) -> Result<LeastSquares, R::Error> {
    let shape = rows.shape();
    let Shape { features: p, outputs: q } = shape;
    let triangle = rows.pass(&FormTriangle { shape })?;
    let mut solved = triangle.solve(ridge)?;
    let n = solved.rows as f64;
    let norms: Vec<f64> = triangle.r().col_iter().map(|column| column.norm_l2()).collect();
    let penalty = |j: usize| {
        if ridge.free_column == Some(j) { 0.0 } else { ridge.lambda * norms[j] * norms[j] }
    };
    let rms = |a: usize| (solved.residual_products[(a, a)] / n).sqrt();
    let mut sigma: Vec<f64> = (0..q).map(rms).collect();
    // A column that is fitted without error is clipped nowhere, and its residuals are all alike.
    let unit: Vec<f64> = sigma.iter().map(|&s| if s > 0.0 { s } else { 1.0 }).collect();
    let as_dear = MOST_PASSES as u64 * MANY / solved.rows.max(1);
    let most_passes = (as_dear as usize).clamp(MOST_PASSES, MOST_SHORT_PASSES);
    for pass_number in 0..most_passes {
        let clip = sigma.iter().map(|&s| if s > 0.0 { CLIP * s } else { f64::MAX }).collect();
        let coefficients = solved.coefficients.clone();
        let pass = FormClipped { shape, coefficients, clip, unit: unit.clone() };
        let Clipped { mut gradient, products, inside, sizes } = rows.pass(&pass)?;
        for a in 0..q {
            for j in 0..p {
                gradient[(j, a)] -= penalty(j) * solved.coefficients[(j, a)];
            }
        }
        let inner = solved.factor.transpose() * &gradient;
        let step = &solved.factor * &inner;
        // The mean of ψ', the share of rows that count in full; beyond a half, a step longer by
        // its inverse is still certain to improve.
        let share = |a: usize| inside[a] as f64 / n;
        let mut settled = true;
        for a in 0..q {
            let stretch = share(a).max(1.0 / 1.9).recip();
            for j in 0..p {
                solved.coefficients[(j, a)] += stretch * step[(j, a)];
            }
            let scale = match sizes[a].quantile(0.5).max(SMALLEST) * unit[a] / QUARTILE {
                scale if pass_number < SCALE_PASSES && (scale / sigma[a] - 1.0).abs() > SCALE => {
                    scale
                }
                _ => sigma[a],
            };
            settled &= inner.col(a).norm_l2() <= STEP * sigma[a] && scale == sigma[a];
            sigma[a] = scale;
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
    use super::super::{Dense, Method, solve_dense};
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
        let solved = solve_dense(rows, Method::Huber, Ridge::NONE).unwrap();
        // `summary(rlm(stack.loss ~ ., stackloss))`, Venables & Ripley, MASS, 4th ed., §6.5:
        // coefficient and standard error of each column.
        let published = [(0.8294, 0.1112), (0.9261, 0.3034), (-0.1278, 0.1289), (-41.0265, 9.8073)];
        let variance = solved.residual_products[(0, 0)] / 17.0;
        for (j, (coefficient, error)) in published.into_iter().enumerate() {
            // The printed digits, and a median from bins of four parts in a thousand.
            let found = solved.coefficients[(j, 0)];
            assert!((found - coefficient).abs() < 2e-3 * error + 5e-5, "{j}: {found}");
            let row = solved.factor.row(j);
            let found = (variance * row.iter().map(|f| f * f).sum::<f64>()).sqrt();
            assert!((found / error - 1.0).abs() < 3e-3, "{j}: {found}");
        }
    }

    #[test]
    fn wild_rows_hardly_move_the_answer_and_clean_rows_give_least_squares() {
        let x = Mat::from_fn(200, 2, |i, j| if j == 0 { i as f64 } else { 1.0 });
        let wave = |i: usize| ((i * 37) % 19) as f64 / 19.0 - 0.5;
        let line = |i: usize| 3.0 * i as f64 - 7.0;
        let solve = |y: &Mat<f64>, method| {
            let rows = Dense::new(x.as_ref(), None, y.as_ref());
            solve_dense(rows, method, Ridge::NONE).unwrap().coefficients
        };
        let wild = Mat::from_fn(200, 1, |i, _| if i % 20 == 3 { 1e6 } else { line(i) + wave(i) });
        let robust = solve(&wild, Method::Huber);
        assert!((robust[(0, 0)] - 3.0).abs() < 1e-2, "{}", robust[(0, 0)]);
        assert!((solve(&wild, Method::Tsqr)[(0, 0)] - 3.0).abs() > 1.0);
        let exact = Mat::from_fn(200, 1, |i, _| line(i));
        let robust = solve(&exact, Method::Huber);
        assert!((robust[(0, 0)] - 3.0).abs() < 1e-12 && (robust[(1, 0)] + 7.0).abs() < 1e-10);
    }

    #[test]
    fn a_handful_of_rows_has_an_answer_that_solves_the_equations() {
        let mut random = Random(7);
        let mut unit = move || random.unit();
        for case in 0..400 {
            let p = 1 + case % 5;
            // With fewer rows than twice the columns there is no telling which are wild.
            let n = 2 * p + 2 + case % 17;
            let x = Mat::from_fn(n, p, |_, j| if j == 0 { 1.0 } else { unit() - 0.5 });
            // One row in four is wild.
            let y = Mat::from_fn(n, 1, |i, _| {
                x.row(i).iter().sum::<f64>() + 0.1 * unit() + if unit() < 0.25 { 50.0 } else { 0.0 }
            });
            let rows = Dense::new(x.as_ref(), None, y.as_ref());
            let solved = solve_dense(rows, Method::Huber, Ridge::NONE)
                .unwrap_or_else(|error| panic!("{n} rows, {p} columns: {error}"));
            let residual = &y - &x * &solved.coefficients;
            let mut sizes: Vec<f64> = residual.col(0).iter().map(|r| r.abs()).collect();
            sizes.sort_by(f64::total_cmp);
            // Whatever σ it settled on among the sizes of these residuals: clipped there, they must
            // be orthogonal to the columns.
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
