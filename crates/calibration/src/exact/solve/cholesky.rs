//! Cholesky factorisation in double-double arithmetic, vectorised.

use crate::double_double::DoubleDouble;
use shell_data::vectorised;

/// Right-hand sides that are solved for at once: six axes, and two idle ones to fill a vector.
pub(crate) const LANES: usize = 8;

/// One row of right-hand sides or solutions.
pub(crate) type AxisRow = [DoubleDouble; LANES];

/// The row of what belongs to each of the six axes.
pub(crate) fn axis_row(of: impl Fn(usize) -> DoubleDouble) -> AxisRow {
    std::array::from_fn(|axis| if axis < 6 { of(axis) } else { DoubleDouble::ZERO })
}

/// A row with its heads and tails apart, each a vector: what loops work on.
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

    /// `self −= factor·other`.
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

/// The upper triangle of a symmetric positive definite matrix, bordered by right-hand sides; then
/// its Cholesky factor `R`, `A = RᵀR`, bordered by `R⁻ᵀB`.
#[derive(Clone, Debug)]
pub(crate) struct Bordered {
    /// Rows and columns of the matrix.
    pub(crate) size: usize,
    width: usize,
    head: Vec<f64>,
    tail: Vec<f64>,
}

impl Bordered {
    /// Zero, of `size` columns and a border of `border` columns.
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

    /// The border beside a row, of one column for each axis.
    pub(crate) fn border(&self, row: usize) -> AxisRow {
        axis_row(|axis| self.get(row, self.size + axis))
    }
}

vectorised! {
    /// Factors the matrix; what is left in the corner of the border is `D − BᵀA⁻¹B`.
    ///
    /// # Errors
    /// The column at which the matrix turned out not to be positive definite.
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

    /// `x` with `R·x = y`, in place.
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

    /// `y` with `Rᵀ·y = b`, in place.
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

/// `row −= factor·other`.
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

    #[test]
    fn a_hilbert_matrix_of_size_twelve_is_factored_to_its_condition() {
        // κ₂ ≈ 1.7e16, hopeless in f64; in double-double κ·2⁻¹⁰⁰ leaves 13 digits.
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
