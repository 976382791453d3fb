//! What standard errors come from, and what is said where it cannot be had.

use calibration::validation::ValidationError;
use clap::ValueEnum;
use shellcal::workflow::model_choice::{CovarianceRule, FewGroups};

use crate::printer::Printer;

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

    /// Standard errors that were asked for and cannot be had are an error; those that are only
    /// better are not.
    pub(super) fn tell_not_grouped(
        self,
        reason: &ValidationError,
        printer: &mut Printer,
    ) -> anyhow::Result<()> {
        anyhow::ensure!(!matches!(self, Self::Groups), "no covariance by groups: {reason}");
        printer.warning(format!(
            "standard errors take rows as independent, and are too small where rows of a group \
             resemble each other: {reason}"
        ));
        Ok(())
    }
}

pub(super) fn warn_of_few_groups(few: &FewGroups, printer: &mut Printer) {
    let FewGroups { features, groups } = few;
    printer.warning(format!(
        "no standard errors and intervals: {features} features for {groups} groups of rows; it \
         takes twice as many groups as features, {}, for the groups to tell how far to trust \
         the rest. Record more, or take a smaller model or `--model physics`",
        2 * features
    ));
}
