//! A covariance matrix, and what an observation makes of it.

use crate::physics::cholesky::diagonal;

/// `C`, symmetric.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct CovarianceMatrix<const N: usize>(pub(super) Box<[[f64; N]; N]>);

impl<const N: usize> CovarianceMatrix<N> {
    /// Independent parameters with these variances.
    pub(super) fn from_variances(variances: &[f64; N]) -> Self {
        Self(Box::new(diagonal(*variances)))
    }

    /// `C·x`.
    pub(super) fn times(&self, x: &[f64; N]) -> [f64; N] {
        std::array::from_fn(|i| dot(&self.0[i], x))
    }

    /// `xᵀCx`, at least 0.
    pub(super) fn variance(&self, x: &[f64; N]) -> f64 {
        dot(&self.times(x), x).max(0.0)
    }

    /// What is left after an observation of `xᵀp` with this variance: `C − Cx(Cx)ᵀ/(noise + xᵀCx)`
    /// (Golub & Van Loan, 4th ed., §2.1.4).
    pub(super) fn observe(&mut self, x: &[f64; N], noise: f64) {
        let cx = self.times(x);
        let divisor = noise + dot(&cx, x).max(0.0);
        for (row, &left) in self.0.iter_mut().zip(&cx) {
            let share = left / divisor;
            row.iter_mut().zip(&cx).for_each(|(value, right)| *value -= share * right);
        }
    }
}

pub(super) fn dot<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    a.iter().zip(b).fold(0.0, |sum, (a, b)| a.mul_add(*b, sum))
}
