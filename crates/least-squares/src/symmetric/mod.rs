//! Symmetric and triangular matrices with a fixed order of summation, and thus the same bits on every machine; faer's
//! results depend on the vector width. Products are rounded before they are added, because WebAssembly has no fused
//! multiply-add. (Golub & Van Loan, 4th ed., §§3.1, 4.2, 5.2 and 8.3.)

mod eigen;
mod squares;

use faer::{Mat, MatRef};

use self::eigen::Reflection;
pub(crate) use self::eigen::{Eigen, TOGETHER};
use shell_data::vectorised;

/// The upper triangle of a symmetric matrix, row by row.
#[derive(Clone, Debug)]
pub struct SymmetricMatrix {
    pub size: usize,
    upper: Vec<f64>,
}

fn first(size: usize, row: usize) -> usize {
    row * (2 * size + 1 - row) / 2
}

impl SymmetricMatrix {
    pub fn from_fn(size: usize, mut element: impl FnMut(usize, usize) -> f64) -> Self {
        let mut upper = Vec::with_capacity(first(size, size));
        (0..size).for_each(|i| upper.extend((i..size).map(|j| element(i, j))));
        Self { size, upper }
    }

    pub fn zeros(size: usize) -> Self {
        Self::from_fn(size, |_, _| 0.0)
    }

    pub fn identity(size: usize) -> Self {
        Self::from_fn(size, |i, j| f64::from(u8::from(i == j)))
    }

    /// A row from the diagonal on.
    #[inline]
    pub fn row(&self, row: usize) -> &[f64] {
        &self.upper[first(self.size, row)..][..self.size - row]
    }

    /// A row from the diagonal on.
    #[inline]
    pub fn row_mut(&mut self, row: usize) -> &mut [f64] {
        &mut self.upper[first(self.size, row)..][..self.size - row]
    }

    pub fn add(&mut self, other: &Self) {
        add_multiple(&mut self.upper, 1.0, &other.upper);
    }

    pub fn trace_of_product(&self, other: &Self) -> f64 {
        let of_row = |i: usize| {
            let (own, other) = (self.row(i), other.row(i));
            2.0 * product(own, other) - own[0] * other[0]
        };
        (0..self.size).map(of_row).sum()
    }

    pub fn times(&self, x: &[f64]) -> Vec<f64> {
        let mut sums = vec![0.0; self.size];
        for (i, &x_i) in x.iter().enumerate() {
            let row = self.row(i);
            sums[i] += product(row, &x[i..]);
            add_multiple(&mut sums[i + 1..], x_i, &row[1..]);
        }
        sums
    }

    pub fn subtract_squares(&mut self, of: &[Vec<f64>]) {
        squares::subtract_squares(self, of);
    }

    /// Factor `U` of `A = Uᵀ·U`; `None` if the matrix is not positive definite in floating point.
    pub fn cholesky(mut self) -> Option<UpperTriangle> {
        factorise(&mut self).then_some(UpperTriangle(self))
    }
}

vectorised! {
    /// Replaces the upper triangle with the Cholesky factor; returns false if there is none.
    fn factorise(a: &mut SymmetricMatrix) -> bool {
        let mut rest = a.upper.as_mut_slice();
        for size in (1..=a.size).rev() {
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
                add_multiple(next, -row[i], &row[i..]);
                below = others;
            }
        }
        true
    }
}

/// Computes `y += c·x`.
#[inline(always)]
pub fn add_multiple(y: &mut [f64], c: f64, x: &[f64]) {
    y.iter_mut().zip(x).for_each(|(y, x)| *y += c * x);
}

/// Computes `xᵀy`, in four parallel sums.
#[inline(always)]
pub fn product(x: &[f64], y: &[f64]) -> f64 {
    let ((x, x_rest), (y, y_rest)) = (x.as_chunks::<4>(), y.as_chunks::<4>());
    let mut sums = [0.0; 4];
    for (x, y) in x.iter().zip(y) {
        (0..4).for_each(|lane| sums[lane] += x[lane] * y[lane]);
    }
    let rest: f64 = x_rest.iter().zip(y_rest).map(|(x, y)| x * y).sum();
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}

#[derive(Clone, Debug)]
pub struct UpperTriangle(SymmetricMatrix);

