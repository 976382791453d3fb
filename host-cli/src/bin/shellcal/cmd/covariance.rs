//! What standard errors come from.

use calibration::fit::CovarianceRule;
use clap::ValueEnum;

/// What the covariance of the coefficients is found from.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(super) enum CovarianceArg {
    /// By the log's group column or its plateaus where there are ten at least, by rows otherwise
    Auto,
    /// Errors are alike within groups: those of the group column, files, or those that are found
    Groups,
    /// Errors are independent from row to row
    Rows,
    /// None: a smaller calibration file, without standard errors
    None,
}

impl CovarianceArg {
    pub(super) fn rule(self) -> CovarianceRule {
        match self {
            Self::Auto => CovarianceRule::Auto,
            Self::Groups => CovarianceRule::Groups,
            Self::Rows => CovarianceRule::Rows,
            Self::None => CovarianceRule::Nothing,
        }
    }
}
