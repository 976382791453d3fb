//! Symmetric matrices in double-double, and systems of equations with them by iterative refinement.
//!
//! A Cholesky factor in `f64` solves to about κ²·2⁻⁵³ of the solution (κ² being the condition number
//! of the normal equations); each correction by the residual in double-double gains the same factor
//! again, down to what the residual can show (Higham, Accuracy and Stability of Numerical
//! Algorithms, 2nd ed., §12.1). For well-conditioned equations that is a tenth of the work of a
//! factor in double-double.

use faer::linalg::triangular_solve::{
    solve_lower_triangular_in_place, solve_upper_triangular_in_place,
};
use faer::{Mat, Par, Side};

use super::cholesky::{AxisRow, ElementLanes, LANES};
use crate::double_double::DoubleDouble;
use crate::exact::moments::rounding::power_of_two;
use crate::exact::moments::rounding::round;
use crate::symmetric::SymmetricMatrix;
use shell_data::vectorised;

/// A symmetric matrix.
#[derive(Clone, Debug)]
pub(crate) struct DoubleDoubleMatrix {
    size: usize,
    /// The upper triangle, row by row.
    upper: Vec<DoubleDouble>,
}

/// Relative pivots of the factor below which refinement is not tried.
const SMALLEST_PIVOT: f64 = 1.0 / (1u64 << 36) as f64;
/// A correction may be so much smaller than the one before at most.
const SLOWEST: f64 = 1.0 / 1024.0;
/// Corrections that would be smaller than this share of the solution are left out.
const DONE: f64 = 1.0 / (1u128 << 72) as f64;
const MOST_ROUNDS: usize = 6;

impl DoubleDoubleMatrix {
    /// Integers, row by row of the upper triangle, divided by two to the sum of the exponents of row
    /// and column.
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

    /// Adds to an element of the diagonal.
    pub(crate) fn diagonal_mut(&mut self, i: usize) -> &mut DoubleDouble {
        &mut self.upper[i * (2 * self.size + 1 - i) / 2]
    }

    pub(crate) fn get(&self, i: usize, j: usize) -> DoubleDouble {
        let (i, j) = (i.min(j), i.max(j));
        self.upper[i * (2 * self.size + 1 - i) / 2 + j - i]
    }

    /// The elements, rounded.
    pub(crate) fn rounded(&self) -> SymmetricMatrix {
        SymmetricMatrix::from_fn(self.size, |i, j| self.get(i, j).to_f64())
    }

    /// `x` with `A·x = b`, to about 20 digits; `None` if that cannot be computed this way.
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
            // The next step would be smaller by the same factor again.
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

#[cfg(test)]
mod tests {
    use super::*;

    /// The Hilbert matrix of `size` over its common denominator: integers.
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
    fn refinement_gives_all_digits_of_a_solution_that_f64_gives_five_of() {
        // κ₂ of the Hilbert matrix of size seven is 4.8e8, so κ·2⁻⁵³ = 5e-8.
        let matrix = hilbert(7);
        for row in matrix.solve(&row_sums(&matrix)).unwrap() {
            assert!(row.iter().all(|x| (*x - DoubleDouble::ONE).abs().to_f64() < 1e-20));
        }
    }

    #[test]
    fn what_refinement_cannot_solve_it_leaves() {
        // κ₂ = 1.7e16.
        let matrix = hilbert(12);
        assert!(matrix.solve(&row_sums(&matrix)).is_none());
    }

    #[test]
    fn an_indefinite_matrix_and_one_of_zeros_have_no_solution_here() {
        let b = vec![[DoubleDouble::ONE; LANES]; 2];
        for upper in [[1, 2, 1], [0, 0, 0]] {
            assert!(DoubleDoubleMatrix::new(upper.into_iter(), &[0, 0]).solve(&b).is_none());
        }
    }
}
