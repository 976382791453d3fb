//! Ridge parameter by generalised cross-validation (Golub, Heath and Wahba, Technometrics 21, 1979).
//!
//! The penalised columns are made orthogonal to the free (unpenalised) column, scaled to norm one and factored as
//! `U·S·Vᵀ`. Sums over singular values then give, for every λ:
//!
//! ```text
//! GCV(λ) = (RSS(λ)/n) / (1 − t(λ)/n)²    t = Σ s²/(s² + λ), and 1 for the free column
//! RSS(λ) = RSS(0) + Σ (λ/(s² + λ))²·b²   b = UᵀY
//! ```
//!
//! All columns of `Y` share one λ. It minimises the sum of the logarithms of their GCV; units do not affect it.

use faer::Mat;

use crate::r_factor::{LeastSquaresError, RFactor, Ridge};

const PER_DECADE: usize = 8;
/// Range of the exponents of λ, relative to the largest squared singular value.
const RANGE: (f64, f64) = (-20.0, 4.0);

/// Best λ; zero if the best is at the lower end of the search.
pub(super) fn lambda(
    r_factor: &RFactor,
    free_column: Option<usize>,
) -> Result<f64, LeastSquaresError> {
    let (largest, criterion) = criterion(r_factor, free_column)?;
    let steps = ((RANGE.1 - RANGE.0) as usize) * PER_DECADE;
    let exponent = |step: usize| RANGE.0 + step as f64 / PER_DECADE as f64;
    let best = (0..=steps)
        .min_by(|&a, &b| criterion(exponent(a)).total_cmp(&criterion(exponent(b))))
        .unwrap_or(0);
    if best == 0 {
        return Ok(0.0);
    }
    let (low, high) = (exponent(best - 1), exponent((best + 1).min(steps)));
    Ok(largest * 10_f64.powf(golden_section(low, high, criterion)))
}

/// Largest squared singular value, and the criterion for λ = 10^exponent times that value.
fn criterion(
    r_factor: &RFactor,
    free_column: Option<usize>,
) -> Result<(f64, impl Fn(f64) -> f64), LeastSquaresError> {
    let (r, z) = r_factor.damped_parts(Ridge::NONE);
    let (p, q) = z.shape();
    let free = usize::from(free_column.is_some());
    if r_factor.rows <= (free + 1) as u64 {
        return Err(LeastSquaresError::TooFewRows { rows: r_factor.rows, columns: p });
    }
    if !r.is_all_finite() || !z.is_all_finite() {
        return Err(LeastSquaresError::NotFinite);
    }
    // The free column comes first; the rows below the first are then orthogonal to it.
    let order: Vec<usize> =
        free_column.into_iter().chain((0..p).filter(|&j| Some(j) != free_column)).collect();
    let moved = Mat::from_fn(p, p, |i, j| r[(i, order[j])]);
    let (turned, z) = RFactor::from_rows(&moved, &z).damped_parts(Ridge::NONE);
    let unit = |norm: f64| if norm > 0.0 { norm } else { 1.0 };
    let norms: Vec<f64> = order.iter().map(|&j| unit(r.col(j).norm_l2())).collect();
    let m = p - free;
    let scaled = Mat::from_fn(m, m, |i, j| {
        if i <= j { turned[(free + i, free + j)] / norms[free + j] } else { 0.0 }
    });
    let svd = scaled.svd().map_err(|_| LeastSquaresError::NotFinite)?;
    let b = svd.U().transpose() * z.subrows(free, m);
    let squares: Vec<f64> = svd.S().column_vector().iter().map(|s| s * s).collect();
    let largest = squares.first().copied().unwrap_or(1.0);
    let (rows, solved) = (r_factor.rows as f64, r_factor.rest_products());
    let at = move |exponent: f64| {
        let lambda = largest * 10_f64.powf(exponent);
        let kept: f64 = squares.iter().map(|s| s / (s + lambda)).sum();
        let freedom = rows - free as f64 - kept;
        let score = |a: usize| {
            let shrunk = squares.iter().enumerate().map(|(i, s)| {
                let share = lambda / (s + lambda);
                share * share * (b[(i, a)] * b[(i, a)])
            });
            (solved[(a, a)] + shrunk.sum::<f64>()).max(f64::MIN_POSITIVE).ln()
                - 2.0 * freedom.max(f64::MIN_POSITIVE).ln()
        };
        (0..q).map(score).sum()
    };
    Ok((largest, at))
}

