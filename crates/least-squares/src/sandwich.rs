//! The scatter of coefficients if errors are correlated within groups of rows.
//!
//! Let `F·Fᵀ = A⁻¹`, with `A = XᵀX` over all rows. For each group of rows with the Gram matrix `A_g` and the score
//! `s_g = X_gᵀ(W_g − X_g·C)`, and each axis,
//!
//! ```text
//! K_g = FᵀA_gF    u_g = Fᵀs_g    v_g = (I − K_g)^(−½)·u_g
//! cov(C) = F·(Σ v_g·v_gᵀ)·Fᵀ
//! ```
//!
//! This is the sandwich estimator over clusters with the correction CR2 of Bell and McCaffrey (Survey Methodology 28,
//! 2002, p. 169), who use the residuals `(I − H_g)^(−½)·e_g`, `H_g = X_gA⁻¹X_gᵀ`. `A_g` and `s_g` suffice because
//! `Xᵀ·f(X·A⁻¹·Xᵀ) = f(XᵀX·A⁻¹)·Xᵀ`. Likewise
//!
//! ```text
//! Σ e_gᵀ(I − H_g)⁻¹e_g = Σ eᵀe + Σ u_gᵀ(I − K_g)⁻¹u_g
//! ```
//!
//! The mean of this sum over all rows estimates the variance of one row. It is unbiased for independent errors, and for
//! groups whose rows have one error and equal readings.

use faer::{Accum, ColRef, Mat, MatRef, RowRef};

use crate::error::FitError;
use crate::held_out_errors::HeldOutErrors;
use crate::satterthwaite::{Influence, Moments};
use crate::solution::Solution;
use crate::symmetric::{Eigen, SymmetricMatrix, TOGETHER, UpperTriangle, add_multiple, product};
use crate::vectors::lower_product;
use shell_data::wrench::PerAxis;

/// `u_g` or `v_g` for each axis.
type Scores = PerAxis<Vec<f64>>;

/// A group alone determines a direction if an eigenvalue of its `K_g` is this close to one.
pub(crate) const ALONE: f64 = 1e-8;

/// Largest accepted deviation of the sum of all `K_g` from the identity.
const LARGEST_DEFECT: f64 = 1e-4;

#[derive(Clone, Debug)]
pub struct GroupScatter {
    pub groups: usize,
    /// Upper triangular `T` of each axis, `T·Tᵀ = cov(C)`, for features of centred and scaled readings, in N and N·m.
    pub factors: PerAxis<Mat<f64>>,
    /// `v_g` of each group, for each axis.
    pub(crate) scores: PerAxis<Vec<Vec<f64>>>,
    /// `Σ e_gᵀ(I − H_g)⁻¹e_g`, in products of N and N·m.
    pub residual_products: PerAxis<PerAxis<f64>>,
    /// Fraction of the squared errors that the rows of a group share: the square of their mean error.
    pub shared: PerAxis<f64>,
    /// Satterthwaite's degrees of freedom of the variance of each coefficient, if they were requested.
    pub degrees_of_freedom: Option<Vec<f64>>,
}

impl GroupScatter {
    /// Covariance of the errors of one row, from `rows` rows, in products of N and N·m.
    pub fn residual_covariance(&self, rows: u64) -> PerAxis<PerAxis<f64>> {
        self.residual_products.map(|row| row.map(|product| product / rows as f64))
    }
}

#[derive(Debug)]
pub(crate) struct ScatterSums {
    groups: usize,
    /// `v_g` of every group that does not determine a direction alone.
    scores: PerAxis<Vec<Vec<f64>>>,
    products: PerAxis<PerAxis<f64>>,
    /// Identity minus the sum of all `K_g`; `None` if they need not add up to the identity.
    pub(crate) defect: Option<SymmetricMatrix>,
    alone: Vec<String>,
    common: PerAxis<f64>,
    squares: PerAxis<f64>,
    /// Moments of each coefficient whose degrees of freedom are requested.
    moments: Vec<Moments>,
}

