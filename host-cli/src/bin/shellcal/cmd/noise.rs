//! `shellcal noise`: how much an unloaded sensor scatters.

use std::path::Path;

use log_file::Log;
use shellcal::workflow::noise::{NoiseOptions, NoiseSummary, Scatter, noise};
use shellcal::workflow::remark::{moved_zero, used_rows};
use shellcal::workflow::selection::TimeWindow;

use super::frames::{FrameArgs, parse_window};
use super::mapping::{EditedArg, MappingArgs, tell_remembered};
use crate::files::InputPath;
use crate::printer::Printer;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal noise calibration.json unloaded.csv
  shellcal noise calibration.json run3.txt --window 0:0.1")]
pub(crate) struct NoiseArgs {
    /// Calibration file
    #[arg(value_name = "CAL")]
    calibration: InputPath,

    /// Logs of the unloaded sensor, plain or gzip
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<InputPath>,

    /// Use only what lies between two times, in s on the log's clock
    #[arg(long, value_name = "START:END", value_parser = parse_window)]
    window: Option<TimeWindow>,

    #[command(flatten)]
    edited: EditedArg,

    #[command(flatten)]
    frames: FrameArgs,

    #[command(flatten)]
    mapping: MappingArgs,
}

impl NoiseArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        let file = self.edited.read(&self.calibration)?;
        let mapping = self.mapping.mapping_for(&file);
        let calibration = file.calibration;
        let mut noises = Vec::new();
        for path in &self.logs {
            let log = Log::open(path, &mapping)?;
            tell_remembered(printer, &self.calibration, &mapping, std::slice::from_ref(&log));
            let options = NoiseOptions { rows: self.frames.rows(&log), window: self.window };
            let summary = printer.scan(&log, self.mapping.read_options(), |read| {
                noise(&log, &calibration, &options, &read)
            })?;
            let counts = [summary.rows, summary.repeated_rows, summary.skipped_rows];
            printer.remarks([used_rows(path, summary.rows_used, counts)]);
            printer.remarks(summary.zero.as_ref().and_then(|zero| moved_zero(path, zero)));
            noises.push((path, summary));
        }
        let documents = noises.iter().map(|(log, of)| document! { log: log, ..summary: of });
        printer.finish(&documents.collect::<Vec<_>>(), |printer| {
            noises.iter().try_for_each(|(log, summary)| print(printer, log, summary))
        })
    }
}

fn print(printer: &Printer, log: &Path, summary: &NoiseSummary) -> anyhow::Result<()> {
    printer.line(format!("{}: noise of {} frames", log.display(), summary.frames))?;
    let axes = summary.axes.iter().map(|(axis, scatter)| {
        let decimals = if axis.is_moment() { 6 } else { 4 };
        row(format!("{} ({})", axis.name(), axis.unit()), scatter, decimals)
    });
    let channels = summary.channels.iter().enumerate();
    let channels = channels.map(|(i, scatter)| row(format!("s{} (counts)", i + 1), scatter, 2));
    printer.table(&["quantity", "RMS", "peak to peak", "mean"], axes.chain(channels))
}

fn row(name: String, scatter: &Scatter, decimals: usize) -> Vec<String> {
    let figures = [scatter.rms, scatter.peak_to_peak, scatter.mean];
    [name].into_iter().chain(figures.map(|value| format!("{value:.decimals$}"))).collect()
}
