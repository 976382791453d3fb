//! Cholesky factors of small symmetric matrices, on the stack.
//!
//! Sizes are known at compile time (6 axes, 10 parameters), so that nothing is allocated for a
//! frame. Only the lower triangle of a matrix is read. (Golub & Van Loan, 4th ed., §4.2.)

/// The lower factor of `A = L·Lᵀ`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cholesky<const N: usize> {
    l: [[f64; N]; N],
    /// `1/L[j][j]`.
    inverse: [f64; N],
}

impl<const N: usize> Cholesky<N> {
    /// `None` if `a` is not positive definite in floating point.
    #[inline]
    #[expect(clippy::needless_range_loop, reason = "indices as in the formulas")]
    pub(crate) fn new(a: &[[f64; N]; N]) -> Option<Self> {
        let (mut l, mut inverse) = (*a, [0.0; N]);
        for j in 0..N {
            let mut pivot = l[j][j];
            for k in 0..j {
                pivot -= l[j][k] * l[j][k];
            }
            if !(pivot > 0.0 && pivot.is_finite()) {
                return None;
            }
            let root = pivot.sqrt();
            (l[j][j], inverse[j]) = (root, root.recip());
            for i in j + 1..N {
                let mut sum = l[i][j];
                for k in 0..j {
                    sum -= l[i][k] * l[j][k];
                }
                l[i][j] = sum * inverse[j];
            }
        }
        Some(Self { l, inverse })
    }

    /// `A⁻¹·b`.
    #[inline]
    pub(crate) fn solve(&self, b: &[f64; N]) -> [f64; N] {
        let mut x = self.forward(b);
        for i in (0..N).rev() {
            for k in i + 1..N {
                x[i] -= self.l[k][i] * x[k];
            }
            x[i] *= self.inverse[i];
        }
        x
    }

    /// `ln det A`.
    pub(super) fn ln_determinant(&self) -> f64 {
        -2.0 * self.inverse.iter().map(|&x| libm::log(x)).sum::<f64>()
    }

    /// `A⁻¹`.
    pub(crate) fn inverse(&self) -> [[f64; N]; N] {
        std::array::from_fn(|j| {
            self.solve(&std::array::from_fn(|i| if i == j { 1.0 } else { 0.0 }))
        })
    }

    /// `L⁻¹·b`.
    #[inline]
    pub(super) fn forward(&self, b: &[f64; N]) -> [f64; N] {
        let mut x = *b;
        for i in 0..N {
            for k in 0..i {
                x[i] -= self.l[i][k] * x[k];
            }
            x[i] *= self.inverse[i];
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solves_and_inverts() {
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
}
