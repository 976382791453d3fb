//! `shellcal fit --partial`: sums for `shellcal merge`, and no fit.

use std::io::Write;
use std::path::Path;

use anyhow::Context;
use calibration::Model;
use calibration::validation::grouped::RandomSplit;
use log_file::{Log, ReadOptions};
use shellcal::calibration_file::{PartialFit, Role, Source};
use shellcal::output::Outputs;
use shellcal::workflow::groups::GroupBy;
use shellcal::workflow::moments::{self, SumOptions};
use shellcal::workflow::selection::UsedRows;

use super::super::choices::ModelArg;
use super::super::origin;
use super::FitArgs;
use crate::printer::Printer;

impl FitArgs {
    pub(super) fn write_partial(
        &self,
        path: &Path,
        train: &[Log],
        printer: &mut Printer,
        outputs: &Outputs,
    ) -> anyhow::Result<()> {
        let ModelArg::Given(basis) = self.model else {
            anyhow::bail!("`--partial` needs one model, not `--model auto`");
        };
        let mut output = outputs.create(path)?;
        let options = SumOptions {
            basis,
            group_by: GroupBy::File,
            random: RandomSplit::default(),
            used: UsedRows { fresh: self.fresh, excluded: None },
            read: ReadOptions { checksum: true, ..self.mapping.read_options() },
        };
        let (sums, summaries) = moments::sum(train, &options)?;
        let total = sums.total().context("no training rows are left")?.clone();
        let model = Model { basis, intercept: !self.no_intercept, channels: total.channels() };
        let mut partial = PartialFit::new(model, total);
        partial.made_by = origin::program();
        partial.date = origin::date()?;
        for (log, summary) in train.iter().zip(&summaries) {
            partial.skipped_rows += summary.skipped_rows;
            partial.repeated_rows += summary.repeated_rows;
            let rows = if self.fresh { summary.rows - summary.repeated_rows } else { summary.rows };
            let checksum = summary.checksum.clone();
            partial.sources.push(Source {
                role: Role::Train,
                path: log.path().into(),
                checksum,
                rows,
            });
        }
        output.write_all(partial.to_json().as_bytes())?;
        output.commit()?;
        let rows = partial.moments.rows();
        if printer.json() {
            return printer.document(&serde_json::json!({ "model": model.name(), "rows": rows }));
        }
        printer.line(format!("{}: sums over {rows} rows of {} files", model.name(), train.len()))
    }
}
