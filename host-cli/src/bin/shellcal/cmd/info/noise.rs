//! `shellcal info --noise`: the scatter of an unloaded sensor.

use std::path::Path;

use calibration_file::CalibrationFile;
use log_file::Log;
use shellcal::workflow::noise::{NoiseSummary, Scatter, noise};
use shellcal::workflow::remark::{moved_zero, used_rows};
use shellcal::workflow::selection::TimeWindow;

use super::InfoArgs;
use crate::printer::Printer;
use crate::tables::{axis_row, number_row};

impl InfoArgs {
    pub(super) fn report_noise(
        &self,
        window: Option<TimeWindow>,
        logs: &[Log],
        file: &CalibrationFile,
        printer: &Printer,
    ) -> anyhow::Result<()> {
        let mut noises = Vec::new();
        for (path, log) in self.files.iter().zip(logs) {
            let summary = printer.scan(log, self.mapping.read_options(), |read| {
                noise(log, &file.calibration, self.frames.rows(log), window, &read)
            })?;
            let counts = [summary.rows, summary.repeated_rows, summary.skipped_rows];
            printer.remarks([used_rows(path, summary.rows_used, counts)]);
            printer.remarks(summary.zero.as_ref().and_then(|zero| moved_zero(path, zero)));
            noises.push((path, summary));
        }
        let documents = noises.iter().map(|(log, of)| document! { log: log, ..summary: of });
        printer.finish(&documents.collect::<Vec<_>>(), |printer| {
            noises.iter().for_each(|(log, summary)| print(printer, log, summary))
        })
    }
}

fn print(printer: &Printer, log: &Path, summary: &NoiseSummary) {
    printer.line(format!("{}: noise of {} frames", log.display(), summary.frames));
    let values = |scatter: &Scatter| [scatter.rms, scatter.peak_to_peak, scatter.mean];
    let axes = summary.axes.iter().map(|(axis, scatter)| axis_row(*axis, values(scatter)));
    let channels = summary.channels.iter().enumerate();
    let channels =
        channels.map(|(i, scatter)| number_row(format!("s{} (counts)", i + 1), values(scatter), 2));
    printer.table(&["quantity", "RMS", "peak to peak", "mean"], axes.chain(channels))
}
