//! From rows to coefficients: what all solvers have in common.
//!
//! A solver reduces blocks of rows to partial fits, merges partial fits in the order of the rows
//! and solves what is left. Memory does not grow with the number of rows, and blocks may be
//! reduced on several threads.

mod exact;
mod family;
mod reducer;

use std::borrow::Cow;

use faer::linalg::triangular_solve::solve_upper_triangular_in_place;
use faer::{Mat, Par};
use serde::{Deserialize, Serialize};

pub use self::exact::{Exact, ExactPartial, solve_moments};
pub use self::family::{Blocks, fit, fit_by};
pub use self::reducer::Reducer;
use super::features::Features;
use super::least_squares::LeastSquares;
use super::scaling::Scaling;
use super::{FitError, Model};
use shell_data::block::Block;

/// A pass over the rows of a log, block by block.
pub trait Pass: Sync {
    /// What some rows leave behind.
    type Partial: Send;

    /// Whether it is the same in whatever order and groups rows are added and merged.
    const ANY_ORDER: bool = false;

    /// Of no rows.
    fn empty(&self) -> Self::Partial;

    /// Adds the rows of a block. May be called on any thread.
    ///
    /// # Errors
    /// [`FitError`] where the solver cannot work with these readings or wrenches; what is left is
    /// of no further use.
    fn absorb(&self, partial: &mut Self::Partial, block: &Block) -> Result<(), FitError>;

    /// Adds the rows of `later` to those of `earlier`.
    fn merge(&self, earlier: &mut Self::Partial, later: Self::Partial);

    /// Of the rows of a block.
    ///
    /// # Errors
    /// As [`Self::absorb`].
    fn reduce(&self, block: &Block) -> Result<Self::Partial, FitError> {
        let mut partial = self.empty();
        self.absorb(&mut partial, block)?;
        Ok(partial)
    }
}

/// The solvers by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum SolverKind {
    /// Exact sums of integer readings.
    Exact,
    /// Householder QR over row blocks.
    Tsqr,
    /// The same, corrected by residuals in double-double: two passes or more.
    RefinedTsqr,
    /// QR with column pivoting.
    PivotedQr,
    /// Singular values.
    Svd,
    /// Normal equations and Cholesky in `f64`.
    Gram,
    /// Normal equations and Cholesky in double-double.
    WideGram,
    /// Householder QR over row blocks in double-double.
    WideTsqr,
    /// A ridge whose parameter generalised cross-validation chooses.
    RidgeGcv,
    /// Huber's M-estimator: rows far off count less. About ten passes.
    Huber,
}

impl SolverKind {
    /// All solvers.
    pub const ALL: [SolverKind; 10] = [
        SolverKind::Exact,
        SolverKind::Tsqr,
        SolverKind::RefinedTsqr,
        SolverKind::PivotedQr,
        SolverKind::Svd,
        SolverKind::Gram,
        SolverKind::WideGram,
        SolverKind::WideTsqr,
        SolverKind::RidgeGcv,
        SolverKind::Huber,
    ];

    /// The name in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            SolverKind::Exact => "exact",
            SolverKind::Tsqr => "tsqr",
            SolverKind::RefinedTsqr => "refined-tsqr",
            SolverKind::PivotedQr => "pivoted-qr",
            SolverKind::Svd => "svd",
            SolverKind::Gram => "gram",
            SolverKind::WideGram => "wide-gram",
            SolverKind::WideTsqr => "wide-tsqr",
            SolverKind::RidgeGcv => "ridge-gcv",
            SolverKind::Huber => "huber",
        }
    }

    /// What it does, in a few words.
    pub const fn description(self) -> &'static str {
        match self {
            SolverKind::Exact => {
                "Exact sums of integer readings; `refined-tsqr` where readings are not integers"
            }
            SolverKind::Tsqr => "Householder QR over row blocks",
            SolverKind::RefinedTsqr => "The same, corrected by residuals in double-double",
            SolverKind::PivotedQr => "QR with column pivoting",
            SolverKind::Svd => "Singular values",
            SolverKind::Gram => "Normal equations in double precision: fast and coarse",
            SolverKind::WideGram => "Normal equations in double-double",
            SolverKind::WideTsqr => "Householder QR in double-double: slow and sure",
            SolverKind::RidgeGcv => "Ridge, its parameter chosen by generalised cross-validation",
            SolverKind::Huber => "Huber's M-estimator: rows far off count less",
        }
    }
}

/// What a solver is told beside the rows.
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    /// The features.
    pub model: Model,
    /// Centre and scale of the readings.
    pub scaling: Scaling,
    /// λ ≥ 0 of a ridge on columns of norm one; the intercept is not penalised. 0 for none.
    pub ridge: f64,
}

/// Coefficients and all that is known about them. Rows and columns of features are in the order of
/// [`Model::terms`], those of axes in the order of [`shell_data::wrench::Axis::ALL`].
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// The features.
    pub model: Model,
    /// Centre and scale of the readings that the coefficients are for.
    pub scaling: Scaling,
    /// `C`, features × 6, in N and N·m.
    pub coefficients: Mat<f64>,
    /// Upper triangular `F` with `F·Fᵀ = (XᵀX)⁻¹`, ridge included, features × features.
    pub factor: Factor,
    /// `(W − X·C)ᵀ(W − X·C)`, 6 × 6, in products of N and N·m.
    pub residual_products: Mat<f64>,
    /// Rows fitted.
    pub rows: u64,
    /// Condition number of the features, columns scaled to norm one.
    pub condition: f64,
    /// Independent features.
    pub rank: usize,
}

/// An upper triangular matrix `F`, or what it comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum Factor {
    /// `F` itself.
    Known(Mat<f64>),
    /// `F⁻¹`, which costs nothing to have; it is inverted where `F` is asked for.
    Inverse(Mat<f64>),
}

impl Factor {
    /// `F`.
    pub fn matrix(&self) -> Cow<'_, Mat<f64>> {
        match self {
            Factor::Known(factor) => Cow::Borrowed(factor),
            Factor::Inverse(triangle) => {
                let mut inverse = Mat::identity(triangle.nrows(), triangle.ncols());
                solve_upper_triangular_in_place(triangle.as_ref(), inverse.as_mut(), Par::Seq);
                Cow::Owned(inverse)
            }
        }
    }
}

impl Solution {
    pub(super) fn new(features: &Features, solved: LeastSquares) -> Self {
        Self {
            model: features.model(),
            scaling: features.scaling().clone(),
            coefficients: solved.coefficients,
            factor: Factor::Known(solved.factor),
            residual_products: solved.residual_products,
            rows: solved.rows,
            condition: solved.condition,
            rank: solved.rank,
        }
    }
}
