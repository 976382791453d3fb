//! Symmetric matrices of some dozens of rows, whose sums run in one order: the same bits on every machine.
//!
//! Those of faer depend on how wide the vectors of the processor are. Here a vector has elements of a row side by
//! side, and products are rounded: WebAssembly has no fused multiply-add.

use pulp::{Simd, WithSimd};

use shell_data::instructions::arch;

/// The upper triangle of a symmetric matrix, row after row.
#[derive(Clone, Debug)]
pub(crate) struct Symmetric {
    size: usize,
    upper: Vec<f64>,
}

/// The upper factor of `A = Uᵀ·U`.
#[derive(Clone, Debug)]
pub(crate) struct UpperFactor(Symmetric);

/// `U⁻¹`, with which `A⁻¹ = U⁻¹·U⁻ᵀ`.
#[derive(Clone, Debug)]
pub(crate) struct InverseFactor(Symmetric);

impl Symmetric {
    /// Of `element(i, j)`, `i ≤ j`.
    pub(crate) fn from_fn(size: usize, mut element: impl FnMut(usize, usize) -> f64) -> Self {
        let mut upper = Vec::with_capacity(size * (size + 1) / 2);
        (0..size).for_each(|i| upper.extend((i..size).map(|j| element(i, j))));
        Self { size, upper }
    }

    pub(crate) fn size(&self) -> usize {
        self.size
    }

    /// Where a row begins.
    fn first(&self, row: usize) -> usize {
        row * (2 * self.size + 1 - row) / 2
    }

    /// A row from the diagonal on.
    pub(crate) fn row(&self, row: usize) -> &[f64] {
        &self.upper[self.first(row)..][..self.size - row]
    }

    /// A row from the diagonal on.
    pub(crate) fn row_mut(&mut self, row: usize) -> &mut [f64] {
        let first = self.first(row);
        &mut self.upper[first..][..self.size - row]
    }

    fn at(&mut self, i: usize, j: usize) -> &mut f64 {
        &mut self.row_mut(i.min(j))[i.abs_diff(j)]
    }

    /// Subtracts `x·xᵀ` of each of these, as long as a row.
    pub(crate) fn subtract_squares(&mut self, of: &[Vec<f64>]) {
        arch().dispatch(SubtractSquares { from: self, of });
    }

    /// The factor; `None` if the matrix is not positive definite in floating point. (Golub & Van Loan, 4th ed.,
    /// §4.2.)
    pub(crate) fn cholesky(mut self) -> Option<UpperFactor> {
        arch().dispatch(Factorise(&mut self)).then_some(UpperFactor(self))
    }

    /// Eigenvalues from the smallest to the largest, each with its vector, by Jacobi's rotations. (Golub & Van Loan,
    /// §8.5.)
    pub(crate) fn eigen(mut self) -> Vec<(f64, Vec<f64>)> {
        /// Convergence is quadratic: matrices of this size take six to ten.
        const SWEEPS: usize = 50;
        let size = self.size;
        let unit = |row| (0..size).map(|i| f64::from(u8::from(i == row))).collect();
        let mut vectors: Vec<Vec<f64>> = (0..size).map(unit).collect();
        for _ in 0..SWEEPS {
            let mut turned = false;
            for p in 0..size {
                for q in p + 1..size {
                    turned |= self.turn(p, q, &mut vectors);
                }
            }
            if !turned {
                break;
            }
        }
        let mut pairs: Vec<_> = vectors.into_iter().enumerate().collect();
        pairs.sort_by(|(a, _), (b, _)| self.row(*a)[0].total_cmp(&self.row(*b)[0]));
        pairs.into_iter().map(|(i, vector)| (*self.at(i, i), vector)).collect()
    }

