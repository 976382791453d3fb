//! Double-double arithmetic. Loops over rows keep heads and tails in separate columns and are compiled as in
//! [`vectors`](crate::vectors). Also small matrices, and the solution from a wide R factor.

use faer::Mat;
use pulp::Simd;

use crate::double_double::{DoubleDouble, two_product, two_sum};
use crate::r_factor::{
    LeastSquares, LeastSquaresError, condition_and_rank, equilibrated, rank_deficient,
};
use shell_data::vectorised;

pub(super) type WideMatrix = Mat<DoubleDouble>;

pub(super) fn rounded(matrix: &WideMatrix) -> Mat<f64> {
    Mat::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)].to_f64())
}

pub(super) fn is_finite(matrix: &WideMatrix) -> bool {
    matrix.col_iter().flat_map(|column| column.iter()).all(|e| e.is_finite())
}

/// Computes `aᵀb`, up to the shorter length.
pub(super) fn product(a: &[DoubleDouble], b: &[DoubleDouble]) -> DoubleDouble {
    a.iter().zip(b).map(|(&a, &b)| a * b).sum()
}

/// The Cholesky factorisation `XᵀX = RᵀR`; `None` if a pivot is not positive.
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

/// Solves `R·C = Z` with upper triangular `R`.
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

/// Solves the problem given `R` (p × p, including the rows of the ridge) and `Z = QᵀY` (p × q).
///
/// `resolution` is the largest value that rounding may give a zero singular value of `R` with columns of norm one. The
/// smallest singular value comes from the inverse, with full relative accuracy: a condition number of 10²⁰ is reported
/// as such. `residual_products` computes `(Y − X·C)ᵀ(Y − X·C)`, q × q, without the part due to the ridge.
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

/// Condition number and rank of the upper triangle `r` with columns of norm one, in `f64`, for
/// problems that a ridge makes solvable.
pub(super) fn spectrum(r: &Mat<f64>) -> Result<(f64, usize), LeastSquaresError> {
    condition_and_rank(&equilibrated(r.as_ref()).0, f64::EPSILON * r.ncols() as f64)
}

fn largest_singular_value(m: &WideMatrix) -> Result<f64, LeastSquaresError> {
    let values = rounded(m).singular_values().map_err(|_| LeastSquaresError::NotFinite)?;
    Ok(values.first().copied().unwrap_or(1.0))
}

/// Number of parallel sums: they fill a vector and hide the latency of additions.
pub(super) const LANES: usize = 8;

/// A column in double-double. Empty tails mean zeros.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wide<'a> {
    pub(super) heads: &'a [f64],
    pub(super) tails: &'a [f64],
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LaneSums {
    heads: [f64; LANES],
    tails: [f64; LANES],
}

impl LaneSums {
    pub(super) fn total(mut self) -> DoubleDouble {
        let mut count = LANES / 2;
        while count > 0 {
            for lane in 0..count {
                self.add(lane, self.heads[lane + count], self.tails[lane + count]);
            }
            count /= 2;
        }
        DoubleDouble::from_sum(self.heads[0], self.tails[0])
    }

    pub(super) fn merge(&mut self, other: &Self) {
        (0..LANES).for_each(|lane| self.add(lane, other.heads[lane], other.tails[lane]));
    }

    #[inline(always)]
    fn add(&mut self, lane: usize, head: f64, tail: f64) {
        let (sum, lost) = two_sum(self.heads[lane], head);
        self.heads[lane] = sum;
        self.tails[lane] += lost + tail;
    }

    #[inline(always)]
    fn add_product<S: Simd>(&mut self, simd: S, x: Wide<'_>, y: Wide<'_>) {
        match (x.tails.is_empty(), y.tails.is_empty()) {
            (true, true) => self.add_terms::<S, false, false>(simd, x, y),
            (false, true) => self.add_terms::<S, true, false>(simd, x, y),
            (true, false) => self.add_terms::<S, true, false>(simd, y, x),
            (false, false) => self.add_terms::<S, true, true>(simd, x, y),
        }
    }

