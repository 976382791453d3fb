//! Symmetric matrices in double-double, and iterative refinement of linear systems.
//!
//! A Cholesky factor in `f64` leaves a relative error of about κ²·2⁻⁵³, where κ² is the condition number of the normal
//! equations. Each correction by a double-double residual reduces the error by that factor again (Higham, Accuracy and
//! Stability of Numerical Algorithms, 2nd ed., §12.1). This takes a tenth of the time of a double-double factor, which
//! only ill-conditioned equations need.

use faer::linalg::triangular_solve::{
    solve_lower_triangular_in_place, solve_upper_triangular_in_place,
};
use faer::{Mat, Par, Side};

use super::integers::{power_of_two, round};
use crate::double_double::DoubleDouble;
use crate::symmetric::SymmetricMatrix;
use shell_data::vectorised;

#[derive(Clone, Debug)]
pub(crate) struct DoubleDoubleMatrix {
    size: usize,
    upper: Vec<DoubleDouble>,
}

/// Smallest relative pivot for which refinement is attempted.
const SMALLEST_PIVOT: f64 = 1.0 / (1u64 << 36) as f64;
/// Largest accepted ratio of a correction to the previous one.
const SLOWEST: f64 = 1.0 / 1024.0;
/// Refinement ends if the next correction would be below this fraction of the solution.
const DONE: f64 = 1.0 / (1u128 << 72) as f64;
const MOST_ROUNDS: usize = 6;

impl DoubleDoubleMatrix {
    /// Builds the matrix from its upper triangle: integers, row by row, to be divided by 2^(row + column exponent).
    pub(crate) fn new(upper: impl Iterator<Item = i128>, exponents: &[i32]) -> Self {
        let size = exponents.len();
        let mut scaled = vec![DoubleDouble::ZERO; size * (size + 1) / 2];
        let (mut upper, mut rows) = (upper, &mut scaled[..]);
        for (i, row) in exponents.iter().enumerate() {
            let now = rows.split_off_mut(..size - i).expect("a triangle");
            for ((element, column), sum) in now.iter_mut().zip(&exponents[i..]).zip(&mut upper) {
                *element = round(sum).scaled(power_of_two(-row - column));
            }
        }
        Self { size, upper: scaled }
    }

    pub(crate) fn diagonal_mut(&mut self, i: usize) -> &mut DoubleDouble {
        &mut self.upper[i * (2 * self.size + 1 - i) / 2]
    }

    pub(crate) fn get(&self, i: usize, j: usize) -> DoubleDouble {
        let (i, j) = (i.min(j), i.max(j));
        self.upper[i * (2 * self.size + 1 - i) / 2 + j - i]
    }

    pub(crate) fn rounded(&self) -> SymmetricMatrix {
        SymmetricMatrix::from_fn(self.size, |i, j| self.get(i, j).to_f64())
    }

    /// Solves `A·x = b` to about 20 digits; `None` if refinement does not reach that.
    pub(crate) fn solve(&self, b: &[AxisRow]) -> Option<Vec<AxisRow>> {
        let matrix = Mat::from_fn(self.size, self.size, |i, j| self.get(i, j).to_f64());
        let cholesky = matrix.llt(Side::Lower).ok()?;
        let lower = cholesky.L();
        let is_sure = |i: usize| lower[(i, i)] * lower[(i, i)] > SMALLEST_PIVOT * matrix[(i, i)];
        if !(0..self.size).all(is_sure) {
            return None;
        }
        let mut x = vec![[DoubleDouble::ZERO; LANES]; self.size];
        let (mut residual, mut before) = (b.to_vec(), f64::INFINITY);
        for _ in 0..MOST_ROUNDS {
            let mut step = Mat::from_fn(self.size, LANES, |i, lane| residual[i][lane].to_f64());
            solve_lower_triangular_in_place(lower, step.as_mut(), Par::Seq);
            solve_upper_triangular_in_place(lower.transpose(), step.as_mut(), Par::Seq);
            let mut largest: f64 = 0.0;
            for lane in 0..LANES {
                let mut size: f64 = 0.0;
                for (x, &step) in x.iter_mut().zip(step.col(lane).iter()) {
                    x[lane] += DoubleDouble::from(step);
                    size = size.max(x[lane].to_f64().abs());
                }
                if size > 0.0 {
                    largest = largest.max(step.col(lane).norm_max() / size);
                }
            }
            if !largest.is_finite() || largest > SLOWEST * before {
                return None;
            }
            let gain = if before.is_finite() { largest / before } else { SLOWEST };
            if largest * gain < DONE {
                return Some(x);
            }
            residual = residual_of(self, b, &x);
            before = largest;
        }
        None
    }
}

