//! The solvers by name.

/// The solvers by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