    /// Makes one element zero by a rotation; false if it is zero to all digits.
    fn turn(&mut self, p: usize, q: usize, vectors: &mut [Vec<f64>]) -> bool {
        let (app, aqq, apq) = (*self.at(p, p), *self.at(q, q), *self.at(p, q));
        if apq.abs() <= f64::EPSILON * 0.5 * (app.abs() * aqq.abs()).sqrt() || !apq.is_finite() {
            return false;
        }
        let tau = (aqq - app) / (2.0 * apq);
        let tan = tau.signum() / (tau.abs() + (1.0 + tau * tau).sqrt());
        let cos = 1.0 / (1.0 + tan * tan).sqrt();
        let sin = tan * cos;
        let rotate = |x: &mut f64, y: &mut f64| {
            (*x, *y) = (cos * *x - sin * *y, sin * *x + cos * *y);
        };
        for i in (0..self.size).filter(|&i| i != p && i != q) {
            let (mut x, mut y) = (*self.at(i, p), *self.at(i, q));
            rotate(&mut x, &mut y);
            (*self.at(i, p), *self.at(i, q)) = (x, y);
        }
        (*self.at(p, p), *self.at(q, q)) = (app - tan * apq, aqq + tan * apq);
        *self.at(p, q) = 0.0;
        let (head, tail) = vectors.split_at_mut(q);
        head[p].iter_mut().zip(&mut tail[0]).for_each(|(x, y)| rotate(x, y));
        true
    }
}

struct SubtractSquares<'a> {
    from: &'a mut Symmetric,
    of: &'a [Vec<f64>],
}

impl WithSimd for SubtractSquares<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let (fours, rest) = self.of.as_chunks();
        for i in 0..self.from.size {
            let row = self.from.row_mut(i);
            // So many at once: what is read and written is the row.
            for [a, b, c, d] in fours {
                let columns = a[i..].iter().zip(&b[i..]).zip(c[i..].iter().zip(&d[i..]));
                for (x, ((aj, bj), (cj, dj))) in row.iter_mut().zip(columns) {
                    *x -= (a[i] * aj + b[i] * bj) + (c[i] * cj + d[i] * dj);
                }
            }
            for a in rest {
                row.iter_mut().zip(&a[i..]).for_each(|(x, aj)| *x -= a[i] * aj);
            }
        }
    }
}

/// Makes the upper triangle that of the factor; false if there is none.
struct Factorise<'a>(&'a mut Symmetric);

impl WithSimd for Factorise<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> bool {
        let mut rest = self.0.upper.as_mut_slice();
        for size in (1..=self.0.size).rev() {
            let (row, below) = rest.split_at_mut(size);
            if !(row[0] > 0.0 && row[0].is_finite()) {
                return false;
            }
            let root = row[0].sqrt();
            row.iter_mut().for_each(|x| *x /= root);
            rest = below;
            let mut below = &mut *rest;
            for i in 1..size {
                let (next, others) = below.split_at_mut(size - i);
                next.iter_mut().zip(&row[i..]).for_each(|(x, u)| *x -= row[i] * u);
                below = others;
            }
        }
        true
    }
}

impl UpperFactor {
    /// `U⁻ᵀ·b`.
    pub(crate) fn forward(&self, mut b: Vec<f64>) -> Vec<f64> {
        for i in 0..self.0.size {
            let row = self.0.row(i);
            let (head, tail) = b.split_at_mut(i + 1);
            head[i] /= row[0];
            tail.iter_mut().zip(&row[1..]).for_each(|(x, u)| *x -= head[i] * u);
        }
        b
    }

    /// `bᵀ·A⁻¹·b`.
    pub(crate) fn square(&self, b: Vec<f64>) -> f64 {
        let z = self.forward(b);
        product(&z, &z)
    }

    /// `A⁻¹·b`.
    pub(crate) fn solve(&self, b: Vec<f64>) -> Vec<f64> {
        let mut b = self.forward(b);
        for i in (0..self.0.size).rev() {
            let row = self.0.row(i);
            b[i] = (b[i] - product(&row[1..], &b[i + 1..])) / row[0];
        }
        b
    }

    /// `U⁻¹`.
    pub(crate) fn inverse(mut self) -> InverseFactor {
        arch().dispatch(Invert(&mut self.0));
        InverseFactor(self.0)
    }
}

impl InverseFactor {
    /// An element of `A⁻¹`, `i ≤ j`.
    pub(crate) fn element(&self, i: usize, j: usize) -> f64 {
        product(&self.0.row(i)[j - i..], self.0.row(j))
    }
}

struct Invert<'a>(&'a mut Symmetric);

