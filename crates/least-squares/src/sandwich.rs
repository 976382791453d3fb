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
//! Where `K_g` and `u_g` come from, exact sums or R factors of a QR factorisation, is not said here.

use faer::{Accum, Mat, MatRef};

use crate::error::FitError;
use crate::held_out_errors::HeldOutErrors;
use crate::solution::Solution;
use crate::symmetric::{SymmetricMatrix, UpperTriangle, add_multiple, product};
use crate::vectors::lower_product;
use shell_data::wrench::PerAxis;

/// `u_g` or `v_g` of each axis.
type Scores = PerAxis<Vec<f64>>;

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

/// The scatter of a fit while its groups are being added.
#[derive(Debug)]
pub(crate) struct ScatterSums {
    groups: usize,
    /// `v_g` of every group that has one.
    scores: PerAxis<Vec<Vec<f64>>>,
    products: PerAxis<PerAxis<f64>>,
    /// The identity less all `K_g`, where these must add up to it.
    pub(crate) defect: Option<SymmetricMatrix>,
    /// The labels of the groups that alone determine a direction.
    alone: Vec<String>,
    common: PerAxis<f64>,
    squares: PerAxis<f64>,
}

impl ScatterSums {
    /// Of a solution, before any group.
    pub(crate) fn new(solution: &Solution) -> Self {
        let (features, products) = (solution.factor.nrows(), &solution.residual_products);
        // Without a ridge, and if no direction was left out, the `K_g` must add up to the identity.
        let all_directions = solution.ridge == 0.0 && solution.rank == features;
        Self {
            groups: 0,
            scores: PerAxis::default(),
            products: std::array::from_fn(|a| {
                std::array::from_fn(|b| products[(a.min(b), a.max(b))])
            }),
            defect: all_directions.then(|| SymmetricMatrix::identity(features)),
            alone: Vec::new(),
            common: PerAxis::default(),
            squares: PerAxis::default(),
        }
    }

    /// Takes the `K_g` of groups off what must be left of the identity.
    pub(crate) fn take_off(&mut self, shares: &SymmetricMatrix) {
        let Some(defect) = &mut self.defect else { return };
        for i in 0..shares.size {
            add_multiple(defect.row_mut(i), -1.0, shares.row(i));
        }
    }

    /// Adds a group by its `v_g`: `None` if it alone determines a direction.
    pub(crate) fn add(
        &mut self,
        label: &str,
        score: Option<Scores>,
        errors: &PerAxis<HeldOutErrors>,
    ) {
        self.groups += 1;
        let Some(score) = score else {
            self.alone.push(label.to_owned());
            return;
        };
        for (axis, of) in errors.iter().enumerate() {
            self.common[axis] += of.sum * of.sum / of.rows as f64;
            self.squares[axis] += of.squares;
        }
        for (products, a) in self.products.iter_mut().zip(&score) {
            products.iter_mut().zip(&score).for_each(|(sum, b)| *sum += product(a, b));
        }
        for (scores, score) in self.scores.iter_mut().zip(score) {
            scores.push(score);
        }
    }

    /// The scatter, after all groups. `F` is in the units that the covariance is wanted in.
    ///
    /// # Errors
    /// [`FitError`] if some group alone determines a coefficient, or the features are too nearly dependent.
    pub(crate) fn finish(self, factor: &UpperTriangle) -> Result<GroupScatter, FitError> {
        let features = factor.size();
        if let Some(defect) = &self.defect {
            let mut all = (0..features).flat_map(|i| defect.row(i));
            if !all.all(|x| x.abs() <= LARGEST_DEFECT) {
                return Err(FitError::NearlyDependent);
            }
        }
        if !self.alone.is_empty() {
            return Err(FitError::Alone { groups: self.alone });
        }
        let shared = std::array::from_fn(|axis| match self.squares[axis] > 0.0 {
            true => (self.common[axis] / self.squares[axis]).min(1.0),
            false => 0.0,
        });
        Ok(GroupScatter {
            groups: self.groups,
            factors: self.scores.each_ref().map(|scores| {
                let rows: Vec<_> = scores.iter().map(|score| factor.times(score)).collect();
                UpperTriangle::root_of_squares(&rows, features).matrix()
            }),
            residual_products: self.products,
            shared,
        })
    }
}

/// `v_g` of `K_g`, features × features, and `u_g`; `None` if the group alone determines a direction.
///
/// # Errors
/// [`FitError::NearlyDependent`].
pub(crate) fn corrected(share: SymmetricMatrix, score: Scores) -> Result<Option<Scores>, FitError> {
    let eigen = share.eigen().ok_or(FitError::NearlyDependent)?;
    let rest: Vec<f64> = eigen.values.iter().map(|value| 1.0 - value.max(0.0)).collect();
    if rest.iter().any(|&rest| rest < ALONE) {
        return Ok(None);
    }
    Ok(Some(score.map(|mut score| {
        eigen.turn(&mut score);
        score.iter_mut().zip(&rest).for_each(|(x, rest)| *x /= rest.sqrt());
        eigen.turn_back(&mut score);
        score
    })))
}

/// The same of `M`, rows × features, and `e`, rows × axes, with `K_g = MᵀM` and `u_g = Mᵀe`. Where rows are fewer,
/// `(I − K_g)^(−½)·u_g = Mᵀ·(I − M·Mᵀ)^(−½)·e`. Beside it is `K_g`, if that was made or is wanted.
///
/// # Errors
/// [`FitError::NearlyDependent`].
pub(crate) fn corrected_rows(
    rows: MatRef<'_, f64>,
    misfit: MatRef<'_, f64>,
    wants_share: bool,
) -> Result<(Option<SymmetricMatrix>, Option<Scores>), FitError> {
    let columns = |of: MatRef<'_, f64>| -> PerAxis<Vec<f64>> {
        std::array::from_fn(|axis| of.col(axis).iter().copied().collect())
    };
    let are_many = rows.nrows() >= rows.ncols();
    let share = (are_many || wants_share).then(|| gram(rows.transpose()));
    if let (true, Some(share)) = (are_many, &share) {
        let score = corrected(share.clone(), columns((rows.transpose() * misfit).as_ref()))?;
        return Ok((Some(share.clone()), score));
    }
    let misfit = corrected(gram(rows), columns(misfit))?;
    let score = misfit.map(|misfit| {
        let misfit = Mat::from_fn(rows.nrows(), misfit.len(), |row, axis| misfit[axis][row]);
        columns((rows.transpose() * misfit).as_ref())
    });
    Ok((share, score))
}

/// `M·Mᵀ`.
fn gram(rows: MatRef<'_, f64>) -> SymmetricMatrix {
    let mut products = Mat::zeros(rows.nrows(), rows.nrows());
    lower_product(products.as_mut(), Accum::Replace, rows);
    SymmetricMatrix::from_fn(rows.nrows(), |i, j| products[(j, i)])
}