vectorised! {
    /// `b − A·x`.
    pub(crate) fn residual_of(matrix: &DoubleDoubleMatrix, b: &[AxisRow], x: &[AxisRow]) -> Vec<AxisRow> {
        let x: Vec<ElementLanes> = x.iter().map(ElementLanes::new).collect();
        let mut residual: Vec<ElementLanes> = b.iter().map(ElementLanes::new).collect();
        let mut upper = &matrix.upper[..];
        for i in 0..matrix.size {
            let (row, rest) = upper.split_at(matrix.size - i);
            upper = rest;
            let mut own = residual[i];
            own.take_away(row[0], &x[i]);
            for (j, &element) in (i + 1..).zip(&row[1..]) {
                own.take_away(element, &x[j]);
                residual[j].take_away(element, &x[i]);
            }
            residual[i] = own;
        }
        residual.iter().map(ElementLanes::row).collect()
    }
}

/// Number of right-hand sides solved at once: six axes and two unused ones, to fill a vector.
pub(crate) const LANES: usize = 8;

pub(crate) type AxisRow = [DoubleDouble; LANES];

pub(crate) fn axis_row(of: impl Fn(usize) -> DoubleDouble) -> AxisRow {
    std::array::from_fn(|axis| if axis < 6 { of(axis) } else { DoubleDouble::ZERO })
}

#[derive(Clone, Copy)]
pub(crate) struct ElementLanes {
    heads: [f64; LANES],
    tails: [f64; LANES],
}

impl ElementLanes {
    #[inline(always)]
    pub(crate) fn new(row: &AxisRow) -> Self {
        Self { heads: row.map(DoubleDouble::to_f64), tails: row.map(DoubleDouble::tail) }
    }

    #[inline(always)]
    pub(crate) fn row(&self) -> AxisRow {
        std::array::from_fn(|lane| self.get(lane))
    }

    #[inline(always)]
    fn get(&self, lane: usize) -> DoubleDouble {
        DoubleDouble::from_parts(self.heads[lane], self.tails[lane])
    }

    #[inline(always)]
    pub(crate) fn take_away(&mut self, factor: DoubleDouble, other: &ElementLanes) {
        let factor = -factor;
        for lane in 0..LANES {
            let sum = self.get(lane) + factor * other.get(lane);
            self.heads[lane] = sum.to_f64();
            self.tails[lane] = sum.tail();
        }
    }
}

/// Upper triangle of a symmetric positive definite matrix, bordered by right-hand sides. [`factor`] replaces it with
/// the Cholesky factor `R`, `A = RᵀR`, bordered by `R⁻ᵀB`.
#[derive(Clone, Debug)]
pub(crate) struct Bordered {
    pub(crate) size: usize,
    width: usize,
    head: Vec<f64>,
    tail: Vec<f64>,
}

impl Bordered {
    pub(crate) fn zero(size: usize, border: usize) -> Self {
        let width = size + border;
        Self { size, width, head: vec![0.0; width * width], tail: vec![0.0; width * width] }
    }

    #[inline(always)]
    pub(crate) fn get(&self, row: usize, column: usize) -> DoubleDouble {
        let at = row * self.width + column;
        DoubleDouble::from_parts(self.head[at], self.tail[at])
    }

    #[inline(always)]
    pub(crate) fn set(&mut self, row: usize, column: usize, value: DoubleDouble) {
        let at = row * self.width + column;
        (self.head[at], self.tail[at]) = (value.to_f64(), value.tail());
    }

    pub(crate) fn border(&self, row: usize) -> AxisRow {
        axis_row(|axis| self.get(row, self.size + axis))
    }
}

vectorised! {
    /// Factors in place and leaves `D − BᵀA⁻¹B` in the corner. The error is the first column without a positive pivot.
    pub(crate) fn factor(a: &mut Bordered) -> Result<(), usize> {
        let width = a.width;
        for k in 0..a.size {
            let pivot = a.get(k, k);
            if pivot.to_f64().is_nan() || pivot.to_f64() <= 0.0 {
                return Err(k);
            }
            let root = pivot.sqrt();
            let inverse = DoubleDouble::ONE / root;
            let row = k * width + k..(k + 1) * width;
            for (head, tail) in a.head[row.clone()].iter_mut().zip(&mut a.tail[row]) {
                let scaled = DoubleDouble::from_parts(*head, *tail) * inverse;
                (*head, *tail) = (scaled.to_f64(), scaled.tail());
            }
            a.set(k, k, root);
            for i in k + 1..width {
                let factor = -a.get(k, i);
                let split = i * width;
                let (above_head, head) = a.head.split_at_mut(split);
                let (above_tail, tail) = a.tail.split_at_mut(split);
                let above = k * width + i..(k + 1) * width;
                let count = width - i;
                let head = &mut head[i..][..count];
                let tail = &mut tail[i..][..count];
                let above_head = &above_head[above.clone()][..count];
                let above_tail = &above_tail[above][..count];
                for j in 0..count {
                    let sum = DoubleDouble::from_parts(head[j], tail[j])
                        + factor * DoubleDouble::from_parts(above_head[j], above_tail[j]);
                    head[j] = sum.to_f64();
                    tail[j] = sum.tail();
                }
            }
        }
        Ok(())
    }

    pub(crate) fn solve_upper(factor: &Bordered, y: &mut [AxisRow]) {
        for k in (0..factor.size).rev() {
            let (rows, solved) = y.split_at_mut(k + 1);
            let mut row = rows[k];
            for (j, other) in (k + 1..).zip(solved.iter()) {
                take_away(&mut row, factor.get(k, j), other);
            }
            rows[k] = divide(&row, factor.get(k, k));
        }
    }

    pub(crate) fn solve_lower(factor: &Bordered, b: &mut [AxisRow]) {
        for k in 0..factor.size {
            let (solved, rest) = b.split_at_mut(k + 1);
            solved[k] = divide(&solved[k], factor.get(k, k));
            for (j, row) in (k + 1..).zip(rest.iter_mut()) {
                take_away(row, factor.get(k, j), &solved[k]);
            }
        }
    }
}