    #[inline(always)]
    fn add_terms<S: Simd, const X: bool, const Y: bool>(
        &mut self,
        simd: S,
        x: Wide<'_>,
        y: Wide<'_>,
    ) {
        let n = x.heads.len();
        // Equal lengths, asserted once, remove the bounds checks below.
        assert!(y.heads.len() == n && (!X || x.tails.len() == n) && (!Y || y.tails.len() == n));
        let whole = n - n % LANES;
        let [x_heads, y_heads] = [x.heads, y.heads].map(|heads| S::as_simd_f64s(&heads[..whole]).0);
        let [x_tails, y_tails] = [(x.tails, X), (y.tails, Y)]
            .map(|(tails, is_there)| S::as_simd_f64s(&tails[..if is_there { whole } else { 0 }]).0);
        let heads = S::as_mut_simd_f64s(&mut self.heads).0;
        let tails = S::as_mut_simd_f64s(&mut self.tails).0;
        let of_lanes = heads.len();
        for (lanes, (head, tail)) in heads.iter_mut().zip(tails).enumerate() {
            let (mut sum, mut rest) = (*head, *tail);
            for i in (lanes..x_heads.len()).step_by(of_lanes) {
                let (a, b) = (x_heads[i], y_heads[i]);
                let product = simd.mul_f64s(a, b);
                let mut error = simd.mul_add_f64s(a, b, simd.neg_f64s(product));
                if X {
                    error = simd.mul_add_f64s(x_tails[i], b, error);
                }
                if Y {
                    error = simd.mul_add_f64s(a, y_tails[i], error);
                }
                let next = simd.add_f64s(sum, product);
                let added = simd.sub_f64s(next, sum);
                let of_sum = simd.sub_f64s(sum, simd.sub_f64s(next, added));
                let lost = simd.add_f64s(of_sum, simd.sub_f64s(product, added));
                rest = simd.add_f64s(rest, simd.add_f64s(lost, error));
                sum = next;
            }
            (*head, *tail) = (sum, rest);
        }
        for i in whole..n {
            let (product, mut error) = two_product(x.heads[i], y.heads[i]);
            if X {
                error = x.tails[i].mul_add(y.heads[i], error);
            }
            if Y {
                error = x.heads[i].mul_add(y.tails[i], error);
            }
            self.add(i - whole, product, error);
        }
    }
}

/// Computes `xᵀy` by compensated summation (Ogita, Rump and Oishi, SIAM J. Sci. Comput. 26, 2005, algorithm Dot2), in
/// [`LANES`] parallel sums. The result is as accurate as if computed in double-double and rounded last.
pub(super) fn dot(x: Wide<'_>, y: Wide<'_>) -> DoubleDouble {
    let mut sum = LaneSums::default();
    add_products(std::slice::from_mut(&mut sum), &[x], y);
    sum.total()
}

vectorised! {
    pub(super) fn add_products<S: Simd>(simd: S, sums: &mut [LaneSums], x: &[Wide<'_>], y: Wide<'_>) {
        sums.iter_mut().zip(x).for_each(|(sum, &x)| sum.add_product(simd, x, y));
    }
}

vectorised! {
    /// Computes `y += c·x`. Each element has an error of a few 2⁻¹⁰⁵·(|y| + |c·x|).
    pub(super) fn add_multiple(
        heads: &mut [f64],
        tails: &mut [f64],
        c: DoubleDouble,
        x: Wide<'_>,
    ) {
        let y = heads.iter_mut().zip(tails).zip(x.heads);
        if x.tails.is_empty() {
            y.for_each(|((head, tail), &x)| add(head, tail, c, x, 0.0));
        } else {
            y.zip(x.tails).for_each(|(((head, tail), &x), &rest)| add(head, tail, c, x, rest));
        }
    }
}

#[inline(always)]
fn add(head: &mut f64, tail: &mut f64, c: DoubleDouble, x: f64, x_tail: f64) {
    let (product, error) = two_product(x, c.to_f64());
    let cross = x.mul_add(c.tail(), x_tail * c.to_f64());
    let (sum, lost) = two_sum(*head, product);
    let rest = lost + (error + cross + *tail);
    *head = sum + rest;
    *tail = rest - (*head - sum);
}
