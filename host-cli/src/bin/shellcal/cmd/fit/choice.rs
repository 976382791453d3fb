//! What `shellcal fit` asks of the choice of a model.

use calibration::Model;
use log_file::{Log, ReadOptions};
use shellcal::workflow::WorkflowError;
use shellcal::workflow::model_choice::{self, CovarianceRule, ModelChoice, ModelChoiceOptions};
use shellcal::workflow::weighing::{Weighing, weigh};

use super::super::choices::ModelArg;
use super::FitArgs;
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
                ModelArg::Auto | ModelArg::Physics => None,
            },
            intercept: !self.no_intercept,
            ridge: self.ridge,
            solver: self.solver.0,
            cross_validation: self.cv,
            seed: self.cv_seed,
            // Of use in a calibration file, and nowhere else.
            covariance: match self.output {
                Some(_) => self.covariance.rule(),
                None => CovarianceRule::Nothing,
            },
            fresh: self.fresh,
            read: ReadOptions { progress: Some(&progress), ..self.mapping.read_options() },
        };
        let choice = model_choice::choose(train, &options);
        bar.finish_and_clear();
        Ok(choice?)
    }

    /// Weighs the physics model against the polynomial that was chosen; an error says why it cannot
    /// be.
    pub(super) fn weigh(
        &self,
        train: &[Log],
        choice: &ModelChoice,
        printer: &mut Printer,
    ) -> Option<Result<Weighing, WorkflowError>> {
        let (sums, group_by) = choice.sums.as_ref().zip(choice.group_by)?;
        choice.selection.as_ref()?;
        let bar = printer.progress("physics", train.iter().map(Log::bytes).sum());
        let progress = |bytes| bar.set_position(bytes);
        let read = ReadOptions { progress: Some(&progress), ..self.mapping.read_options() };
        let channels = train.first().map_or(0, Log::channels);
        let model = Model { basis: choice.basis, intercept: !self.no_intercept, channels };
        let candidate = (model, choice.ridge);
        let weighing = weigh(train, sums, group_by, candidate, self.fresh, &read);
        bar.finish_and_clear();
        Some(weighing)
    }
}
