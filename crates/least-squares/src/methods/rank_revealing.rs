//! Column pivoting and singular values from the R factor: `X = Q·R` with orthonormal `Q`, so
//! `R` has the pivots, singular values and directions of `X`.

use faer::linalg::triangular_solve;
use faer::{Mat, Par};

use crate::r_factor::{LeastSquares, LeastSquaresError, RFactor, Ridge, equilibrated};

/// Solves by QR with column pivoting of the equilibrated R factor. Singular values decide the rank,
/// as in [`RFactor::solve`]: the diagonal may stay large while the smallest singular value does not
/// (Golub & Van Loan 4e, §5.4.2).
pub(super) fn pivoted(r_factor: &RFactor, ridge: Ridge) -> Result<LeastSquares, LeastSquaresError> {
    let mut solved = r_factor.solve(ridge)?;
    let (r, z) = r_factor.damped_parts(ridge);
    let (unit, norms) = equilibrated(r.as_ref());
    let pivoted = unit.col_piv_qr();
    let mut rotated = pivoted.compute_Q().transpose() * &z;
    triangular_solve::solve_upper_triangular_in_place(pivoted.R(), rotated.as_mut(), Par::Seq);
    let (order, _) = pivoted.P().arrays();
    for (k, &column) in order.iter().enumerate() {
        for a in 0..z.ncols() {
            solved.coefficients[(column, a)] = rotated[(k, a)] / norms[column];
        }
    }
    Ok(with_residuals_of(solved, r_factor))
}

/// Solves by singular values of the equilibrated R factor. Values below the fraction `truncate` of the largest are
/// dropped. The result is then the shortest vector that fits the other directions, `rank` in number.
pub(super) fn svd(
    r_factor: &RFactor,
    ridge: Ridge,
    truncate: Option<f64>,
) -> Result<LeastSquares, LeastSquaresError> {
    let (r, z) = r_factor.damped_parts(ridge);
    if !r.is_all_finite() || !z.is_all_finite() {
        return Err(LeastSquaresError::NotFinite);
    }
    let (p, q) = z.shape();
    let mut solved = match truncate {
        None => r_factor.solve(ridge)?,
        Some(_) if r_factor.rows == 0 => {
            return Err(LeastSquaresError::TooFewRows { rows: 0, columns: p });
        }
        Some(_) => LeastSquares {
            coefficients: Mat::zeros(p, q),
            factor: Mat::zeros(p, p),
            residual_products: Mat::zeros(q, q),
            rows: r_factor.rows,
            condition: 1.0,
            rank: p,
        },
    };
    let share = truncate.unwrap_or(0.0);
    let (scaled, norms) = equilibrated(r.as_ref());
    let svd = scaled.svd().map_err(|_| LeastSquaresError::NotFinite)?;
    let values: Vec<f64> = svd.S().column_vector().iter().copied().collect();
    let largest = values.first().copied().unwrap_or(0.0);
    let rank = values.iter().filter(|&&s| s > share * largest && s > 0.0).count();
    let mut rotated = svd.U().transpose() * &z;
    for (i, &value) in values.iter().enumerate() {
        let weight = if i < rank { value.recip() } else { 0.0 };
        rotated.row_mut(i).iter_mut().for_each(|b| *b *= weight);
    }
    let coefficients = svd.V() * rotated;
    solved.coefficients = Mat::from_fn(p, q, |i, a| coefficients[(i, a)] / norms[i]);
    if rank < p || share > 0.0 {
        // (XᵀX)⁺ = V·S⁻²·Vᵀ; a QR factorisation makes its root triangular.
        let root = Mat::from_fn(p, p, |i, j| {
            // Rows and columns are reversed, which gives an upper triangle.
            let (row, feature) = (i, p - 1 - j);
            let weight = if row < rank { values[row].recip() } else { 0.0 };
            weight * svd.V()[(feature, row)] / norms[feature]
        });
        let nothing = Mat::zeros(p, 0);
        let (r_factor, _) = RFactor::from_rows(&root, &nothing).damped_parts(Ridge::NONE);
        solved.factor =
            Mat::from_fn(p, p, |i, j| if i <= j { r_factor[(p - 1 - j, p - 1 - i)] } else { 0.0 });
        solved.condition = largest / values.get(rank.max(1) - 1).copied().unwrap_or(largest);
    }
    solved.rank = rank;
    if !solved.coefficients.is_all_finite() {
        return Err(LeastSquaresError::NotFinite);
    }
    Ok(with_residuals_of(solved, r_factor))
}

