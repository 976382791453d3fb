//! A triangular factor of the inverse of `XᵀX`.

use std::sync::OnceLock;

use faer::Mat;

use crate::symmetric::UpperTriangle;

/// An upper triangular matrix `F`, or its inverse, which costs nothing to have: it is inverted once, where `F` is asked
/// for.
#[derive(Clone, Debug)]
pub struct InverseFactor {
    /// Empty where `F` itself is known.
    inverse: Mat<f64>,
    matrix: OnceLock<Mat<f64>>,
}

impl InverseFactor {
    /// `F⁻¹` is known.
    pub(crate) fn from_inverse(inverse: Mat<f64>) -> Self {
        Self { inverse, matrix: OnceLock::new() }
    }

    /// `F`.
    pub fn matrix(&self) -> &Mat<f64> {
        self.matrix.get_or_init(|| UpperTriangle::new(&self.inverse).inverse().matrix())
    }
}

impl From<Mat<f64>> for InverseFactor {
    /// `F` is known.
    fn from(factor: Mat<f64>) -> Self {
        Self { inverse: Mat::new(), matrix: OnceLock::from(factor) }
    }
}

impl PartialEq for InverseFactor {
    fn eq(&self, other: &Self) -> bool {
        self.matrix() == other.matrix()
    }
}
