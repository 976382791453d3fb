//! The solvers by name.

/// The solvers by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
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
        NAMES[self as usize].0
    }

    /// What it does, in a few words.
    pub const fn description(self) -> &'static str {
        NAMES[self as usize].1
    }
}

/// The names of the solvers and what they do, in the order of [`SolverKind`].
const NAMES: [(&str, &str); 10] = [
    ("exact", "Exact sums of integer readings; `refined-tsqr` where readings are not integers"),
    ("tsqr", "Householder QR over row blocks"),
    ("refined-tsqr", "The same, corrected by residuals in double-double"),
    ("pivoted-qr", "QR with column pivoting"),
    ("svd", "Singular values"),
    ("gram", "Normal equations in double precision: fast and coarse"),
    ("wide-gram", "Normal equations in double-double"),
    ("wide-tsqr", "Householder QR in double-double: slow and sure"),
    ("ridge-gcv", "Ridge, its parameter chosen by generalised cross-validation"),
    ("huber", "Huber's M-estimator: rows far off count less"),
];