/// Minimises `f` between `low` and `high`, to a thousandth of their distance.
fn golden_section(mut low: f64, mut high: f64, f: impl Fn(f64) -> f64) -> f64 {
    let ratio = (5_f64.sqrt() - 1.0) / 2.0;
    for _ in 0..16 {
        let (a, b) = (high - ratio * (high - low), low + ratio * (high - low));
        if f(a) <= f(b) { high = b } else { low = a }
    }
    (low + high) / 2.0
}

#[cfg(test)]
mod tests {
    use faer::linalg::solvers::Solve;
    use faer::{Mat, Side};

    use super::super::dense::{Dense, solve_dense};
    use super::super::{Ridge, SolverKind};

    fn gcv(x: &Mat<f64>, y: &Mat<f64>, lambda: f64) -> f64 {
        let (n, p) = x.shape();
        let mut gram = x.transpose() * x;
        for j in 0..p - 1 {
            gram[(j, j)] += lambda * x.col(j).squared_norm_l2();
        }
        let hat = x * gram.llt(Side::Lower).unwrap().solve(x.transpose());
        let freedom = n as f64 - (0..n).map(|i| hat[(i, i)]).sum::<f64>();
        let residual = y - hat * y;
        residual.col_iter().map(|r| (r.squared_norm_l2() / freedom / freedom).ln()).sum()
    }

    #[test]
    fn the_ridge_chosen_has_the_smallest_score_of_all() {
        // Nearly collinear columns, an intercept, and noise: some ridge helps.
        let noise = |i: usize, j: usize| {
            (((i * 131 + j * 57 + 11) * 2_654_435) % 1009) as f64 / 504.5 - 1.0
        };
        let x = Mat::from_fn(40, 6, |i, j| match j {
            5 => 1.0,
            _ => noise(i, 9) + 0.05 * noise(i, j) + 3.0,
        });
        let y = Mat::from_fn(40, 2, |i, a| noise(i, 9) + 0.5 * noise(i, 20 + a));
        let rows = || Dense::new(x.as_ref(), None, y.as_ref());
        let ridge = Ridge { lambda: 0.0, free_column: Some(5) };
        let chosen = solve_dense(rows(), SolverKind::RidgeGcv, ridge).unwrap();
        // The coefficients, which shrink with λ, bracket the chosen λ.
        let score = |lambda: f64| gcv(&x, &y, lambda);
        let grid = (0..=160).map(|k| 10_f64.powf(-10.0 + 0.08 * f64::from(k)));
        let best = grid.min_by(|&a, &b| score(a).total_cmp(&score(b))).unwrap();
        let at = |lambda| {
            solve_dense(rows(), SolverKind::Tsqr, Ridge { lambda, ..ridge }).unwrap().coefficients
        };
        let (below, above) = (at(best / 1.21), at(best * 1.21));
        assert!(best > 1e-8 && best < 1e2, "{best}: a ridge inside the search");
        for j in 0..6 {
            let (low, high) = (below[(j, 0)].min(above[(j, 0)]), below[(j, 0)].max(above[(j, 0)]));
            let found = chosen.coefficients[(j, 0)];
            let slack = 1e-9 + 0.05 * (high - low);
            assert!(low - slack <= found && found <= high + slack, "{j}: {low} {found} {high}");
        }
    }
}