impl UpperTriangle {
    pub fn from_fn(size: usize, element: impl FnMut(usize, usize) -> f64) -> Self {
        Self(SymmetricMatrix::from_fn(size, element))
    }

    pub fn new(matrix: &Mat<f64>) -> Self {
        Self::from_fn(matrix.nrows(), |i, j| matrix[(i, j)])
    }

    pub fn matrix(&self) -> Mat<f64> {
        let element = |i, j| if i <= j { self.row(i)[j - i] } else { 0.0 };
        Mat::from_fn(self.size(), self.size(), element)
    }

    #[inline]
    pub fn size(&self) -> usize {
        self.0.size
    }

    /// A row from the diagonal on.
    #[inline]
    pub fn row(&self, row: usize) -> &[f64] {
        self.0.row(row)
    }

    /// A row from the diagonal on.
    #[inline]
    pub fn row_mut(&mut self, row: usize) -> &mut [f64] {
        self.0.row_mut(row)
    }

    /// Computes `T` with `T·Tᵀ = MᵀM` from the rows of `M`, by Householder reflections.
    pub fn root_of_squares(rows: &[Vec<f64>], size: usize) -> Self {
        let backwards = (0..size).rev();
        let mut columns: Vec<Vec<f64>> =
            backwards.map(|column| rows.iter().map(|row| row[column]).collect()).collect();
        root_of_columns(&mut columns, rows.len())
    }

    /// Computes `U⁻ᵀ·b`.
    pub fn forward(&self, mut b: Vec<f64>) -> Vec<f64> {
        for i in 0..self.size() {
            let row = self.row(i);
            let (head, tail) = b.split_at_mut(i + 1);
            head[i] /= row[0];
            add_multiple(tail, -head[i], &row[1..]);
        }
        b
    }

    /// Computes `bᵀ·(UᵀU)⁻¹·b`.
    pub fn square(&self, b: Vec<f64>) -> f64 {
        let z = self.forward(b);
        product(&z, &z)
    }

    /// Computes `(UᵀU)⁻¹·b`.
    pub fn solve(&self, b: Vec<f64>) -> Vec<f64> {
        let mut b = self.forward(b);
        for i in (0..self.size()).rev() {
            let row = self.row(i);
            b[i] = (b[i] - product(&row[1..], &b[i + 1..])) / row[0];
        }
        b
    }

    /// Computes `U⁻¹`; not finite if a diagonal element is zero.
    pub fn inverse(mut self) -> Self {
        invert(&mut self.0);
        self
    }

    /// Computes an element of `T·Tᵀ`, `i ≤ j`.
    pub fn square_element(&self, i: usize, j: usize) -> f64 {
        product(&self.row(i)[j - i..], self.row(j))
    }

    /// Computes `T·b`.
    pub fn times(&self, b: &[f64]) -> Vec<f64> {
        (0..self.size()).map(|i| product(self.row(i), &b[i..])).collect()
    }

    /// Computes `Tᵀ·b`.
    pub fn transposed_times(&self, b: &[f64]) -> Vec<f64> {
        let mut sums = vec![0.0; self.size()];
        for (i, &b) in b.iter().enumerate() {
            add_multiple(&mut sums[i..], b, self.row(i));
        }
        sums
    }
}

/// Computes a row of `A·T` from the diagonal on.
#[inline(always)]
fn row_of_product(a: &SymmetricMatrix, t: &UpperTriangle, i: usize, row: &mut [f64]) {
    row.fill(0.0);
    for k in 0..a.size {
        let element = a.upper[first(a.size, i.min(k)) + i.abs_diff(k)];
        let from = i.max(k);
        add_multiple(&mut row[from - i..], element, &t.row(k)[from - k..]);
    }
}

