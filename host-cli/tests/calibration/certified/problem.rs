//! A problem, its exact answer, and the digits of it that a method gets.

use calibration::methods::{
    LeastSquares, LeastSquaresError, Method, Reduction, Ridge, RowChunk, RowSource, Shape,
    SolverKind, solve,
};
use faer::Mat;
use num_rational::BigRational;

use self::dense::{Dense, solve_dense};
use super::exact;

#[path = "../../../../crates/least-squares/src/methods/tests/dense.rs"]
mod dense;

/// Methods that minimise the sum of squares, by their names in the tables.
pub(crate) const METHODS: [(&str, SolverKind); 7] = [
    ("gram", SolverKind::Gram),
    ("tsqr", SolverKind::Tsqr),
    ("pivoted-qr", SolverKind::PivotedQr),
    ("svd", SolverKind::Svd),
    ("refined-tsqr", SolverKind::RefinedTsqr),
    ("wide-gram", SolverKind::WideGram),
    ("wide-tsqr", SolverKind::WideTsqr),
];

/// Most digits that an `f64` can show: −log₁₀ 2⁻⁵³.
pub(crate) const ALL_DIGITS: f64 = 15.95;

pub(crate) struct Problem {
    pub(crate) name: String,
    pub(crate) x: Mat<f64>,
    /// Rounding error of `x`.
    pub(crate) tails: Option<Mat<f64>>,
    pub(crate) y: Mat<f64>,
}

impl Problem {
    pub(crate) fn new(name: impl Into<String>, x: Mat<f64>, y: Mat<f64>) -> Self {
        Self { name: name.into(), x, tails: None, y }
    }

    pub(crate) fn solve(&self, method: SolverKind) -> Result<LeastSquares, LeastSquaresError> {
        let tails = self.tails.as_ref().map(|tails| tails.as_ref());
        solve_dense(Dense::new(self.x.as_ref(), tails, self.y.as_ref()), method, Ridge::NONE)
    }

    /// Returns the exact coefficients for the given numbers, with the tails.
    pub(crate) fn truth(&self) -> Option<Vec<Vec<BigRational>>> {
        let columns = |m: &Mat<f64>, tails: Option<&Mat<f64>>| -> Vec<Vec<BigRational>> {
            let element = |i: usize, j: usize| {
                exact::binary(m[(i, j)]) + exact::binary(tails.map_or(0.0, |tails| tails[(i, j)]))
            };
            (0..m.ncols()).map(|j| (0..m.nrows()).map(|i| element(i, j)).collect()).collect()
        };
        exact::solve(&columns(&self.x, self.tails.as_ref()), &columns(&self.y, None), |_| 1)
    }

    pub(crate) fn norms(&self) -> Vec<f64> {
        self.x.col_iter().map(|column| column.norm_l2()).collect()
    }
}

/// Returns the digits of the worst coefficient: the log relative error of McCullough (The American
/// Statistician 52, 1998), or the log absolute error if the true coefficient is zero.
pub(crate) fn digits(solved: &Mat<f64>, truth: &[Vec<BigRational>]) -> f64 {
    let mut worst = ALL_DIGITS;
    for (a, truth) in truth.iter().enumerate() {
        for (j, truth) in truth.iter().enumerate() {
            let mut error = exact::binary(solved[(j, a)]) - truth;
            if *truth.numer() != num_bigint::BigInt::ZERO {
                error /= truth;
            }
            let error = exact::to_f64(&error).abs();
            worst = if error > 0.0 { worst.min(-error.log10()) } else { worst };
        }
    }
    worst.max(0.0)
}

/// Returns `‖D·(C − truth)‖ / ‖D·truth‖`, with `D` the norms of the columns of `X`, for the worst
/// column of `Y`: the error that the theory bounds.
pub(crate) fn error(solved: &Mat<f64>, truth: &[Vec<BigRational>], norms: &[f64]) -> f64 {
    let of = |(a, truth): (usize, &Vec<BigRational>)| {
        let (mut error, mut size) = (0.0_f64, 0.0_f64);
        for (j, truth) in truth.iter().enumerate() {
            error = error.hypot(norms[j] * exact::to_f64(&(exact::binary(solved[(j, a)]) - truth)));
            size = size.hypot(norms[j] * exact::to_f64(truth));
        }
        if size > 0.0 { error / size } else { error }
    };
    truth.iter().enumerate().map(of).fold(0.0, f64::max)
}

/// Returns the relative error that theory allows a method, up to a constant; see the table in
/// [`calibration::methods`]. `solved` is the widest method's answer.
pub(crate) fn theory(method: SolverKind, problem: &Problem, solved: &LeastSquares) -> f64 {
    let epsilon = f64::EPSILON / 2.0;
    let condition = solved.condition;
    let norms = problem.norms();
    // κ + κ²·‖r‖/(‖X·D⁻¹‖·‖D·C‖), ‖X·D⁻¹‖ ≥ 1: Björck 1996, theorem 1.4.6.
    let sensitivity = (0..problem.y.ncols()).map(|a| {
        let residual = solved.residual_products[(a, a)].sqrt();
        let size = (0..norms.len())
            .fold(0.0_f64, |size, j| size.hypot(norms[j] * solved.coefficients[(j, a)]));
        condition + condition * condition * residual / size.max(f64::MIN_POSITIVE)
    });
    let sensitivity = sensitivity.fold(0.0, f64::max);
    let fitted = (0..problem.y.ncols()).map(|a| {
        let size = (0..norms.len())
            .fold(0.0_f64, |size, j| size.hypot(norms[j] * solved.coefficients[(j, a)]));
        problem.y.col(a).norm_l2() / size.max(f64::MIN_POSITIVE)
    });
    // The loss of the right side in the normal equations: κ²·‖y‖/(‖X‖·‖C‖).
    let squared = condition * condition * fitted.fold(1.0, f64::max);
    match method {
        SolverKind::Gram => epsilon * squared,
        SolverKind::WideGram => epsilon + epsilon * epsilon * squared,
        SolverKind::WideTsqr => epsilon + epsilon * epsilon * sensitivity,
        SolverKind::RefinedTsqr => epsilon + epsilon * epsilon * sensitivity * condition,
        _ => epsilon * sensitivity,
    }
}
