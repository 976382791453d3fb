//! Normal equations in `f64`: fast and coarse.

use faer::linalg::{triangular_inverse, triangular_solve};
use faer::{Accum, Mat, MatRef, Par, Side};

use super::rows::{Reduction, RowChunk, Shape};
use crate::r_factor::{LeastSquares, LeastSquaresError, Ridge};
use crate::vectors::lower_product;

/// The lower triangle of `[X | Y]ᵀ[X | Y]`.
#[derive(Clone, Debug)]
pub(super) struct Gram {
    shape: Shape,
    rows: u64,
    /// Number of chunks so far: at most so many additions have rounded each sum.
    additions: u64,
    products: Mat<f64>,
}

impl Reduction for Gram {
    const WIDE: bool = false;

    fn absorb(&mut self, chunk: &RowChunk<'_>) {
        let columns = self.shape.columns();
        let rows = MatRef::from_column_major_slice_with_stride(
            chunk.heads,
            chunk.rows,
            columns,
            chunk.stride,
        );
        lower_product(self.products.as_mut(), Accum::Add, rows.transpose());
        self.rows += chunk.rows as u64;
        self.additions += 1;
    }

    fn merge(&mut self, later: Self) {
        self.products += later.products;
        self.rows += later.rows;
        self.additions += later.additions;
    }
}

impl Gram {
    pub(super) fn new(shape: Shape) -> Self {
        let columns = shape.columns();
        Self { shape, rows: 0, additions: 0, products: Mat::zeros(columns, columns) }
    }

    /// Solves by Cholesky factorisation with columns scaled to norm one.
    ///
    /// Success does not prove full rank. The elements of the scaled matrix have errors of at most (r + a)·2⁻⁵³, with r
    /// rows to a chunk and a additions of chunks (Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed.,
    /// §3.1). The eigenvalues have errors of at most p times that (Weyl), and p²·2⁻⁵³ from the eigenvalue algorithm. It is an
    /// error if the smallest eigenvalue is not well above this bound.
    pub(super) fn solve(&self, ridge: Ridge) -> Result<LeastSquares, LeastSquaresError> {
        let Shape { features: p, outputs: q } = self.shape;
        ridge.check(self.rows, p, self.products.is_all_finite())?;
        let norms: Vec<f64> = (0..p).map(|j| self.products[(j, j)].sqrt()).collect();
        let norms: Vec<f64> = norms.iter().map(|&n| if n > 0.0 { n } else { 1.0 }).collect();
        let mut scaled =
            Mat::from_fn(p, p, |i, j| self.products[(i.max(j), i.min(j))] / norms[i] / norms[j]);
        let chunk_rows = RowChunk::rows_in_cache(self.shape.columns()) as u64;
        let roundings = chunk_rows.min(self.rows) + self.additions + p as u64;
        let bound = p as f64 * roundings as f64 * f64::EPSILON / 2.0;
        let not_finite = |_| LeastSquaresError::NotFinite;
        let undamped = scaled.self_adjoint_eigenvalues(Side::Lower).map_err(not_finite)?;
        let largest = undamped.last().copied().unwrap_or(0.0);
        let rank = undamped.iter().filter(|&&e| e > bound).count();
        let gram = scaled.clone();
        for j in (0..p).filter(|&j| ridge.free_column != Some(j)) {
            scaled[(j, j)] += ridge.lambda;
        }
        let damped = scaled.self_adjoint_eigenvalues(Side::Lower).map_err(not_finite)?;
        let smallest = damped.first().copied().unwrap_or(1.0);
        // With ten times the bound, the coefficients keep one digit in the worst case.
        let ill_conditioned =
            LeastSquaresError::IllConditioned { limit: (largest / (10.0 * bound)).sqrt() };
        if p > 0 && smallest <= 10.0 * bound {
            return Err(ill_conditioned);
        }
        let Ok(cholesky) = scaled.llt(Side::Lower) else { return Err(ill_conditioned) };
        let lower = cholesky.L();
        let right = Mat::from_fn(p, q, |i, a| self.products[(p + a, i)] / norms[i]);
        let mut solved = right.clone();
        triangular_solve::solve_lower_triangular_in_place(lower, solved.as_mut(), Par::Seq);
        triangular_solve::solve_upper_triangular_in_place(
            lower.transpose(),
            solved.as_mut(),
            Par::Seq,
        );
        let mut inverse = Mat::<f64>::zeros(p, p);
        triangular_inverse::invert_upper_triangular(inverse.as_mut(), lower.transpose(), Par::Seq);
        let outputs = Mat::from_fn(q, q, |a, b| self.products[(p + a.max(b), p + a.min(b))]);
        // YᵀY − CᵀXᵀY − (XᵀY)ᵀC + CᵀXᵀX·C holds for any C, including a ridge solution.
        let cross = solved.transpose() * &right;
        let mut residual_products =
            outputs - &cross - cross.transpose() + solved.transpose() * (gram * &solved);
        for a in 0..q {
            // Cancellation may leave a negative number, which is impossible for a sum of squares.
            residual_products[(a, a)] = residual_products[(a, a)].max(0.0);
        }
        let coefficients = Mat::from_fn(p, q, |i, a| solved[(i, a)] / norms[i]);
        let factor = Mat::from_fn(p, p, |i, j| inverse[(i, j)] / norms[i]);
        if !coefficients.is_all_finite() || !factor.is_all_finite() {
            return Err(LeastSquaresError::NotFinite);
        }
        Ok(LeastSquares {
            coefficients,
            factor,
            residual_products,
            rows: self.rows,
            condition: (largest / undamped.first().copied().unwrap_or(largest).max(0.0)).sqrt(),
            rank,
        })
    }
}
