//! `shellcal eval`: the errors of a calibration against a measured wrench.

use std::io::Write;

use calibration::fit::{Evaluation, Workers, evaluate};
use calibration::quality::{AxisQuality, significant};
use calibration_file::stored::{OfAxes, Stored, StoredQuality};
use calibration_file::{CalibrationFile, Role, SourceFile};
use figures::{FitPlot, Format, fit_figure};
use log_file::{Log, ReadOptions, Wanted, read_dataset};
use output_file::Outputs;
use serde::Serialize;
use shell_data::dataset::{Dataset, RowSet};
use shell_data::wrench::{Axes, Axis, PerAxis};
use shellcal::workflow::check_channels;
use shellcal::workflow::fit::add_to_plot;

use super::figure_size::FigureSize;
use super::mapping::{MappingArgs, open_logs, tell_remembered};
use super::quality::table_row;
use super::rms_limits::RmsLimits;
use crate::files::{InputPath, OutputPath};
use crate::outcome::Outcome;
use crate::printer::Printer;

const EXAMPLES: &str = "\
Examples:
  shellcal eval calibration.json test.csv
  shellcal eval calibration.json test-*.csv --max-rms 0.15 || echo too far off";

#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct EvalArgs {
    /// The calibration
    #[arg(value_name = "CAL.json")]
    calibration: InputPath,

    /// Logs with readings and a measured wrench
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<InputPath>,

    /// Take the wrench from these files, one for each log, row by row
    #[arg(long, value_name = "FILE", num_args = 1.., help_heading = "Reading logs")]
    wrench_from: Vec<InputPath>,

    #[command(flatten)]
    limits: RmsLimits,

    /// Leave out rows that repeat the readings of the row before
    #[arg(long = "skip-repeats", alias = "fresh")]
    fresh: bool,

    /// Draw predicted against measured, and the residuals, over all logs
    #[arg(long, value_name = "FILE.svg|pdf|png")]
    plot: Option<OutputPath>,

    #[command(flatten)]
    figure_size: FigureSize,

    #[command(flatten)]
    mapping: MappingArgs,
}

/// What `--json` prints of one log, or of all.
#[derive(Serialize)]
struct Report {
    #[serde(skip_serializing_if = "Option::is_none")]
    log: Option<String>,
    rows: u64,
    skipped_rows: u64,
    repeated_rows: u64,
    out_of_range_rows: u64,
    errors: OfAxes<StoredQuality>,
    #[serde(skip)]
    quality: PerAxis<AxisQuality>,
}

#[derive(Serialize)]
struct Document {
    axes: Vec<&'static str>,
    logs: Vec<Report>,
    all: Report,
    above_limit: Vec<&'static str>,
}

impl EvalArgs {
    pub(crate) fn run(&self, printer: &mut Printer, outputs: &Outputs) -> anyhow::Result<Outcome> {
        let file = CalibrationFile::read(&self.calibration)?;
        self.check_logs()?;
        let mapping = self.mapping.mapping_for(&file)?;
        let (mut calibration, sources) = (file.calibration, file.origin.sources);
        let mut logs = open_logs(&self.logs, ("--wrench-from", &self.wrench_from), &mapping)?;
        tell_remembered(printer, &self.calibration, &mapping, &logs);
        let axes = compared_axes(calibration.axes, &mut logs, printer)?;
        calibration.axes = axes;
        let format = self.plot.as_ref().map(Format::from_path).transpose()?;
        let output = self.plot.as_ref().map(|path| outputs.create(path)).transpose()?.zip(format);
        let mut plot = output.is_some().then(FitPlot::new);

        let bar = printer.progress("eval", logs.iter().map(Log::bytes).sum());
        let workers = Workers { threads: self.mapping.threads.map_or(0, usize::from), watch: None };
        let mut all = Evaluation::default();
        let (mut reports, mut read_before) = (Vec::new(), 0);
        for log in &logs {
            let progress = |bytes| bar.set_position(read_before + bytes);
            let read = ReadOptions {
                progress: Some(&progress),
                checksum: true,
                ..self.mapping.read_options()
            };
            check_channels(log, calibration.channels())?;
            let rows = self.rows(log, &read)?;
            if is_trained_on(&rows, &sources) {
                printer.warning(format!(
                    "`{}` was used for the fit: its errors are those of training, not of new loads",
                    log.path().display()
                ));
            }
            let evaluation = Evaluation::total(&evaluate(&calibration, &rows, workers)?);
            if let Some(plot) = &mut plot {
                add_to_plot(plot, &calibration, &rows);
            }
            all.merge(&evaluation);
            reports.push(report(Some(log.path().display().to_string()), &evaluation, axes)?);
            read_before += log.bytes();
        }
        bar.finish_and_clear();
        if let (Some((mut output, format)), Some(plot)) = (output, &plot) {
            let title = format!("Evaluation of {}", self.calibration.display());
            output.write_all(
                &fit_figure(self.figure_size.size(), &title, axes, plot, None).render(format)?,
            )?;
            output.commit()?;
        }

        let all = report(None, &all, axes)?;
        let above_limit = self.limits.above(&all.quality.map(|axis| axis.rms), axes);
        let failed = !above_limit.is_empty();
        if printer.json() {
            let names = above_limit.iter().map(|of| of.axis.column()).collect();
            let axes = axes.columns();
            printer.document(&Document { axes, logs: reports, all, above_limit: names })?;
        } else {
            for report in &reports {
                print(printer, report, axes)?;
            }
            if reports.len() > 1 {
                print(printer, &all, axes)?;
            }
            above_limit.iter().for_each(|of| of.warn(printer));
        }
        Ok(if failed { Outcome::CheckFailed } else { Outcome::Done })
    }

