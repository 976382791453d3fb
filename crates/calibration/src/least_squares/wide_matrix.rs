//! Small matrices in double-double, and the answer that a wide R factor gives.

use faer::Mat;

use crate::double_double::DoubleDouble;
use crate::r_factor::{LeastSquares, LeastSquaresError, equilibrated, rank_deficient};

/// A matrix in double-double.
pub(super) type WideMatrix = Mat<DoubleDouble>;

pub(super) fn rounded(matrix: &WideMatrix) -> Mat<f64> {
    Mat::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)].to_f64())
}

pub(super) fn is_finite(matrix: &WideMatrix) -> bool {
    matrix.col_iter().flat_map(|column| column.iter()).all(|e| e.is_finite())
}

/// `Σ aᵢ·bᵢ` of the elements that both have.
pub(super) fn product(a: &[DoubleDouble], b: &[DoubleDouble]) -> DoubleDouble {
    a.iter().zip(b).map(|(&a, &b)| a * b).sum()
}

/// `XᵀX = RᵀR`; `None` if a pivot is not positive.
pub(super) fn cholesky(gram: &WideMatrix) -> Option<WideMatrix> {
    let p = gram.ncols();
    let mut r = WideMatrix::from_fn(p, p, |_, _| DoubleDouble::ZERO);
    for j in 0..p {
        for i in 0..=j {
            let rest = gram[(i, j)] - product(&r.col_as_slice(i)[..i], r.col_as_slice(j));
            if i < j {
                r[(i, j)] = rest / r[(i, i)];
            } else if rest.to_f64() > 0.0 {
                r[(j, j)] = rest.sqrt();
            } else {
                return None;
            }
        }
    }
    Some(r)
}

/// Solves `R·C = Z` with an upper triangle `R`.
pub(super) fn solve_upper(r: &WideMatrix, z: &WideMatrix) -> WideMatrix {
    let p = r.ncols();
    let mut c = z.clone();
    for a in 0..z.ncols() {
        for i in (0..p).rev() {
            let known = (i + 1..p).map(|k| r[(i, k)] * c[(k, a)]).sum();
            c[(i, a)] = (c[(i, a)] - known) / r[(i, i)];
        }
    }
    c
}

/// Solves `Rᵀ·C = Z` with an upper triangle `R`.
pub(super) fn solve_transposed(r: &WideMatrix, z: &WideMatrix) -> WideMatrix {
    let mut c = z.clone();
    for a in 0..z.ncols() {
        for i in 0..r.ncols() {
            let known = product(&r.col_as_slice(i)[..i], c.col_as_slice(a));
            c[(i, a)] = (c[(i, a)] - known) / r[(i, i)];
        }
    }
    c
}

/// Solves the least-squares problem that is reduced to `R`, p × p, the ridge among its rows, and `Z = QᵀY`, p × q.
///
/// `resolution` is how large a singular value of `R`, columns scaled to norm one, rounding may
/// have made out of zero. Singular values are those of the inverse, which `f64` gives to full
/// relative accuracy, so that a condition number of 10²⁰ is reported as such.
///
/// `residual_products` is `(Y − X·C)ᵀ(Y − X·C)` of `C`, q × q, as far as it is not due to the ridge.
pub(super) fn solve_triangle(
    r: &WideMatrix,
    z: &WideMatrix,
    resolution: f64,
    rows: u64,
    residual_products: impl FnOnce(&WideMatrix) -> Mat<f64>,
) -> Result<LeastSquares, LeastSquaresError> {
    let p = r.ncols();
    if !is_finite(r) || !is_finite(z) {
        return Err(LeastSquaresError::NotFinite);
    }
    let norm = |j: usize| {
        let squares = r.col_as_slice(j).iter().map(|e| e.to_f64() * e.to_f64());
        Some(squares.sum::<f64>().sqrt()).filter(|&n| n > 0.0).unwrap_or(1.0)
    };
    let norms: Vec<f64> = (0..p).map(norm).collect();
    let unit = WideMatrix::from_fn(p, p, |i, j| r[(i, j)] / DoubleDouble::from(norms[j]));
    let identity = WideMatrix::from_fn(p, p, |i, j| f64::from(u8::from(i == j)).into());
    let inverse = solve_upper(&unit, &identity);
    let size = largest_singular_value(&unit)?;
    // Rounding dependent columns leaves a singular value that is zero or tiny.
    let condition =
        if is_finite(&inverse) { size * largest_singular_value(&inverse)? } else { f64::INFINITY };
    if condition * resolution >= size {
        let r = rounded(r);
        let (_, rank) = spectrum(&r)?;
        return Err(rank_deficient(r.as_ref(), rank.min(p - 1)));
    }
    let solved = solve_upper(r, z);
    let coefficients = rounded(&solved);
    let factor = Mat::from_fn(p, p, |i, j| inverse[(i, j)].to_f64() / norms[i]);
    if !coefficients.is_all_finite() || !factor.is_all_finite() {
        return Err(LeastSquaresError::NotFinite);
    }
    let residual_products = residual_products(&solved);
    Ok(LeastSquares { coefficients, factor, residual_products, rows, condition, rank: p })
}

/// Condition number and rank, as far as `f64` can tell, of the upper triangle `r` with columns
/// scaled to norm one: for what a ridge has made solvable.
pub(super) fn spectrum(r: &Mat<f64>) -> Result<(f64, usize), LeastSquaresError> {
    let (scaled, _) = equilibrated(r.as_ref());
    let values = scaled.singular_values().map_err(|_| LeastSquaresError::NotFinite)?;
    let (Some(largest), Some(smallest)) = (values.first(), values.last()) else {
        return Ok((1.0, 0));
    };
    let tolerance = f64::EPSILON * r.ncols() as f64 * largest;
    Ok((largest / smallest, values.iter().filter(|&&s| s > tolerance).count()))
}

fn largest_singular_value(m: &WideMatrix) -> Result<f64, LeastSquaresError> {
    let values = rounded(m).singular_values().map_err(|_| LeastSquaresError::NotFinite)?;
    Ok(values.first().copied().unwrap_or(1.0))
}