vectorised! {
    fn invert(factor: &mut SymmetricMatrix) {
        let size = factor.size;
        let mut inverse = vec![0.0; size];
        // From the last row up, so that the rows below are already inverted.
        for i in (0..size).rev() {
            let (row, mut below) = factor.upper[first(size, i)..].split_at_mut(size - i);
            let inverse = &mut inverse[..size - i];
            inverse.fill(0.0);
            for (k, u) in row.iter().enumerate().skip(1) {
                let (next, others) = below.split_at_mut(size - i - k);
                add_multiple(&mut inverse[k..], -u, next);
                below = others;
            }
            inverse[0] = 1.0;
            let diagonal = row[0];
            row.iter_mut().zip(inverse).for_each(|(to, x)| *to = *x / diagonal);
        }
    }

    /// Computes `Tᵀ·A·T`.
    pub fn congruence(t: &UpperTriangle, a: &SymmetricMatrix) -> SymmetricMatrix {
        let size = a.size;
        let mut product = SymmetricMatrix::zeros(size);
        let mut row = vec![0.0; size];
        for k in 0..size {
            let row = &mut row[k..];
            row_of_product(a, t, k, row);
            for (j, element) in t.row(k).iter().enumerate() {
                add_multiple(product.row_mut(k + j), *element, &row[j..]);
            }
        }
        product
    }

    /// Computes the trace of `Tᵀ·A·T`.
    pub fn trace_of_congruence(t: &UpperTriangle, a: &SymmetricMatrix) -> f64 {
        let mut row = vec![0.0; a.size];
        let mut trace = 0.0;
        for k in 0..a.size {
            row_of_product(a, t, k, &mut row[k..]);
            trace += product(t.row(k), &row[k..]);
        }
        trace
    }

    /// Computes `T` from the columns of `M`, from last to first.
    fn root_of_columns(columns: &mut [Vec<f64>], rows: usize) -> UpperTriangle {
        let size = columns.len();
        for k in 0..size.min(rows) {
            let (done, rest) = columns.split_at_mut(k + 1);
            let (reflection, left) = Reflection::new(&done[k][k..]);
            done[k][k] = left;
            rest.iter_mut().for_each(|column| reflection.apply(&mut column[k..]));
        }
        let last = size - 1;
        UpperTriangle::from_fn(size, |i, j| match columns[last - i].get(last - j) {
            Some(element) => *element,
            None => 0.0,
        })
    }
}

/// The columns of an upper triangular matrix, of lengths 1, 2, …, one per feature.
pub type TriangularColumns = Vec<Vec<f64>>;

pub fn triangular_columns(factor: MatRef<'_, f64>) -> TriangularColumns {
    (0..factor.ncols()).map(|j| (0..=j).map(|i| factor[(i, j)]).collect()).collect()
}

#[cfg(test)]
mod tests {
    use faer::{Mat, Side};
    use proptest::prelude::*;

    use super::*;

    /// `MᵀM + I` for a matrix of numbers up to 1. Its condition number is below 1 + size².
    fn positive(size: usize, numbers: &[f64]) -> SymmetricMatrix {
        let mut a = SymmetricMatrix::from_fn(size, |i, j| -f64::from(u8::from(i == j)));
        a.subtract_squares(&numbers.chunks(size).map(<[f64]>::to_vec).collect::<Vec<_>>());
        a.upper.iter_mut().for_each(|x| *x = -*x);
        a
    }

    fn faer(of: &SymmetricMatrix) -> Mat<f64> {
        Mat::from_fn(of.size, of.size, |i, j| of.row(i.min(j))[i.abs_diff(j)])
    }

    fn unit(size: usize, position: usize) -> Vec<f64> {
        (0..size).map(|i| f64::from(u8::from(i == position))).collect()
    }

    fn matrices() -> impl Strategy<Value = (usize, Vec<f64>)> {
        (1..24_usize)
            .prop_flat_map(|size| (Just(size), prop::collection::vec(-1.0..1.0, size * size)))
    }

    fn check_eigen(a: SymmetricMatrix) {
        let size = a.size;
        let theirs = faer(&a);
        let expected = theirs.self_adjoint_eigenvalues(Side::Lower).unwrap();
        let largest = expected[0].abs().max(expected[size - 1].abs());
        let eigen = a.eigen().unwrap();
        let mut order: Vec<usize> = (0..size).collect();
        order.sort_by(|&i, &j| eigen.values[i].total_cmp(&eigen.values[j]));
        for (expected, &position) in expected.iter().zip(&order) {
            assert!((eigen.values[position] - expected).abs() <= 1e-13 * largest);
            let vector = eigen.vector(position);
            assert!((product(&vector, &vector) - 1.0).abs() < 1e-13);
            for row in 0..size {
                let turned: f64 = (0..size).map(|k| theirs[(row, k)] * vector[k]).sum();
                assert!((turned - eigen.values[position] * vector[row]).abs() <= 1e-12 * largest);
            }
            let mut lanes: Vec<_> = vector.into_iter().map(|x| [x; TOGETHER]).collect();
            eigen.turn(&mut lanes);
            for (i, x) in lanes.into_iter().enumerate() {
                assert!(x.iter().all(|x| (x - f64::from(u8::from(i == position))).abs() < 1e-13));
            }
        }
    }

