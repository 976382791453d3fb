//! Iterative refinement: QR in `f64`, residuals in double-double.
//!
//! With `R` from a first pass and any `C`, the gradient `G = Xᵀ(Y − X·C)` gives the correction
//! `R⁻¹R⁻ᵀ·G`: the corrected seminormal equations (Björck, Linear Algebra Appl. 88/89, 1987). `R`
//! is the exact factor of a matrix within a small multiple of ε of `X`, so each correction leaves a
//! share of order ε·κ of the error, for any residual. Residuals and their sums are in
//! double-double, because the gradient limits the accuracy. One correction gives every digit of an
//! `f64` up to about κ = 10⁶; the error bound decides on further passes.

use faer::{Mat, MatRef};

use super::rows::{Reduction, RowChunk, RowSource, Shape, WideColumns};
use super::wide_matrix::{LANES, LaneSums, Wide, WideMatrix, add_multiple, add_products, rounded};
use crate::double_double::DoubleDouble;
use crate::r_factor::{LeastSquares, LeastSquaresError, RFactor, Ridge};

const MOST_CORRECTIONS: usize = 12;

/// `Xᵀ(Y − X·C)`.
#[derive(Clone)]
struct Gradient<'a> {
    shape: Shape,
    coefficients: &'a WideMatrix,
    /// Products of each column of `[X | Y − X·C]` with the residuals, which are its last columns.
    sums: Vec<LaneSums>,
}

impl Reduction for Gradient<'_> {
    const WIDE: bool = true;

    /// Number of rows that fit in a core's L2 cache, because each column is used twice.
    fn chunk_rows(columns: usize) -> usize {
        /// Size of heads and tails, in bytes.
        const BYTES: usize = 1 << 19;
        (BYTES / (16 * columns.max(1))).next_multiple_of(LANES)
    }

    fn absorb(&mut self, chunk: &RowChunk<'_>) {
        let Shape { features: p, outputs: q } = self.shape;
        let rows = chunk.rows;
        if rows == 0 {
            return;
        }
        let WideColumns { mut heads, mut tails, .. } = WideColumns::new(chunk, p..p + q);
        // Feature by feature, so that each is loaded once.
        for j in 0..p {
            let residuals = heads.chunks_mut(rows).zip(tails.chunks_mut(rows));
            for (a, (heads, tails)) in residuals.enumerate() {
                add_multiple(heads, tails, -self.coefficients[(j, a)], chunk.wide(j));
            }
        }
        let residuals: Vec<Wide<'_>> = std::iter::zip(heads.chunks(rows), tails.chunks(rows))
            .map(|(heads, tails)| Wide { heads, tails })
            .collect();
        for (j, sums) in self.sums.chunks_mut(q).enumerate() {
            let column = if j < p { chunk.wide(j) } else { residuals[j - p] };
            add_products(sums, &residuals, column);
        }
    }

    fn merge(&mut self, later: Self) {
        self.sums.iter_mut().zip(&later.sums).for_each(|(sum, later)| sum.merge(later));
    }
}

pub(super) fn solve<R: RowSource>(rows: &mut R, ridge: Ridge) -> Result<LeastSquares, R::Error> {
    let shape = rows.shape();
    let Shape { features: p, outputs: q } = shape;
    let r_factor = rows.pass(&RFactor::new(p, q))?;
    let mut solved = r_factor.solve_roughly(ridge)?;
    let norms: Vec<f64> = r_factor.r().col_iter().map(|column| column.norm_l2()).collect();
    let penalties = ridge.penalties(&norms);
    let start = &solved.coefficients;
    let mut coefficients = WideMatrix::from_fn(p, q, |i, a| start[(i, a)].into());
    // Share of the error that a correction leaves: conservative until one has been measured.
    let mut contraction = 16.0 * p as f64 * f64::EPSILON * solved.condition;
    let mut before: Option<Vec<f64>> = None;
    let ill_conditioned =
        LeastSquaresError::IllConditioned { limit: 0.1 / f64::EPSILON / (p as f64).sqrt() };
    for _ in 0..MOST_CORRECTIONS {
        let sums = vec![LaneSums::default(); shape.columns() * q];
        let Gradient { sums, .. } =
            rows.pass(&Gradient { shape, coefficients: &coefficients, sums })?;
        let mut gradient = WideMatrix::from_fn(p, q, |j, a| sums[j * q + a].total());
        for a in 0..q {
            for (j, &penalty) in penalties.iter().enumerate() {
                gradient[(j, a)] -= coefficients[(j, a)] * DoubleDouble::from(penalty);
            }
        }
        let inner = solved.factor.transpose() * rounded(&gradient);
        let correction = &solved.factor * &inner;
        if !correction.is_all_finite() {
            return Err(LeastSquaresError::NotFinite.into());
        }
        let sizes: Vec<f64> = inner.col_iter().map(|column| column.norm_l2()).collect();
        if let Some(before) = &before {
            let ratio = sizes.iter().zip(before).map(|(now, before)| now / before);
            contraction = ratio.filter(|r| r.is_finite()).fold(0.0, f64::max);
            if contraction > 0.5 && !is_settled(correction.as_ref(), &coefficients, &norms, 1.0) {
                return Err(ill_conditioned.into());
            }
        }
        for a in 0..q {
            for j in 0..p {
                coefficients[(j, a)] += DoubleDouble::from(correction[(j, a)]);
            }
        }
        // These residuals are from before the correction; subtract its contribution.
        let removed = inner.transpose() * &inner;
        solved.residual_products = Mat::from_fn(q, q, |a, b| {
            let product = sums[(p + a.min(b)) * q + a.max(b)].total().to_f64() - removed[(a, b)];
            if a == b { product.max(0.0) } else { product }
        });
        if is_settled(correction.as_ref(), &coefficients, &norms, contraction) {
            solved.coefficients = rounded(&coefficients);
            return Ok(solved);
        }
        before = Some(sizes);
    }
    Err(ill_conditioned.into())
}

/// Returns true if `contraction` times the last correction of each coefficient is negligible: below the resolution of
/// `f64` or, if a coefficient is zero except for rounding, small relative to the others (with columns of norm one).
fn is_settled(
    correction: MatRef<'_, f64>,
    coefficients: &WideMatrix,
    norms: &[f64],
    contraction: f64,
) -> bool {
    const NEGLIGIBLE: f64 = 1e-26;
    (0..correction.ncols()).all(|a| {
        let column = coefficients.col_as_slice(a);
        let sizes = column.iter().zip(norms).map(|(c, norm)| c.to_f64().abs() * norm);
        let largest = sizes.fold(0.0, f64::max);
        (0..norms.len()).all(|j| {
            let left = contraction * correction[(j, a)].abs();
            left <= column[j].to_f64().abs() * f64::EPSILON / 8.0
                || left * norms[j] <= NEGLIGIBLE * largest
        })
    })
}
