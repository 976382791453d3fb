//! Householder QR in double-double, streamed over rows: slow, and right to the last digit of an
//! `f64` for any condition number that `f64` data can have.

use faer::Mat;

use super::rows::{Reduction, RowChunk, Shape, WideColumns};
use super::wide_matrix::{
    Wide, WideMatrix, add_multiple, dot, is_finite, product, solve_triangle, spectrum,
};
use crate::double_double::DoubleDouble;
use crate::r_factor::{LeastSquares, LeastSquaresError, Ridge};

/// The R factor of the rows `[X | Y]` seen so far in double-double, as that of [`crate::r_factor`].
#[derive(Clone, Debug)]
pub(super) struct WideRFactor {
    shape: Shape,
    rows: u64,
    r: WideMatrix,
}

impl Reduction for WideRFactor {
    const WIDE: bool = true;

    fn absorb(&mut self, chunk: &RowChunk<'_>) {
        self.eliminate(WideColumns::new(chunk, 0..self.shape.columns()));
        self.rows += chunk.rows as u64;
    }

    fn merge(&mut self, later: Self) {
        let columns = self.shape.columns();
        let elements = || (0..columns).flat_map(|j| later.r.col_as_slice(j));
        self.eliminate(WideColumns {
            height: columns,
            heads: elements().map(|e| e.to_f64()).collect(),
            tails: elements().map(|e| e.tail()).collect(),
        });
        self.rows += later.rows;
    }
}

impl WideRFactor {
    /// The result for zero rows.
    pub(super) fn new(shape: Shape) -> Self {
        let columns = shape.columns();
        Self { shape, rows: 0, r: WideMatrix::from_fn(columns, columns, |_, _| DoubleDouble::ZERO) }
    }

    /// Factors the R factor with `rows` below it.
    ///
    /// Column `k` of the stack has a diagonal element and the rows below the R factor, and nothing
    /// between them; its reflector touches just these rows.
    fn eliminate(&mut self, rows: WideColumns) {
        let n = self.shape.columns();
        let WideColumns { height, mut heads, mut tails } = rows;
        if height == 0 {
            return;
        }
        for k in 0..n {
            let (head, later_heads) = heads[k * height..].split_at_mut(height);
            let (tail, later_tails) = tails[k * height..].split_at_mut(height);
            let v = Wide { heads: head, tails: tail };
            let below = dot(v, v);
            if below == DoubleDouble::ZERO {
                continue;
            }
            let diagonal = self.r[(k, k)];
            let length = (diagonal * diagonal + below).sqrt();
            let reflected = if diagonal.to_f64() > 0.0 { -length } else { length };
            let first = diagonal - reflected;
            let factor = DoubleDouble::from(-2.0) / (first * first + below);
            let later = later_heads.chunks_mut(height).zip(later_tails.chunks_mut(height));
            for (j, (heads, tails)) in (k + 1..n).zip(later) {
                let x = Wide { heads, tails };
                let share = (first * self.r[(k, j)] + dot(v, x)) * factor;
                self.r[(k, j)] += share * first;
                add_multiple(heads, tails, share, v);
            }
            self.r[(k, k)] = reflected;
        }
    }

    /// Solves for the coefficients.
    ///
    /// # Errors
    /// [`LeastSquaresError`].
    pub(super) fn solve(&self, ridge: Ridge) -> Result<LeastSquares, LeastSquaresError> {
        let Shape { features: p, outputs: q } = self.shape;
        ridge.check(self.rows, p, is_finite(&self.r))?;
        let mut damped = self.clone();
        if ridge.lambda > 0.0 {
            let norm = |j: usize| {
                let column = self.r.col_as_slice(j);
                product(column, column).sqrt().to_f64()
            };
            let n = self.shape.columns();
            let mut penalty =
                WideColumns { height: p, heads: vec![0.0; p * n], tails: vec![0.0; p * n] };
            for j in (0..p).filter(|&j| ridge.free_column != Some(j)) {
                let norm = norm(j);
                let norm = if norm > 0.0 { norm } else { 1.0 };
                penalty.heads[j * p + j] = ridge.lambda.sqrt() * norm;
            }
            damped.eliminate(penalty);
        }
        let r = WideMatrix::from_fn(p, p, |i, j| damped.r[(i, j)]);
        let z = WideMatrix::from_fn(p, q, |i, a| damped.r[(i, p + a)]);
        // With a ridge the coefficients do not fit the rows exactly even within the columns' span.
        let residual_products = |coefficients: &WideMatrix| {
            let misfit = WideMatrix::from_fn(p, q, |i, a| {
                let fitted = (i..p).map(|k| self.r[(i, k)] * coefficients[(k, a)]).sum();
                self.r[(i, p + a)] - fitted
            });
            Mat::from_fn(q, q, |a, b| {
                let (left, right) = (misfit.col_as_slice(a), misfit.col_as_slice(b));
                let within = left.iter().zip(right).map(|(&a, &b)| a * b);
                let beyond = (p..p + q).map(|i| self.r[(i, p + a)] * self.r[(i, p + b)]);
                within.chain(beyond).sum::<DoubleDouble>().to_f64()
            })
        };
        let rounding = p as f64 * 2.0 * (f64::EPSILON / 2.0).powi(2);
        let mut solved = solve_triangle(&r, &z, 64.0 * rounding, self.rows, residual_products)?;
        if ridge.lambda > 0.0 {
            let undamped = Mat::from_fn(p, p, |i, j| self.r[(i, j)].to_f64());
            (solved.condition, solved.rank) = spectrum(&undamped)?;
            return Ok(solved);
        }
        // Where the residual is large, its share of the error grows with the square of the
        // condition number (Björck 1996, §1.4.3): at most one part in a hundred.
        let steepest = (0..q).map(|a| {
            let fitted: f64 = z.col_as_slice(a).iter().map(|e| e.to_f64() * e.to_f64()).sum();
            (solved.residual_products[(a, a)] / fitted.max(f64::MIN_POSITIVE)).sqrt()
        });
        let limit = (1e-2 / rounding / steepest.fold(1e-13, f64::max)).sqrt();
        if solved.condition > limit {
            return Err(LeastSquaresError::IllConditioned { limit });
        }
        Ok(solved)
    }
}
