//! How coefficients scatter where errors are alike within groups of rows: what the groups add up to.
//!
//! With `F·Fᵀ = A⁻¹`, `A = XᵀX` over all rows, and for each group of rows its Gram matrix `A_g` and
//! its score `s_g = X_gᵀ(W_g − X_g·C)`,
//!
//! ```text
//! K_g = FᵀA_gF    u_g = Fᵀs_g    v_g = (I − K_g)^(−½)·u_g
//! cov(C) = F·(Σ v_g·v_gᵀ)·Fᵀ
//! ```
//!
//! for each axis: the sandwich over clusters with the correction CR2 of Bell and McCaffrey (Survey
//! Methodology 28, 2002, p. 169), who take the residuals `(I − H_g)^(−½)·e_g`, `H_g = X_gA⁻¹X_gᵀ`.
//! That `A_g` and `s_g` are sufficient follows from `Xᵀ·f(X·A⁻¹·Xᵀ) = f(XᵀX·A⁻¹)·Xᵀ`. Likewise
//!
//! ```text
//! Σ e_gᵀ(I − H_g)⁻¹e_g = Σ eᵀe + Σ u_gᵀ(I − K_g)⁻¹u_g
//! ```
//!
//! whose mean over all rows is the variance of one row: without bias where errors are independent,
//! and where the errors of a group are one and the same and so are its readings.
//!
//! Where `K_g` and `u_g` come from, exact sums or triangles of a QR factorisation, is not said here.

use faer::{Mat, Side};

use shell_data::wrench::PerAxis;

/// A group whose `K_g` has an eigenvalue this near to one determines a direction alone.
const ALONE: f64 = 1e-8;

/// By how much the `K_g` may fail to add up to the identity.
const LARGEST_DEFECT: f64 = 1e-4;

/// What groups of rows say about the scatter of the coefficients.
#[derive(Clone, Debug)]
pub struct GroupScatter {
    /// Groups that have rows.
    pub groups: usize,
    /// For each axis an upper triangular `T`, `T·Tᵀ = cov(C)`: rows are features of centred and
    /// scaled readings, N and N·m.
    pub factors: PerAxis<Mat<f64>>,
    /// `Σ e_gᵀ(I − H_g)⁻¹e_g`, in products of N and N·m.
    pub residual_products: PerAxis<PerAxis<f64>>,
    /// The share of the squared errors that the rows of a group have in common: their mean, squared.
    pub shared: PerAxis<f64>,
}

impl GroupScatter {
    /// The covariance of the errors of one of so many rows, in products of N and N·m.
    pub fn residual_covariance(&self, rows: u64) -> PerAxis<PerAxis<f64>> {
        self.residual_products.map(|row| row.map(|product| product / rows as f64))
    }
}

/// Why groups say nothing about the scatter of the coefficients.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ScatterError {
    /// The groups, by their places, without which the rows do not determine the coefficients.
    Alone(Vec<usize>),
    /// The features are too nearly dependent for this.
    NearlyDependent,
}

/// The scatter of a fit while its groups are being added.
#[derive(Debug)]
pub(crate) struct ScatterSums {
    /// `v_g` of every group, as rows.
    scores: PerAxis<Mat<f64>>,
    products: PerAxis<PerAxis<f64>>,
    /// The identity less all `K_g`.
    defect: Mat<f64>,
    alone: Vec<usize>,
    common: PerAxis<f64>,
    squares: PerAxis<f64>,
}

/// A group of rows.
pub(crate) struct ClusterShare {
    /// `K_g`, features × features.
    pub(crate) share: Mat<f64>,
    /// `u_g`, features × 6.
    pub(crate) score: Mat<f64>,
    /// Rows, sum of the errors and of their squares, for each axis.
    pub(crate) errors: PerAxis<(u64, f64, f64)>,
}

impl ScatterSums {
    /// Of so many groups and features, before any group; `products` are those of the residuals of all rows.
    pub(crate) fn new(groups: usize, features: usize, products: PerAxis<PerAxis<f64>>) -> Self {
        Self {
            scores: std::array::from_fn(|_| Mat::zeros(groups, features)),
            products,
            defect: Mat::identity(features, features),
            alone: Vec::new(),
            common: PerAxis::default(),
            squares: PerAxis::default(),
        }
    }

    /// Adds the group at `place`.
    pub(crate) fn add(&mut self, place: usize, group: ClusterShare) -> Result<(), ScatterError> {
        let ClusterShare { share, score, errors } = group;
        for (axis, (rows, sum, squares)) in errors.into_iter().enumerate() {
            self.common[axis] += sum * sum / rows as f64;
            self.squares[axis] += squares;
        }
        self.defect -= &share;
        let eigen = share.self_adjoint_eigen(Side::Upper);
        let eigen = eigen.map_err(|_| ScatterError::NearlyDependent)?;
        let (basis, values) = (eigen.U(), eigen.S().column_vector());
        let rest: Vec<f64> = values.iter().map(|value| 1.0 - value.max(0.0)).collect();
        if rest.iter().any(|&rest| rest < ALONE) {
            self.alone.push(place);
            return Ok(());
        }
        let mut turned = basis.transpose() * score;
        for (i, rest) in rest.iter().enumerate() {
            turned.row_mut(i).iter_mut().for_each(|x| *x /= rest.sqrt());
        }
        for (products, a) in self.products.iter_mut().zip(turned.col_iter()) {
            for (product, b) in products.iter_mut().zip(turned.col_iter()) {
                *product += a.transpose() * b;
            }
        }
        let score = basis * turned;
        for (scores, score) in self.scores.iter_mut().zip(score.col_iter()) {
            scores.row_mut(place).iter_mut().zip(score.iter()).for_each(|(x, s)| *x = *s);
        }
        Ok(())
    }

    /// The scatter, after all groups. `back` is `Fᵀ` in the units that the covariance is wanted in;
    /// `all_directions` says that the fit has no ridge and has left out no direction, so that the `K_g`
    /// must add up to the identity.
    pub(crate) fn finish(
        self,
        back: &Mat<f64>,
        all_directions: bool,
    ) -> Result<GroupScatter, ScatterError> {
        if all_directions && self.defect.norm_max() > LARGEST_DEFECT {
            return Err(ScatterError::NearlyDependent);
        }
        if !self.alone.is_empty() {
            return Err(ScatterError::Alone(self.alone));
        }
        let shared = std::array::from_fn(|axis| match self.squares[axis] > 0.0 {
            true => (self.common[axis] / self.squares[axis]).min(1.0),
            false => 0.0,
        });
        Ok(GroupScatter {
            groups: self.scores[0].nrows(),
            factors: self.scores.each_ref().map(|scores| upper_root(&(scores * back))),
            residual_products: self.products,
            shared,
        })
    }
}

/// An upper triangular `T` with `T·Tᵀ = MᵀM`, by QR of `M` with its columns backwards.
fn upper_root(m: &Mat<f64>) -> Mat<f64> {
    let size = m.ncols();
    let last = size - 1;
    let backwards = Mat::from_fn(m.nrows(), size, |i, j| m[(i, last - j)]);
    let qr = backwards.qr();
    let r = qr.thin_R();
    Mat::from_fn(size, size, |i, j| {
        if i <= j && last - j < r.nrows() { r[(last - j, last - i)] } else { 0.0 }
    })
}
