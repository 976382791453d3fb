//! `shellcal fit --means`: the means of groups in place of their rows.

use calibration_file::{Role, Source};
use log_file::{Log, ReadOptions};
use shellcal::workflow::groups::{FoundGroups, HeldOut};
use shellcal::workflow::means::{self, Means};
use shellcal::workflow::selection::UsedRows;

use super::FitArgs;
use super::choice::note_found;
use crate::printer::Printer;

impl FitArgs {
    /// A log of means, and the files that it is of.
    pub(super) fn reduce_to_means(
        &self,
        train: &[Log],
        used: UsedRows<'_>,
        printer: &mut Printer,
    ) -> anyhow::Result<(Log, Vec<Source>)> {
        let bar = printer.progress("means", train.iter().map(Log::bytes).sum());
        let progress = |bytes| bar.set_position(bytes);
        let read = ReadOptions {
            checksum: self.keeps(),
            progress: Some(&progress),
            ..self.mapping.read_options()
        };
        let held_out = self.cv.unwrap_or(HeldOut::Auto);
        let found = means::of_groups(train, held_out, used, &read);
        bar.finish_and_clear();
        let Means { log, group_by, groups, rows, summaries, rows_of } = found?;
        if let Some(found) = group_by.found().map(FoundGroups::summary) {
            note_found(printer, found);
        }
        let skipped: u64 = summaries.iter().map(|summary| summary.skipped_rows).sum();
        let without = match skipped {
            0 => String::new(),
            skipped => format!(", {skipped} skipped"),
        };
        printer.note(format!("a row is the mean of a group: {groups} of {rows} rows{without}"));
        let mut sources = Vec::new();
        for ((log, summary), rows) in train.iter().zip(summaries).zip(rows_of) {
            let checksum = summary.checksum;
            let has_checksum = checksum.is_some();
            let path = log.path().into();
            sources.push(Source { role: Role::Train, path, checksum, rows });
            if let Some(path) = log.beside() {
                let checksum = if has_checksum { log.checksum_beside()? } else { None };
                sources.push(Source { role: Role::Wrench, path: path.into(), checksum, rows });
            }
        }
        Ok((log, sources))
    }

    /// What is held out: of means, that is always a column.
    pub(super) fn held_out(&self) -> Option<HeldOut> {
        self.cv.map(|held_out| match held_out {
            HeldOut::Folds(_) => held_out,
            _ if self.means => HeldOut::Column,
            _ => held_out,
        })
    }
}
