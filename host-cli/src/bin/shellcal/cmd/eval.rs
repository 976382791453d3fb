//! `shellcal eval`: the errors of a calibration against a measured wrench.

use std::cmp::Ordering;
use std::io::Write;

use calibration::Calibration;
use calibration::fit::{Evaluation, Workers, evaluate};
use calibration::quality::{AxisQuality, significant};
use calibration_file::CalibrationFile;
use calibration_file::stored::{OfAxes, Stored, StoredQuality};
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

    /// Fail when the RMS error of Fx, Fy or Fz is above this many N
    #[arg(long, value_name = "N", value_parser = limit)]
    max_rms: Option<f64>,

    /// Fail when the RMS error of Mx, My or Mz is above this many N·m
    #[arg(long, value_name = "N·m", value_parser = limit)]
    max_rms_moment: Option<f64>,

    /// Leave out rows that repeat the readings of the row before
    #[arg(long)]
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
        let mapping = self.mapping.mapping_for(&file)?;
        let mut calibration = file.calibration;
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
            let read = ReadOptions { progress: Some(&progress), ..self.mapping.read_options() };
            check_channels(log, calibration.channels())?;
            let rows = self.rows(log, &calibration, &read)?;
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
        let above_limit = self.above_limit(&all.quality, axes);
        let failed = !above_limit.is_empty();
        if printer.json() {
            let names = above_limit.iter().map(|(axis, ..)| axis.column()).collect();
            let axes = axes.columns();
            printer.document(&Document { axes, logs: reports, all, above_limit: names })?;
        } else {
            for report in &reports {
                print(printer, report, axes)?;
            }
            if reports.len() > 1 {
                print(printer, &all, axes)?;
            }
            for (axis, rms, limit) in above_limit {
                let (name, unit) = (axis.name(), axis.unit());
                let (rms, limit) = (significant(rms, 4), significant(limit, 4));
                printer.warning(format!(
                    "the RMS error of `{name}` is {rms} {unit}, above the limit of {limit} {unit}"
                ));
            }
        }
        Ok(if failed { Outcome::CheckFailed } else { Outcome::Done })
    }

    /// The rows of a log that are used.
    fn rows(
        &self,
        log: &Log,
        calibration: &Calibration,
        read: &ReadOptions<'_>,
    ) -> anyhow::Result<Dataset> {
        let time = calibration.needs_time() || log.has_time() && calibration.lag.is_some();
        let wanted = Wanted { readings: true, wrench: true, time, ..Wanted::default() };
        let rows = calibration.prepared(&read_dataset(&[(log, wanted)], read)?)?;
        Ok(rows.select(self.fresh, &RowSet::default()))
    }

    /// The axes whose RMS error is above its limit, with both.
    fn above_limit(&self, errors: &PerAxis<AxisQuality>, axes: Axes) -> Vec<(Axis, f64, f64)> {
        let limit = |axis: Axis| if axis.is_moment() { self.max_rms_moment } else { self.max_rms };
        axes.iter()
            .filter_map(|axis| Some((axis, errors[axis.index()].rms, limit(axis)?)))
            // What cannot be compared, such as NaN, is not below the limit.
            .filter(|(_, rms, limit)| rms.partial_cmp(limit).is_none_or(Ordering::is_gt))
            .collect()
    }
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

fn limit(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(limit) if limit >= 0.0 => Ok(limit),
        _ => Err("expected a number that is not negative".to_owned()),
    }
}
