//! What `shellcal fit` asks of the choice of a model.

use calibration::Model;
use log_file::{Log, ReadOptions};
use shellcal::workflow::WorkflowError;
use shellcal::workflow::groups::FoundSummary;
use shellcal::workflow::model_choice::{ModelChoice, ModelChoiceOptions};
use shellcal::workflow::refits;
use shellcal::workflow::selection::UsedRows;
use shellcal::workflow::weighing::{Weighing, weigh};

use super::super::choices::ModelArg;
use super::FitArgs;
use crate::printer::Printer;

impl FitArgs {
    /// Chooses the model, validates it, and sums by group: as much of it as is asked for.
    pub(super) fn choose(
        &self,
        train: &[Log],
        used: UsedRows<'_>,
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
            cross_validation: self.held_out(),
            seed: self.cv_seed,
            covariance: self.covariance_rule(),
            used,
            memory: self.memory_bytes(),
            read: ReadOptions {
                checksum: self.output.is_some(),
                progress: Some(&progress),
                ..self.mapping.read_options()
            },
        };
        let choice = refits::choose(train, &options, self.truncate);
        bar.finish_and_clear();
        let choice = choice?;
        if let Some(groups) = choice.found_groups() {
            note_found(printer, groups);
        }
        Ok(choice)
    }

    /// Weighs the physics model against the polynomial that was chosen; an error says why it cannot
    /// be.
    pub(super) fn weigh(
        &self,
        train: &[Log],
        choice: &ModelChoice,
        used: UsedRows<'_>,
        printer: &mut Printer,
    ) -> Option<Result<Weighing, WorkflowError>> {
        let (sums, group_by) = choice.sums.as_ref().zip(choice.group_by.as_ref())?;
        // Physics is fitted to rows.
        choice.selection.as_ref().filter(|_| !self.means)?;
        let bar = printer.progress("physics", train.iter().map(Log::bytes).sum());
        let progress = |bytes| bar.set_position(bytes);
        let read = ReadOptions { progress: Some(&progress), ..self.mapping.read_options() };
        let channels = train.first().map_or(0, Log::channels);
        let model = Model { basis: choice.basis, intercept: !self.no_intercept, channels };
        let candidate = (model, choice.ridge);
        let weighing = weigh(train, sums, group_by, candidate, used, &read);
        bar.finish_and_clear();
        Some(weighing)
    }
}

/// Says what the groups are where nobody has named them.
pub(super) fn note_found(printer: &mut Printer, groups: FoundSummary) {
    printer.note(format!(
        "the logs name no groups: found {groups}, and took those (`--group` names a column)",
    ));
}
