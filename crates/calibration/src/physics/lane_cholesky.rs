//! [Cholesky factors](crate::physics::cholesky) of one small matrix per lane.

use pulp::Simd;

/// The lower factor of `A = L·Lᵀ`; not numbers in a lane whose `A` is not positive definite.
#[derive(Clone, Copy, Debug)]
pub(super) struct LaneCholesky<S: Simd, const N: usize> {
    l: [[S::f64s; N]; N],
    /// `1/L[j][j]`.
    inverse: [S::f64s; N],
}

impl<S: Simd, const N: usize> LaneCholesky<S, N> {
    /// Reads the lower triangle of `a`.
    #[inline(always)]
    pub(super) fn new(simd: S, a: &[[S::f64s; N]; N]) -> Self {
        let one = simd.splat_f64s(1.0);
        let (mut l, mut inverse) = (*a, [one; N]);
        for j in 0..N {
            for i in j..N {
                for k in 0..j {
                    l[i][j] = simd.sub_f64s(l[i][j], simd.mul_f64s(l[i][k], l[j][k]));
                }
            }
            inverse[j] = simd.div_f64s(one, simd.sqrt_f64s(l[j][j]));
            for row in &mut l[j..] {
                row[j] = simd.mul_f64s(row[j], inverse[j]);
            }
        }
        Self { l, inverse }
    }

    /// `A⁻¹·b`.
    #[inline(always)]
    pub(super) fn solve(&self, simd: S, b: &[S::f64s; N]) -> [S::f64s; N] {
        let mut x = *b;
        for i in 0..N {
            for k in 0..i {
                x[i] = simd.sub_f64s(x[i], simd.mul_f64s(self.l[i][k], x[k]));
            }
            x[i] = simd.mul_f64s(x[i], self.inverse[i]);
        }
        for i in (0..N).rev() {
            for k in i + 1..N {
                x[i] = simd.sub_f64s(x[i], simd.mul_f64s(self.l[k][i], x[k]));
            }
            x[i] = simd.mul_f64s(x[i], self.inverse[i]);
        }
        x
    }

    /// The diagonal of `A⁻¹`: the sums of the squares of the columns of `L⁻¹`.
    #[inline(always)]
    pub(super) fn inverse_diagonal(&self, simd: S) -> [S::f64s; N] {
        let zero = simd.splat_f64s(0.0);
        std::array::from_fn(|j| {
            let (mut column, mut sum) = ([zero; N], zero);
            column[j] = self.inverse[j];
            for i in j..N {
                for k in j..i {
                    column[i] = simd.sub_f64s(column[i], simd.mul_f64s(self.l[i][k], column[k]));
                }
                if i > j {
                    column[i] = simd.mul_f64s(column[i], self.inverse[i]);
                }
                sum = simd.add_f64s(simd.mul_f64s(column[i], column[i]), sum);
            }
            sum
        })
    }
}

#[cfg(test)]
mod tests {
    use pulp::Scalar;

    use super::*;
    use crate::physics::cholesky::Cholesky;

    #[test]
    fn agrees_with_the_factor_of_one_matrix() {
        let a: [[f64; 6]; 6] = std::array::from_fn(|i| {
            std::array::from_fn(|j| if i == j { 9.0 + i as f64 } else { 1.0 / (1 + i + j) as f64 })
        });
        let b = [1.0, -2.0, 0.5, 3.0, 0.0, 7.0];
        let (lanes, expected) = (LaneCholesky::new(Scalar, &a), Cholesky::new(&a).unwrap());
        let (x, y) = (lanes.solve(Scalar, &b), expected.solve(&b));
        let (d, inverse) = (lanes.inverse_diagonal(Scalar), expected.inverse());
        for i in 0..6 {
            assert!((x[i] - y[i]).abs() < 1e-14 && (d[i] - inverse[i][i]).abs() < 1e-14);
        }
        let indefinite = LaneCholesky::new(Scalar, &a.map(|row| row.map(|x| -x)));
        assert!(indefinite.solve(Scalar, &b)[0].is_nan());
    }
}
