//! Upper triangles: factors, their inverses, and roots of sums of squares.

use faer::Mat;

use super::eigen::Reflection;
use super::{SymmetricMatrix, add_multiple, first, product};
use shell_data::vectorised;

/// An upper triangular matrix.
#[derive(Clone, Debug)]
pub(crate) struct UpperTriangle(pub(super) SymmetricMatrix);

impl UpperTriangle {
    /// Of `element(i, j)`, `i ≤ j`.
    pub(crate) fn from_fn(size: usize, element: impl FnMut(usize, usize) -> f64) -> Self {
        Self(SymmetricMatrix::from_fn(size, element))
    }

    /// The upper triangle of a square matrix.
    pub(crate) fn new(matrix: &Mat<f64>) -> Self {
        Self::from_fn(matrix.nrows(), |i, j| matrix[(i, j)])
    }

    /// With the zeros.
    pub(crate) fn matrix(&self) -> Mat<f64> {
        let element = |i, j| if i <= j { self.row(i)[j - i] } else { 0.0 };
        Mat::from_fn(self.size(), self.size(), element)
    }

    pub(crate) fn size(&self) -> usize {
        self.0.size
    }

    /// A row from the diagonal on.
    pub(crate) fn row(&self, row: usize) -> &[f64] {
        self.0.row(row)
    }

    /// A row from the diagonal on.
    pub(crate) fn row_mut(&mut self, row: usize) -> &mut [f64] {
        self.0.row_mut(row)
    }

    /// `T` with `T·Tᵀ = MᵀM`, of the rows of `M`: by Householder's reflections of `M` with its columns backwards.
    pub(crate) fn root_of_squares(rows: &[Vec<f64>], size: usize) -> Self {
        let backwards = (0..size).rev();
        let mut columns: Vec<Vec<f64>> =
            backwards.map(|column| rows.iter().map(|row| row[column]).collect()).collect();
        root_of_columns(&mut columns, rows.len())
    }

    /// `U⁻ᵀ·b`.
    pub(crate) fn forward(&self, mut b: Vec<f64>) -> Vec<f64> {
        for i in 0..self.size() {
            let row = self.row(i);
            let (head, tail) = b.split_at_mut(i + 1);
            head[i] /= row[0];
            add_multiple(tail, -head[i], &row[1..]);
        }
        b
    }

    /// `bᵀ·(UᵀU)⁻¹·b`.
    pub(crate) fn square(&self, b: Vec<f64>) -> f64 {
        let z = self.forward(b);
        product(&z, &z)
    }

    /// `(UᵀU)⁻¹·b`.
    pub(crate) fn solve(&self, b: Vec<f64>) -> Vec<f64> {
        let mut b = self.forward(b);
        for i in (0..self.size()).rev() {
            let row = self.row(i);
            b[i] = (b[i] - product(&row[1..], &b[i + 1..])) / row[0];
        }
        b
    }

    /// `U⁻¹`, not finite if a number of the diagonal is zero.
    pub(crate) fn inverse(mut self) -> Self {
        invert(&mut self.0);
        self
    }

    /// An element of `T·Tᵀ`, `i ≤ j`.
    pub(crate) fn square_element(&self, i: usize, j: usize) -> f64 {
        product(&self.row(i)[j - i..], self.row(j))
    }

    /// `T·b`.
    pub(crate) fn times(&self, b: &[f64]) -> Vec<f64> {
        (0..self.size()).map(|i| product(self.row(i), &b[i..])).collect()
    }

    /// `Tᵀ·b`.
    pub(crate) fn transposed_times(&self, b: &[f64]) -> Vec<f64> {
        let mut sums = vec![0.0; self.size()];
        for (i, &b) in b.iter().enumerate() {
            add_multiple(&mut sums[i..], b, self.row(i));
        }
        sums
    }
}

/// A row of `A·T` from the diagonal on.
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
        // From the last row up: those below are inverted.
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

    /// `Tᵀ·A·T`.
    pub(crate) fn congruence(t: &UpperTriangle, a: &SymmetricMatrix) -> SymmetricMatrix {
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

    /// The trace of `Tᵀ·A·T`.
    pub(crate) fn trace_of_congruence(t: &UpperTriangle, a: &SymmetricMatrix) -> f64 {
        let mut row = vec![0.0; a.size];
        let mut trace = 0.0;
        for k in 0..a.size {
            row_of_product(a, t, k, &mut row[k..]);
            trace += product(t.row(k), &row[k..]);
        }
        trace
    }

    /// The columns are those of `M`, the last first.
    fn root_of_columns(columns: &mut [Vec<f64>], rows: usize) -> UpperTriangle {
        let size = columns.len();
        for k in 0..size.min(rows) {
            let (done, rest) = columns.split_at_mut(k + 1);
            let (reflection, left) = Reflection::new(&done[k][k..]);
            done[k][k] = left;
            rest.iter_mut().for_each(|column| reflection.apply(&mut column[k..]));
        }
        let last = size - 1;
        // Rows and columns of R, from the last to the first.
        UpperTriangle::from_fn(size, |i, j| match columns[last - i].get(last - j) {
            Some(element) => *element,
            None => 0.0,
        })
    }
}