fn with_residuals_of(mut solved: LeastSquares, r_factor: &RFactor) -> LeastSquares {
    solved.residual_products = r_factor.residual_products(solved.coefficients.as_ref());
    solved
}

#[cfg(test)]
mod tests {
    use super::super::dense::{Dense, solve_dense};
    use super::super::{Method, SolverKind};
    use super::*;

    fn noise(i: usize, j: usize) -> f64 {
        (((i * 131 + j * 577 + 11) * 2_654_435) % 1009) as f64 - 504.0
    }

    #[test]
    fn truncation_shares_a_coefficient_between_equal_columns_and_returns_the_rank() {
        let x = Mat::from_fn(60, 4, |i, j| if j == 3 { noise(i, 1) } else { noise(i, j) });
        let y = Mat::from_fn(60, 1, |i, _| 3.0 * noise(i, 0) + 4.0 * noise(i, 1));
        let rows = || Dense::new(x.as_ref(), None, y.as_ref());
        let solve = |truncate| {
            solve_dense(rows(), Method { solver: SolverKind::Svd, truncate }, Ridge::NONE)
        };
        assert!(matches!(solve(None), Err(LeastSquaresError::RankDeficient { rank: 3, .. })));
        let solved = solve(Some(1e-10)).unwrap();
        assert_eq!(solved.rank, 3);
        for (j, expected) in [3.0, 2.0, 0.0, 2.0].into_iter().enumerate() {
            assert!((solved.coefficients[(j, 0)] - expected).abs() < 1e-12);
        }
        // F·Fᵀ is the pseudo-inverse of XᵀX in scaled columns: G·(F·Fᵀ)·G = G.
        let gram = x.transpose() * &x;
        let inverse = &solved.factor * solved.factor.transpose();
        let product = &gram * inverse * &gram;
        assert!((product - &gram).norm_max() < 1e-12 * gram.norm_max());
        assert!((0..4).all(|j| (0..j).all(|i| solved.factor[(j, i)] == 0.0)));
    }

    #[test]
    fn every_method_gives_the_same_ridge() {
        let x = Mat::from_fn(60, 4, |i, j| if j == 3 { 1.0 } else { noise(i, j) + 700.0 });
        let y = Mat::from_fn(60, 2, noise);
        let ridge = Ridge { lambda: 0.01, free_column: Some(3) };
        let solve =
            |method| solve_dense(Dense::new(x.as_ref(), None, y.as_ref()), method, ridge).unwrap();
        let expected = solve(SolverKind::Tsqr);
        for method in [
            SolverKind::RefinedTsqr,
            SolverKind::PivotedQr,
            SolverKind::Svd,
            SolverKind::Gram,
            SolverKind::WideGram,
            SolverKind::WideTsqr,
        ] {
            let solved = solve(method);
            let close = |a: &Mat<f64>, b: &Mat<f64>| (a - b).norm_max() <= 1e-11 * b.norm_max();
            assert!(close(&solved.coefficients, &expected.coefficients), "{method:?}");
            assert!(close(&solved.residual_products, &expected.residual_products), "{method:?}");
            let inverse = |s: &LeastSquares| &s.factor * s.factor.transpose();
            assert!(close(&inverse(&solved), &inverse(&expected)), "{method:?}");
            assert!((solved.condition / expected.condition - 1.0).abs() < 1e-9, "{method:?}");
        }
    }
}