pub(crate) struct Part {
    /// `v_g` for each axis.
    scores: Scores,
    influences: Vec<Influence>,
}

impl ScatterSums {
    /// Sums of zero groups, with degrees of freedom for `coefficients` coefficients.
    pub(crate) fn new(solution: &Solution, coefficients: usize) -> Self {
        let features = solution.factor.nrows();
        // Without a ridge, and if no direction was dropped, the `K_g` must add up to the identity.
        let all_directions = solution.ridge == 0.0 && solution.rank == features;
        Self {
            defect: all_directions.then(|| SymmetricMatrix::identity(features)),
            moments: (0..coefficients).map(|_| Moments::new(features)).collect(),
            ..Self::of_products(&solution.residual_products)
        }
    }

    /// Sums of zero groups that start from these products of residuals, without the check that all `K_g` add up.
    pub(crate) fn of_products(products: &Mat<f64>) -> Self {
        Self {
            groups: 0,
            scores: PerAxis::default(),
            products: std::array::from_fn(|a| {
                std::array::from_fn(|b| products[(a.min(b), a.max(b))])
            }),
            defect: None,
            alone: Vec::new(),
            common: PerAxis::default(),
            squares: PerAxis::default(),
            moments: Vec::new(),
        }
    }

    pub(crate) fn take_off(&mut self, shares: &SymmetricMatrix) {
        let Some(defect) = &mut self.defect else { return };
        for i in 0..shares.size {
            add_multiple(defect.row_mut(i), -1.0, shares.row(i));
        }
    }

    /// Adds a group. `part` is its contribution; `None` if the group determines a direction alone.
    pub(crate) fn add(&mut self, label: &str, part: Option<Part>, errors: &PerAxis<HeldOutErrors>) {
        self.groups += 1;
        let Some(Part { scores: score, influences }) = part else {
            self.alone.push(label.to_owned());
            return;
        };
        self.moments.iter_mut().zip(&influences).for_each(|(sums, part)| sums.add(part));
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

    /// The scatter, after all groups. The units of `F` determine those of the covariance.
    ///
    /// # Errors
    /// [`FitError`] if one group alone determines a coefficient, or the features are too nearly dependent.
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
            scores: self.scores,
            residual_products: self.products,
            shared,
            degrees_of_freedom: (!self.moments.is_empty())
                .then(|| self.moments.iter().map(Moments::degrees_of_freedom).collect()),
        })
    }
}

/// Contribution of a group, from `K_g` (features × features), `u_g`, and the `y` of
/// [`coefficients`](crate::satterthwaite::coefficients); `None` if the group determines a direction alone.
pub(crate) fn corrected(
    share: &SymmetricMatrix,
    score: Scores,
    coefficients: &[Vec<f64>],
) -> Result<Option<Part>, FitError> {
    let Some(correction) = Correction::new(share.clone())? else { return Ok(None) };
    let (scores, corrected) = correction.apply(score, coefficients.iter().cloned());
    let influence = |v: &Vec<f64>| {
        let pull = share.times(v);
        Influence { own: product(v, &pull), pull }
    };
    Ok(Some(Part { scores, influences: corrected.iter().map(influence).collect() }))
}