    proptest! {
        // The smallest eigenvalue is 1 or more, and the condition number some hundreds.
        #[test]
        fn factors_solve_and_invert((size, numbers) in matrices()) {
            let a = positive(size, &numbers);
            let theirs = faer(&a);
            let factor = a.clone().cholesky().unwrap();
            let inverse = factor.clone().inverse();
            for column in 0..size {
                let solved = factor.solve(unit(size, column));
                prop_assert!((factor.square(unit(size, column)) - solved[column]).abs() < 1e-13);
                for row in 0..size {
                    let back: f64 = (0..size).map(|k| theirs[(row, k)] * solved[k]).sum();
                    prop_assert!((back - f64::from(u8::from(row == column))).abs() < 1e-11);
                    let element = inverse.square_element(row.min(column), row.max(column));
                    prop_assert!((element - solved[row]).abs() < 1e-13);
                }
            }
            // U⁻ᵀ·A·U⁻¹ is the identity; its trace equals the trace of A·U⁻¹·U⁻ᵀ.
            let identity = congruence(&inverse, &a);
            for i in 0..size {
                for (j, &element) in identity.row(i).iter().enumerate() {
                    prop_assert!((element - f64::from(u8::from(j == 0))).abs() < 1e-11);
                }
            }
            prop_assert!((trace_of_congruence(&inverse, &a) - size as f64).abs() < 1e-11);
        }

        #[test]
        fn eigenvalues_and_vectors_equal_those_of_faer(
            (size, numbers) in matrices(),
            shift in 0.0..300.0,
            rank in 0..24_usize,
        ) {
            let mut a = positive(size, &numbers);
            // Eigenvalues of either sign.
            (0..size).for_each(|i| a.row_mut(i)[0] -= shift);
            check_eigen(a);
            let rows = numbers.chunks(size).take(rank);
            let graded = |row: &[f64]| row.iter().enumerate().map(|(j, x)| x * 10_f64.powi(-(j as i32 % 7))).collect();
            let mut a = SymmetricMatrix::zeros(size);
            a.subtract_squares(&rows.map(graded).collect::<Vec<_>>());
            check_eigen(a);
        }

        #[test]
        fn the_square_of_a_root_is_the_matrix(
            (rows, size, numbers) in (1..20_usize, 1..12_usize).prop_flat_map(|(rows, size)| {
                (Just(rows), Just(size), prop::collection::vec(-1.0..1.0, rows * size))
            }),
        ) {
            let of: Vec<Vec<f64>> = numbers.chunks(size).map(<[f64]>::to_vec).collect();
            prop_assert_eq!(of.len(), rows);
            let root = UpperTriangle::root_of_squares(&of, size);
            for i in 0..size {
                for j in i..size {
                    let expected: f64 = of.iter().map(|row| row[i] * row[j]).sum();
                    prop_assert!((root.square_element(i, j) - expected).abs() < 1e-13);
                }
            }
        }
    }

    #[test]
    fn matrices_without_factor_or_eigenvalues_are_refused() {
        let of =
            |diagonal: f64| SymmetricMatrix::from_fn(2, |i, j| if i == j { diagonal } else { 1.0 });
        assert!(of(1.5).cholesky().is_some());
        for bad in [1.0, 0.5, f64::NAN, f64::INFINITY] {
            assert!(of(bad).cholesky().is_none(), "{bad}");
        }
        assert!(of(f64::NAN).eigen().is_none());
        assert!(SymmetricMatrix::zeros(0).eigen().unwrap().values.is_empty());
        let zero = SymmetricMatrix::zeros(3).eigen().unwrap();
        assert_eq!(zero.values, [0.0; 3]);
    }
}
