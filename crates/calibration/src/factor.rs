//! A triangular factor of the inverse of `XᵀX`.

use std::borrow::Cow;

use faer::Mat;

use crate::symmetric::UpperTriangle;

/// An upper triangular matrix `F`, or what it comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum InverseFactor {
    /// `F` itself.
    Known(Mat<f64>),
    /// `F⁻¹`, which costs nothing to have; it is inverted where `F` is asked for.
    Inverse(Mat<f64>),
}

impl InverseFactor {
    /// `F`.
    pub fn matrix(&self) -> Cow<'_, Mat<f64>> {
        match self {
            InverseFactor::Known(factor) => Cow::Borrowed(factor),
            InverseFactor::Inverse(r_factor) => {
                Cow::Owned(UpperTriangle::new(r_factor).inverse().matrix())
            }
        }
    }
}
