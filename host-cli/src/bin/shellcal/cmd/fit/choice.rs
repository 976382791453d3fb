//! What `shellcal fit` asks of the choice of a model.

use log_file::{Log, ReadOptions};
use shellcal::workflow::model_choice::{self, CovarianceRule, ModelChoice, ModelChoiceOptions};

use super::super::choices::ModelArg;
use super::{CovarianceArg, FitArgs};
use crate::printer::Printer;

impl FitArgs {
    /// Chooses the model, validates it, and sums by group: as much of it as is asked for.
    pub(super) fn choose(
        &self,
        train: &[Log],
        printer: &mut Printer,
    ) -> anyhow::Result<ModelChoice> {
        let bar = printer.progress("groups", train.iter().map(Log::bytes).sum());
        let progress = |bytes| bar.set_position(bytes);
        let options = ModelChoiceOptions {
            basis: match self.model {
                ModelArg::Given(basis) => Some(basis),
                ModelArg::Auto => None,
            },
            intercept: !self.no_intercept,
            ridge: self.ridge,
            solver: self.solver.0,
            cross_validation: self.cv,
            seed: self.cv_seed,
            covariance: match self.covariance {
                // Of use in a calibration file, and nowhere else.
                _ if self.output.is_none() => CovarianceRule::Nothing,
                CovarianceArg::Auto => CovarianceRule::Auto,
                CovarianceArg::Groups => CovarianceRule::Groups,
                CovarianceArg::Rows => CovarianceRule::Rows,
                CovarianceArg::None => CovarianceRule::Nothing,
            },
            fresh: self.fresh,
            read: ReadOptions { progress: Some(&progress), ..self.mapping.read_options() },
        };
        let choice = model_choice::choose(train, &options);
        bar.finish_and_clear();
        Ok(choice?)
    }
}