#[inline(always)]
fn take_away(row: &mut AxisRow, factor: DoubleDouble, other: &AxisRow) {
    let factor = -factor;
    for (x, &other) in row.iter_mut().zip(other) {
        *x += factor * other;
    }
}

#[inline(always)]
fn divide(row: &AxisRow, divisor: DoubleDouble) -> AxisRow {
    let inverse = DoubleDouble::ONE / divisor;
    let mut quotient = *row;
    for x in &mut quotient {
        *x = *x * inverse;
    }
    quotient
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The Hilbert matrix of order `size` times its common denominator, which makes it an integer matrix.
    fn hilbert(size: usize) -> DoubleDoubleMatrix {
        let common = (1..2 * size as i128).fold(1, |lcm, n| {
            let gcd = |mut a: i128, mut b: i128| {
                while b != 0 {
                    (a, b) = (b, a % b);
                }
                a
            };
            lcm / gcd(lcm, n) * n
        });
        let upper = (0..size).flat_map(|i| (i..size).map(move |j| common / (i + j + 1) as i128));
        DoubleDoubleMatrix::new(upper, &vec![0; size])
    }

    fn row_sums(matrix: &DoubleDoubleMatrix) -> Vec<AxisRow> {
        let sum = |i| (0..matrix.size).map(|j| matrix.get(i, j)).sum();
        (0..matrix.size).map(|i| [sum(i); LANES]).collect()
    }

    #[test]
    fn refinement_gives_all_digits_where_f64_gives_five() {
        // κ₂ of the Hilbert matrix of order seven is 4.8e8, so κ·2⁻⁵³ = 5e-8.
        let matrix = hilbert(7);
        for row in matrix.solve(&row_sums(&matrix)).unwrap() {
            assert!(row.iter().all(|x| (*x - DoubleDouble::ONE).abs().to_f64() < 1e-20));
        }
    }

    #[test]
    fn refinement_that_does_not_converge_gives_no_solution() {
        // κ₂ = 1.7e16.
        let matrix = hilbert(12);
        assert!(matrix.solve(&row_sums(&matrix)).is_none());
    }

    #[test]
    fn indefinite_and_zero_matrices_have_no_solution() {
        let b = vec![[DoubleDouble::ONE; LANES]; 2];
        for upper in [[1, 2, 1], [0, 0, 0]] {
            assert!(DoubleDoubleMatrix::new(upper.into_iter(), &[0, 0]).solve(&b).is_none());
        }
    }

    #[test]
    fn a_hilbert_matrix_of_size_twelve_is_factored_to_its_condition() {
        // κ₂ ≈ 1.7e16, beyond `f64`; in double-double κ·2⁻¹⁰⁰ leaves 13 digits.
        let size = 12;
        let mut matrix = Bordered::zero(size, 1);
        let entry = |i: usize, j: usize| DoubleDouble::ONE / DoubleDouble::from((i + j + 1) as f64);
        for i in 0..size {
            for j in i..size {
                matrix.set(i, j, entry(i, j));
            }
            matrix.set(i, size, (0..size).map(|j| entry(i, j)).sum());
        }
        factor(&mut matrix).unwrap();
        let mut x: Vec<AxisRow> = (0..size).map(|k| [matrix.get(k, size); LANES]).collect();
        solve_upper(&matrix, &mut x);
        for row in x {
            assert!((row[0].to_f64() - 1.0).abs() < 1e-13, "{row:?}");
        }
    }

    #[test]
    fn solving_with_both_triangles_undoes_a_product() {
        let mut matrix = Bordered::zero(2, 0);
        for (i, j, value) in [(0, 0, 4.0), (0, 1, 2.0), (1, 1, 10.0)] {
            matrix.set(i, j, value.into());
        }
        factor(&mut matrix).unwrap();
        let mut x = [[DoubleDouble::from(10.0); LANES], [DoubleDouble::from(32.0); LANES]];
        solve_lower(&matrix, &mut x);
        solve_upper(&matrix, &mut x);
        assert_eq!(x.map(|row| row[7].to_f64()), [1.0, 3.0]);
    }

    #[test]
    fn an_indefinite_matrix_is_refused_at_its_column() {
        let mut matrix = Bordered::zero(2, 0);
        for (i, j, value) in [(0, 0, 1.0), (0, 1, 2.0), (1, 1, 1.0)] {
            matrix.set(i, j, value.into());
        }
        assert_eq!(factor(&mut matrix), Err(1));
    }
}