    /// Whether a log is another calibration, as where two are to be compared.
    fn check_logs(&self) -> anyhow::Result<()> {
        let is_calibration = |path: &&InputPath| {
            path.extension().is_some_and(|extension| extension == "json")
                && CalibrationFile::read(path).is_ok()
        };
        if let Some(path) = self.logs.iter().find(is_calibration) {
            let (first, second) = (self.calibration.display(), path.display());
            anyhow::bail!(
                "`{second}` is a calibration, not a log: `shellcal compare {first} {second} --test LOG` compares two"
            );
        }
        Ok(())
    }

    /// The rows of a log that are used.
    fn rows(&self, log: &Log, read: &ReadOptions<'_>) -> anyhow::Result<Dataset> {
        let wanted = Wanted { readings: true, wrench: true, ..Wanted::default() };
        Ok(read_dataset(&[(log, wanted)], read)?.select(self.fresh, &RowSet::default()))
    }
}

/// Whether a log is one that the calibration was fitted to.
fn is_trained_on(rows: &Dataset, sources: &[SourceFile]) -> bool {
    let checksums = || rows.logs.iter().filter_map(|log| log.summary.checksum.as_ref());
    let is_of = |source: &SourceFile| {
        source.role == Role::Train
            && checksums().any(|found| source.checksum.as_ref() == Some(found))
    };
    sources.iter().any(is_of)
}

/// The axes that calibration and all logs have; the logs keep these alone. What is not compared is said.
fn compared_axes(
    calibrated: Axes,
    logs: &mut [Log],
    printer: &mut Printer,
) -> anyhow::Result<Axes> {
    let mut compared = calibrated;
    for log in &*logs {
        let absent = compared.without(log.axes());
        if absent == compared {
            // None is left: says all that are missing.
            log.require_axes(calibrated)?;
        }
        compared = compared.without(absent);
        if !absent.is_empty() {
            let path = log.path().display();
            printer.note(format!("not compared: {absent}, which `{path}` has not"));
        }
    }
    let others = logs.iter().fold(Axes::ALL, |all, log| all.and(log.axes())).without(calibrated);
    if !others.is_empty() {
        printer.note(format!("not compared: {others}, of which the calibration says nothing"));
    }
    logs.iter_mut().try_for_each(|log| log.keep_axes(compared))?;
    Ok(compared)
}

fn report(log: Option<String>, evaluation: &Evaluation, axes: Axes) -> anyhow::Result<Report> {
    let Some(quality) = evaluation.quality() else {
        let log = log.unwrap_or_default();
        anyhow::bail!("`{log}`: no rows are left to compare");
    };
    Ok(Report {
        log,
        rows: evaluation.rows,
        skipped_rows: evaluation.skipped_rows,
        repeated_rows: evaluation.repeated_rows,
        out_of_range_rows: evaluation.out_of_range_rows,
        errors: Stored::of(&quality, axes),
        quality,
    })
}

fn print(printer: &mut Printer, report: &Report, axes: Axes) -> anyhow::Result<()> {
    let name = report.log.as_deref().unwrap_or("all logs");
    printer.line(format!(
        "{name}: {} rows used, {} skipped, {} repeated, {} outside the calibrated range",
        report.rows, report.skipped_rows, report.repeated_rows, report.out_of_range_rows
    ))?;
    let row = |axis: Axis| {
        let mut row = table_row(axis, &[&report.quality]);
        row.insert(3, significant(report.quality[axis.index()].bias, 4));
        row
    };
    let rows: Vec<Vec<String>> = axes.iter().map(row).collect();
    printer.table(&["axis", "RMS", "max", "bias", "R²", "unit"], &rows)
}