/// Contribution of a group, from `M` (rows × features) and `e` (rows × axes): `K_g = MᵀM`, `u_g = Mᵀe`. Few rows use
/// `(I − K_g)^(−½)·Mᵀ = Mᵀ·(I − M·Mᵀ)^(−½)`. Also returns `K_g`, if it was computed or `wants_share`.
pub(crate) fn corrected_rows(
    rows: MatRef<'_, f64>,
    misfit: MatRef<'_, f64>,
    wants_share: bool,
    coefficients: &[Vec<f64>],
) -> Result<(Option<SymmetricMatrix>, Option<Part>), FitError> {
    let columns = |of: MatRef<'_, f64>| -> PerAxis<Vec<f64>> {
        std::array::from_fn(|axis| of.col(axis).iter().copied().collect())
    };
    let are_many = rows.nrows() >= rows.ncols();
    let share = (are_many || wants_share).then(|| gram(rows.transpose()));
    if let (true, Some(share)) = (are_many, &share) {
        let score = columns((rows.transpose() * misfit).as_ref());
        let part = corrected(share, score, coefficients)?;
        return Ok((Some(share.clone()), part));
    }
    let Some(correction) = Correction::new(gram(rows))? else { return Ok((share, None)) };
    let back = |of: &[Vec<f64>]| {
        rows.transpose() * Mat::from_fn(rows.nrows(), of.len(), |row, column| of[column][row])
    };
    let coefficients = coefficients.iter().map(|y| rows_times(rows, y));
    let (scores, corrected) = correction.apply(columns(misfit), coefficients);
    let pulls = back(&corrected);
    let influence = |(v, pull): (&Vec<f64>, ColRef<'_, f64>)| Influence {
        own: product(v, v),
        pull: pull.iter().copied().collect(),
    };
    let part = Part {
        scores: columns(back(&scores).as_ref()),
        influences: corrected.iter().zip(pulls.col_iter()).map(influence).collect(),
    };
    Ok((share, Some(part)))
}

/// `(I − K)^(−½)`.
struct Correction {
    eigen: Eigen,
    /// The eigenvalues of `I − K`.
    rest: Vec<f64>,
}

impl Correction {
    /// Correction for `K`, which is `share`; `None` if an eigenvalue of `I − K` is too small.
    fn new(share: SymmetricMatrix) -> Result<Option<Self>, FitError> {
        let eigen = share.eigen().ok_or(FitError::NearlyDependent)?;
        let rest: Vec<f64> = eigen.values.iter().map(|value| 1.0 - value.max(0.0)).collect();
        let is_alone = rest.iter().any(|&rest| rest < ALONE);
        Ok((!is_alone).then_some(Self { eigen, rest }))
    }

    fn apply(
        &self,
        axes: Scores,
        others: impl IntoIterator<Item = Vec<f64>>,
    ) -> (Scores, Vec<Vec<f64>>) {
        let mut all: Vec<_> = axes.into_iter().chain(others).collect();
        let mut lanes = vec![[0.0; TOGETHER]; self.rest.len()];
        for together in all.chunks_mut(TOGETHER) {
            for (lane, x) in together.iter().enumerate() {
                lanes.iter_mut().zip(x).for_each(|(to, x)| to[lane] = *x);
            }
            self.eigen.turn(&mut lanes);
            for (x, rest) in lanes.iter_mut().zip(&self.rest) {
                let root = rest.sqrt();
                x.iter_mut().for_each(|x| *x /= root);
            }
            self.eigen.turn_back(&mut lanes);
            for (lane, x) in together.iter_mut().enumerate() {
                x.iter_mut().zip(&lanes).for_each(|(to, x)| *to = x[lane]);
            }
        }
        let mut all = all.into_iter();
        (std::array::from_fn(|_| all.next().unwrap_or_default()), all.collect())
    }
}

fn rows_times(rows: MatRef<'_, f64>, x: &[f64]) -> Vec<f64> {
    let of_row = |row: RowRef<'_, f64>| row.iter().zip(x).map(|(m, x)| m * x).sum();
    rows.row_iter().map(of_row).collect()
}

/// Computes `M·Mᵀ`.
pub(crate) fn gram(rows: MatRef<'_, f64>) -> SymmetricMatrix {
    let mut products = Mat::zeros(rows.nrows(), rows.nrows());
    lower_product(products.as_mut(), Accum::Replace, rows);
    SymmetricMatrix::from_fn(rows.nrows(), |i, j| products[(j, i)])
}
