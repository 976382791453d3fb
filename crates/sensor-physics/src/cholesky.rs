//! Cholesky factors of small symmetric matrices, on the stack.
//!
//! Sizes are fixed: 6 axes, 10 parameters. Only lower triangles are read (Golub & Van Loan, 4th
//! ed., §4.2).

use pulp::{Scalar, Simd};

use super::lanes::Lanes;

pub fn diagonal<const N: usize>(of: [f64; N]) -> [[f64; N]; N] {
    std::array::from_fn(|i| std::array::from_fn(|j| if i == j { of[i] } else { 0.0 }))
}

pub(super) fn identity<const N: usize>() -> [[f64; N]; N] {
    diagonal([1.0; N])
}

/// The lower factor of `A = L·Lᵀ`.
#[derive(Clone, Copy, Debug)]
pub struct Cholesky<const N: usize>(LaneCholesky<Scalar, N>);

impl<const N: usize> Cholesky<N> {
    /// Factor of `a`; `None` if `a` is not positive definite in floating point.
    #[inline]
    pub fn new(a: &[[f64; N]; N]) -> Option<Self> {
        let factor = LaneCholesky::new(&a.map(|row| row.map(scalar)));
        let is_of_pivot = |inverse: &Lanes<Scalar>| inverse.1 > 0.0 && inverse.1.is_finite();
        factor.inverse.iter().all(is_of_pivot).then_some(Self(factor))
    }

    /// `A⁻¹·b`.
    #[inline]
    pub fn solve(&self, b: &[f64; N]) -> [f64; N] {
        self.0.solve(&b.map(scalar)).map(|x| x.1)
    }

    pub(super) fn ln_determinant(&self) -> f64 {
        -2.0 * self.0.inverse.iter().map(|x| libm::log(x.1)).sum::<f64>()
    }

    /// `A⁻¹`.
    pub fn inverse(&self) -> [[f64; N]; N] {
        identity().map(|column| self.solve(&column))
    }

    /// `L⁻¹·b`.
    #[inline]
    pub(super) fn forward(&self, b: &[f64; N]) -> [f64; N] {
        self.0.forward(&b.map(scalar)).map(|x| x.1)
    }
}

fn scalar(x: f64) -> Lanes<Scalar> {
    Lanes(Scalar, x)
}

/// Lower factors of one matrix per lane; NaN in a lane whose `A` is not positive definite.
#[derive(Clone, Copy, Debug)]
pub(super) struct LaneCholesky<S: Simd, const N: usize> {
    l: [[Lanes<S>; N]; N],
    /// `1/L[j][j]`.
    inverse: [Lanes<S>; N],
}

impl<S: Simd, const N: usize> LaneCholesky<S, N> {
    #[inline(always)]
    pub(super) fn new(a: &[[Lanes<S>; N]; N]) -> Self {
        let one = Lanes::splat(a[0][0].0, 1.0);
        let (mut l, mut inverse) = (*a, [one; N]);
        for j in 0..N {
            for i in j..N {
                for k in 0..j {
                    l[i][j] = l[i][j] - l[i][k] * l[j][k];
                }
            }
            inverse[j] = one / l[j][j].sqrt();
            for row in &mut l[j..] {
                row[j] = row[j] * inverse[j];
            }
        }
        Self { l, inverse }
    }

    /// `A⁻¹·b`.
    #[inline(always)]
    pub(super) fn solve(&self, b: &[Lanes<S>; N]) -> [Lanes<S>; N] {
        let mut x = self.forward(b);
        for i in (0..N).rev() {
            for k in i + 1..N {
                x[i] = x[i] - self.l[k][i] * x[k];
            }
            x[i] = x[i] * self.inverse[i];
        }
        x
    }

    /// `L⁻¹·b`.
    #[inline(always)]
    fn forward(&self, b: &[Lanes<S>; N]) -> [Lanes<S>; N] {
        let mut x = *b;
        for i in 0..N {
            for k in 0..i {
                x[i] = x[i] - self.l[i][k] * x[k];
            }
            x[i] = x[i] * self.inverse[i];
        }
        x
    }

    /// The diagonal of `A⁻¹`: the sums of the squares of the columns of `L⁻¹`.
    #[inline(always)]
    pub(super) fn inverse_diagonal(&self) -> [Lanes<S>; N] {
        let zero = Lanes::splat(self.inverse[0].0, 0.0);
        std::array::from_fn(|j| {
            let (mut column, mut sum) = ([zero; N], zero);
            column[j] = self.inverse[j];
            for i in j..N {
                for k in j..i {
                    column[i] = column[i] - self.l[i][k] * column[k];
                }
                if i > j {
                    column[i] = column[i] * self.inverse[i];
                }
                sum = column[i] * column[i] + sum;
            }
            sum
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_factor_solves_and_inverts() {
        let a = [[4.0, 0.0, 0.0], [2.0, 5.0, 0.0], [-1.0, 0.5, 3.0]];
        let full = |i: usize, j: usize| a[i.max(j)][i.min(j)];
        let factor = Cholesky::new(&a).unwrap();
        let b = [1.0, -2.0, 0.5];
        let x = factor.solve(&b);
        for (i, b) in b.iter().enumerate() {
            let product: f64 = (0..3).map(|j| full(i, j) * x[j]).sum();
            assert!((product - b).abs() < 1e-14);
        }
        assert!((factor.inverse()[0][1] - factor.inverse()[1][0]).abs() < 1e-16);
        // 4·(5·3 − 0.25) − 2·(2·3 + 0.5) − (1 + 5).
        assert!((factor.ln_determinant() - 40.0_f64.ln()).abs() < 1e-14);
    }

    #[test]
    fn an_indefinite_matrix_has_no_factor() {
        assert!(Cholesky::new(&[[1.0, 0.0], [2.0, 1.0]]).is_none());
        assert!(Cholesky::new(&[[f64::NAN]]).is_none());
    }

    #[test]
    fn lanes_agree_with_the_factor_of_one_matrix() {
        let a: [[f64; 6]; 6] = std::array::from_fn(|i| {
            std::array::from_fn(|j| if i == j { 9.0 + i as f64 } else { 1.0 / (1 + i + j) as f64 })
        });
        let b = [1.0, -2.0, 0.5, 3.0, 0.0, 7.0];
        let lanes = LaneCholesky::new(&a.map(|row| row.map(scalar)));
        let expected = Cholesky::new(&a).unwrap();
        let (x, y) = (lanes.solve(&b.map(scalar)), expected.solve(&b));
        let (d, inverse) = (lanes.inverse_diagonal(), expected.inverse());
        for i in 0..6 {
            assert!((x[i].1 - y[i]).abs() < 1e-14 && (d[i].1 - inverse[i][i]).abs() < 1e-14);
        }
        let indefinite = LaneCholesky::new(&a.map(|row| row.map(|x| scalar(-x))));
        assert!(indefinite.solve(&b.map(scalar))[0].1.is_nan());
    }
}
