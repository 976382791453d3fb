//! Methods in double-double. Normal equations cost no digit that an `f64` could hold. Streamed
//! Householder QR is slow, and correct to the last digit of an `f64` for any condition number of
//! `f64` data.

use faer::Mat;

use super::rows::{Reduction, RowChunk, Shape, WideColumns};
use super::wide_matrix::{
    LANES, Wide, WideMatrix, add_multiple, cholesky, dot, is_finite, product, rounded,
    solve_transposed, solve_triangle, spectrum,
};
use crate::double_double::DoubleDouble;
use crate::r_factor::{LeastSquares, LeastSquaresError, Ridge};

/// The upper triangle of `[X | Y]ᵀ[X | Y]` in double-double, column by column.
#[derive(Clone, Debug)]
pub(super) struct WideGram {
    shape: Shape,
    rows: u64,
    additions: u64,
    products: Vec<DoubleDouble>,
}

impl Reduction for WideGram {
    const WIDE: bool = true;

    fn absorb(&mut self, chunk: &RowChunk<'_>) {
        let mut products = self.products.iter_mut();
        for j in 0..self.shape.columns() {
            for (i, product) in (0..=j).zip(&mut products) {
                *product += dot(chunk.wide(i), chunk.wide(j));
            }
        }
        self.rows += chunk.rows as u64;
        self.additions += 1;
    }

    fn merge(&mut self, later: Self) {
        self.products.iter_mut().zip(later.products).for_each(|(sum, product)| *sum += product);
        self.rows += later.rows;
        self.additions += later.additions;
    }
}

impl WideGram {
    pub(super) fn new(shape: Shape) -> Self {
        let n = shape.columns();
        Self { shape, rows: 0, additions: 0, products: vec![DoubleDouble::ZERO; n * (n + 1) / 2] }
    }

    fn product(&self, i: usize, j: usize) -> DoubleDouble {
        let (i, j) = (i.min(j), i.max(j));
        self.products[j * (j + 1) / 2 + i]
    }

    /// Relative error of an element, with columns of norm one: Dot2 within a chunk (n²·2⁻¹⁰⁶ for n
    /// terms to a lane), and sums of double-doubles over chunks and in the Cholesky factorisation.
    fn rounding(&self) -> f64 {
        let chunk_rows = RowChunk::rows_in_cache(self.shape.columns()) as u64;
        let terms = chunk_rows.min(self.rows).div_ceil(LANES as u64) as f64 + 1.0;
        let sums = self.additions as f64 + self.shape.features as f64 + LANES as f64;
        (terms * terms + 4.0 * sums) * (f64::EPSILON / 2.0).powi(2)
    }

    /// Solves by Cholesky factorisation. Loss of rank looks like a condition number above the
    /// limit: the smallest gap between columns of `f64`, squared, is below the rounding error of
    /// these sums.
    pub(super) fn solve(&self, ridge: Ridge) -> Result<LeastSquares, LeastSquaresError> {
        let Shape { features: p, outputs: q } = self.shape;
        ridge.check(self.rows, p, self.products.iter().all(|e| e.is_finite()))?;
        let norm = |j: usize| match self.product(j, j).to_f64().sqrt() {
            norm if norm > 0.0 => norm,
            _ => 1.0,
        };
        // Powers of two avoid rounding errors from scaling.
        let scales: Vec<f64> = (0..p).map(|j| libm::ldexp(1.0, -libm::ilogb(norm(j)))).collect();
        let gram = WideMatrix::from_fn(p, p, |i, j| {
            self.product(i, j).scaled(scales[i]).scaled(scales[j])
        });
        let mut damped = gram.clone();
        for j in (0..p).filter(|&j| ridge.free_column != Some(j)) {
            let penalty = gram[(j, j)] * DoubleDouble::from(ridge.lambda);
            damped[(j, j)] += penalty;
        }
        let bound = p as f64 * self.rounding();
        // Allows coefficients a relative error of 0.1 % in the worst case.
        let limit = (1e-3 / bound).sqrt();
        let ill_conditioned = LeastSquaresError::IllConditioned { limit };
        let Some(r) = cholesky(&damped) else { return Err(ill_conditioned) };
        let right = WideMatrix::from_fn(p, q, |i, a| self.product(i, p + a).scaled(scales[i]));
        let z = solve_transposed(&r, &right);
        let residual_products = |c: &WideMatrix| {
            let cross = |a: usize, b: usize| product(c.col_as_slice(a), right.col_as_slice(b));
            Mat::from_fn(q, q, |a, b| {
                let squares = (0..p).map(|i| {
                    let row: DoubleDouble = (0..p).map(|j| gram[(i, j)] * c[(j, b)]).sum();
                    c[(i, a)] * row
                });
                let value = self.product(p + a, p + b) - cross(a, b) - cross(b, a)
                    + squares.sum::<DoubleDouble>();
                if a == b { value.to_f64().max(0.0) } else { value.to_f64() }
            })
        };
        let solved = solve_triangle(&r, &z, bound.sqrt(), self.rows, residual_products);
        let mut solved = match solved {
            Err(LeastSquaresError::RankDeficient { .. }) => return Err(ill_conditioned),
            solved => solved?,
        };
        if ridge.lambda > 0.0 {
            // Without the ridge the columns may be dependent, and there may be no R factor.
            (solved.condition, solved.rank) = match cholesky(&gram) {
                Some(r) => spectrum(&rounded(&r))?,
                None => (f64::INFINITY, p - 1),
            };
        } else if solved.condition > limit {
            return Err(ill_conditioned);
        }
        for (i, &scale) in scales.iter().enumerate() {
            solved.coefficients.row_mut(i).iter_mut().for_each(|c| *c *= scale);
            solved.factor.row_mut(i).iter_mut().for_each(|f| *f *= scale);
        }
        Ok(solved)
    }
}

/// R factor of the rows `[X | Y]` so far in double-double, as in [`crate::r_factor`].
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
    pub(super) fn new(shape: Shape) -> Self {
        let columns = shape.columns();
        Self { shape, rows: 0, r: WideMatrix::from_fn(columns, columns, |_, _| DoubleDouble::ZERO) }
    }

    /// Factors the R factor with `rows` below. The reflector of column `k` affects only its
    /// diagonal element and these rows.
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
        // With a ridge, the coefficients leave a residual even within the span of the columns.
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
        // Large residuals contribute an error with the square of the condition number (Björck 1996,
        // §1.4.3), limited to 1 %.
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