impl WithSimd for Invert<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let size = self.0.size;
        let mut inverse = vec![0.0; size];
        // From the last row up: those below are inverted.
        for i in (0..size).rev() {
            let first = self.0.first(i);
            let (row, mut below) = self.0.upper[first..].split_at_mut(size - i);
            let inverse = &mut inverse[..size - i];
            inverse.fill(0.0);
            for (k, u) in row.iter().enumerate().skip(1) {
                let (next, others) = below.split_at_mut(size - i - k);
                inverse[k..].iter_mut().zip(&*next).for_each(|(x, v)| *x -= u * v);
                below = others;
            }
            inverse[0] = 1.0;
            let diagonal = row[0];
            row.iter_mut().zip(inverse).for_each(|(to, x)| *to = *x / diagonal);
        }
    }
}

/// `xᵀy`, in four sums side by side.
pub(crate) fn product(x: &[f64], y: &[f64]) -> f64 {
    let ((x, x_rest), (y, y_rest)) = (x.as_chunks::<4>(), y.as_chunks::<4>());
    let mut sums = [0.0; 4];
    for (x, y) in x.iter().zip(y) {
        (0..4).for_each(|lane| sums[lane] += x[lane] * y[lane]);
    }
    let rest: f64 = x_rest.iter().zip(y_rest).map(|(x, y)| x * y).sum();
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}

#[cfg(test)]
mod tests {
    use faer::{Mat, Side};
    use proptest::prelude::*;

    use super::*;

    /// `MᵀM + I` of a matrix of numbers up to 1: its condition is below 1 + size².
    fn positive(size: usize, numbers: &[f64]) -> Symmetric {
        let mut a = Symmetric::from_fn(size, |i, j| -f64::from(u8::from(i == j)));
        a.subtract_squares(&numbers.chunks(size).map(<[f64]>::to_vec).collect::<Vec<_>>());
        a.upper.iter_mut().for_each(|x| *x = -*x);
        a
    }

    fn faer(of: &Symmetric) -> Mat<f64> {
        Mat::from_fn(of.size(), of.size(), |i, j| of.row(i.min(j))[i.abs_diff(j)])
    }

    proptest! {
        #[test]
        fn inverses_and_eigenvalues_are_those_of_faer(
            (size, numbers) in (1..24_usize)
                .prop_flat_map(|size| (Just(size), prop::collection::vec(-1.0..1.0, size * size))),
        ) {
            let a = positive(size, &numbers);
            let theirs = faer(&a);
            let eigen = theirs.self_adjoint_eigenvalues(Side::Lower).unwrap();
            let factor = a.clone().cholesky().unwrap();
            let unit = |column| (0..size).map(|i| f64::from(u8::from(i == column))).collect();
            let inverse = factor.clone().inverse();
            for column in 0..size {
                let solved = factor.solve(unit(column));
                prop_assert!((factor.square(unit(column)) - solved[column]).abs() < 1e-13);
                for row in 0..size {
                    // Of a matrix whose smallest eigenvalue is 1 or more, and a condition of some hundreds.
                    let back: f64 = (0..size).map(|k| theirs[(row, k)] * solved[k]).sum();
                    prop_assert!((back - f64::from(u8::from(row == column))).abs() < 1e-11);
                    let element = inverse.element(row.min(column), row.max(column));
                    prop_assert!((element - solved[row]).abs() < 1e-13);
                }
            }
            let largest = eigen[size - 1];
            for (expected, (value, vector)) in eigen.iter().zip(a.eigen()) {
                prop_assert!((value - expected).abs() < 1e-13 * largest);
                prop_assert!((product(&vector, &vector) - 1.0).abs() < 1e-13);
                for row in 0..size {
                    let turned: f64 = (0..size).map(|k| theirs[(row, k)] * vector[k]).sum();
                    prop_assert!((turned - value * vector[row]).abs() < 1e-12 * largest);
                }
            }
        }
    }

    #[test]
    fn a_matrix_that_is_not_positive_definite_has_no_factor() {
        let of = |diagonal: f64| Symmetric::from_fn(2, |i, j| if i == j { diagonal } else { 1.0 });
        assert!(of(1.5).cholesky().is_some());
        for bad in [1.0, 0.5, f64::NAN, f64::INFINITY] {
            assert!(of(bad).cholesky().is_none(), "{bad}");
        }
        assert_eq!(Symmetric::from_fn(0, |_, _| 0.0).eigen(), []);
    }
}
