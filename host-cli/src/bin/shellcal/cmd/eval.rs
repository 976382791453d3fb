//! `shellcal eval`: the errors of a calibration against a measured wrench.

use anyhow::Context;
use calibration::Calibration;
use calibration::fit::{
    Evaluation, Examination, Fault, Promise, TestedCalibration, Workers, evaluate, frame_interval,
};
use calibration::physics::COVERAGE_LEVEL;
use calibration::quality::{AxisQuality, significant};
use calibration_file::{CalibrationFile, Diagnostics};
use clap::builder::TypedValueParser;
use figures::{FitPlot, fit_figure};
use log_file::{Log, ReadOptions, Wanted, read_dataset, sample_logs};
use report::add_to_plot;
use serde::Serialize;
use shell_data::dataset::{Dataset, LabelledBlock, RowSet};
use shell_data::wrench::{Axes, Axis, PerAxis};
use shellcal::workflow::check_channels;
use shellcal::workflow::convert::interval_factors;
use shellcal::workflow::gates::{ErrorLimits, Gate, GateFailure};

use super::choices::{number_in, one_of};
use super::compare::ComparedCalibrations;
use super::mapping::{CompanionArgs, EditedArg, MappingArgs};
use super::outputs::FigureArgs;
use super::quality::{print_screen, table_row, test_ratio};
use crate::files::InputPath;
use crate::printer::{Outcome, Printer};

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal eval calibration.json test.csv
  shellcal eval calibration.json test-*.csv --max-rms 0.15 || echo too far off
  shellcal eval monday.json poses.csv --against tuesday.json")]
pub(crate) struct EvalArgs {
    /// Calibration file
    #[arg(value_name = "CAL.json")]
    calibration: InputPath,

    #[command(flatten)]
    edited: EditedArg,

    /// Logs with readings and a measured wrench
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<InputPath>,

    /// Compare with another calibration on the same logs, which neither was fitted to: the errors of both,
    /// their paired difference with a 95 % interval over groups of rows, and which errs less on each axis
    #[arg(long, value_name = "CAL.json", conflicts_with_all = ["plot", "fresh", "max_rms", "max_rms_moment"])]
    against: Option<InputPath>,

    #[command(flatten)]
    companions: CompanionArgs,

    #[command(flatten)]
    limits: RmsLimits,

    #[command(flatten)]
    axes: AxesArg,

    /// Leave out duplicates: rows whose readings equal the previous row's
    #[arg(long = "skip-repeats", alias = "fresh")]
    fresh: bool,

    #[command(flatten)]
    figure: FigureArgs,

    #[command(flatten)]
    mapping: MappingArgs,
}

/// The axes of a gate.
#[derive(Debug, clap::Args)]
pub(super) struct AxesArg {
    /// Compare only these axes, such as `fx,fz`; fail if one of them cannot be compared
    #[arg(long, value_name = "AXES", value_delimiter = ',', value_parser = axis())]
    axes: Vec<Axis>,
}

impl AxesArg {
    pub(super) fn named(&self) -> Option<Axes> {
        (!self.axes.is_empty()).then(|| self.axes.iter().copied().collect())
    }
}

fn axis() -> impl TypedValueParser<Value = Axis> {
    let names = ["fx", "fy", "fz", "mx", "my", "mz"];
    one_of(&Axis::ALL.map(|axis| (names[axis.index()], "", axis)))
}

struct LogEvaluation {
    log: Option<String>,
    evaluation: Evaluation,
    quality: PerAxis<AxisQuality>,
}

impl EvalArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<Outcome> {
        let file = self.edited.usable(&self.calibration, printer)?;
        self.check_logs()?;
        let from = Some((&self.calibration, &file));
        let mut logs =
            self.mapping.open(&self.logs, &self.companions.wrench_from, from, printer)?;
        if let Some(path) = &self.against {
            let other = self.edited.usable(path, printer)?;
            let (first, second) = ((&self.calibration, &file), (path, &other));
            let named = self.axes.named();
            let compared = ComparedCalibrations { first, second, named };
            return compared.run(logs, &self.mapping, printer);
        }
        let (mut calibration, sources) = (file.calibration, file.origin.sources);
        let diagnostics = file.origin.diagnostics;
        let limits = self.limits.of(self.axes.named());
        let measured: Vec<Axes> = logs.iter().map(Log::axes).collect();
        let axes = limits.compared(calibration.axes, &mut logs)?;
        note_axes(printer, (&logs, &measured), calibration.axes, &limits);
        calibration.axes = axes;
        let figure = self.figure.create(printer)?;
        let mut plot = figure.is_some().then(FitPlot::default);

        let workers = Workers::new(self.mapping.threads.map_or(0, usize::from));
        let (mut all, mut gate) = (Evaluation::default(), Gate::default());
        let (mut reports, mut tested, mut fitted_to) = (Vec::new(), Dataset::default(), None);
        for (log, measured) in logs.iter().zip(measured) {
            check_channels(log, calibration.channels())?;
            let time = calibration.needs_time() || log.has_time() && calibration.lag.is_some();
            let groups = log.has_groups();
            let wanted = Wanted { readings: true, wrench: true, groups, time, ..Wanted::default() };
            let read = ReadOptions { checksum: true, ..self.mapping.read_options() };
            let asked = [(log, wanted.clone())];
            let mut rows = printer.scan(log, read, |read| read_dataset(&asked, &read))?;
            sample_logs(&mut rows, [log], &wanted)?;
            let rows = calibration.prepared(&rows)?;
            let rows = rows.select(self.fresh, &RowSet::default());
            if rows.logs.iter().any(|log| {
                sources.iter().any(|of| of.is_training_log(log.summary.checksum.as_deref()))
            }) {
                let name = log.path().display().to_string();
                printer.warning(format!(
                    "`{name}` was used for the fit: its errors are those of training, not of new loads"
                ));
                fitted_to.get_or_insert(name);
            }
            let evaluation = Evaluation::total(&evaluate(&calibration, &rows, workers)?);
            all.merge(&evaluation);
            let counts = [evaluation.rows, evaluation.rows + evaluation.skipped_rows];
            limits.ask_log(&mut gate, log.path(), measured, counts);
            if let Some(plot) = &mut plot {
                add_to_plot(plot, &calibration, &rows);
            }
            let name = Some(log.path().display().to_string());
            reports.push(LogEvaluation::new(name, evaluation, axes)?);
            tested.logs.extend(rows.logs);
        }
        let all = LogEvaluation::new(None, all, axes)?;
        let names = logs[0].value_names().into_iter().take(calibration.channels());
        let names: Vec<String> = names.map(str::to_owned).collect();
        let promise = diagnostics.as_ref().map(Diagnostics::promise);
        let verdict = TestedCalibration {
            examination: examine(&calibration, promise.as_ref(), (&tested, &names), workers)?,
            interval: interval_factors(&calibration, COVERAGE_LEVEL)
                .ok()
                .and_then(|factors| frame_interval(&calibration, &factors, &tested)),
            calibration: &calibration,
            promise,
            excitation: diagnostics.as_ref().and_then(|of| of.excitation.as_ref()),
            evaluation: &all.evaluation,
            quality: &all.quality,
            fitted_to,
        };
        limits.ask_errors(&mut gate, axes, "", &all.quality.map(|axis| axis.rms));
        let outcome = printer.judge(&gate);
        if let (Some(figure), Some(plot)) = (figure, &plot) {
            let title = format!("Evaluation of {}", self.calibration.display());
            figure.draw(|size| fit_figure(size, &title, axes, plot, None))?;
        }
        let above_limit = gate.failures().into_iter().filter_map(|failure| match failure {
            GateFailure::Above { axis, .. } => Some(axis.column()),
            _ => None,
        });
        let document = document! {
            axes: axes.columns(),
            verdict: verdict_document(&verdict),
            logs: reports.iter().map(|of| of.document(axes)).collect::<Vec<_>>(),
            all: all.document(axes),
            above_limit: above_limit.collect::<Vec<_>>(),
            // Axes that were requested, but are missing in some log or have too few rows.
            not_compared: gate.not_compared().columns(),
        };
        printer.finish(&document, |printer| {
            print_screen(printer, &verdict.screen(), &gate);
            if reports.len() > 1 {
                print_logs(printer, &reports, axes);
            }
            if printer.is_verbose() {
                reports.iter().for_each(|of| of.print(printer, axes));
            }
        })?;
        Ok(outcome)
    }

    /// Refuses a log that is another calibration, as given by a user who wants to compare two.
    fn check_logs(&self) -> anyhow::Result<()> {
        let is_calibration = |path: &&InputPath| {
            path.extension().is_some_and(|extension| extension == "json")
                && CalibrationFile::read_edited(path).is_ok()
        };
        if let Some(path) = self.logs.iter().find(is_calibration) {
            let (first, second) = (self.calibration.display(), path.display());
            anyhow::bail!(
                "`{second}` is a calibration, not a log: `shellcal eval {first} LOG --against {second}` compares two"
            );
        }
        Ok(())
    }
}

/// Notes the axes that are not compared. Requested axes among them fail later.
fn note_axes(
    printer: &Printer,
    (logs, measured): (&[Log], &[Axes]),
    calibrated: Axes,
    limits: &ErrorLimits,
) {
    let wanted = limits.axes.unwrap_or(calibrated).without(limits.asked());
    for (log, measured) in logs.iter().zip(measured) {
        let (path, absent) = (log.path().display(), wanted.without(*measured));
        if !absent.is_empty() {
            printer.note(format!("not compared: {absent}, which `{path}` does not have"));
        }
    }
    let others = measured.iter().fold(Axes::ALL, |all, axes| all.and(*axes)).without(calibrated);
    if !others.is_empty() {
        printer.note(format!("not compared: {others}, which the calibration does not give"));
    }
}

/// Finds faults of test rows, and compares their errors with the promised ones. `names` are the names of the channels.
fn examine(
    calibration: &Calibration,
    promise: Option<&Promise>,
    (rows, names): (&Dataset, &[String]),
    workers: Workers<'_>,
) -> anyhow::Result<Examination> {
    let outside = |block: &LabelledBlock| calibration.rows_out_of_range(&block.rows.readings);
    let outside = rows.blocks().map(|(_, block)| outside(block)).sum();
    let outside = [outside, rows.rows()];
    let compare = |promise: &Promise| promise.examine(calibration, rows, outside, workers);
    let (test, fault) = promise.map(compare).transpose()?.unwrap_or_default();
    let found = doctor::check_rows(rows, names);
    let faults = found.into_iter().map(|finding| Fault::of_test(finding.seen)).chain(fault);
    Ok(Examination { test, faults: faults.collect() })
}

/// The output of `--json` for a verdict, with the words of `fit`.
fn verdict_document(verdict: &TestedCalibration<'_>) -> impl Serialize {
    let axes = verdict.calibration.axes;
    let interval = verdict.interval.as_ref();
    document! {
        text: verdict.screen().lines(),
        ok: verdict.is_ok(),
        reasons: verdict.reasons(),
        test_ratio?: verdict.examination.test.map(test_ratio),
        // Errors that the fit promised on new rows, N and N·m.
        promised_rms?: verdict.promise.as_ref().map(|of| axes.of(&of.rms)),
        // Mean half-width of the intervals that should contain 95 % of frames, N and N·m.
        interval_95?: interval.map(|of| axes.of(&of.half_width)),
        // Share of rows within their interval.
        interval_95_held?: interval.and_then(|of| of.held).map(|held| axes.of(&held)),
    }
}

fn print_logs(printer: &Printer, logs: &[LogEvaluation], axes: Axes) {
    let mut header = vec!["log".to_owned(), "rows".to_owned()];
    header.extend(axes.iter().map(|axis| format!("{} ({})", axis.name(), axis.unit())));
    let row = |of: &LogEvaluation| {
        let mut row = vec![of.log.clone().unwrap_or_default(), of.evaluation.rows.to_string()];
        row.extend(axes.iter().map(|axis| significant(of.quality[axis.index()].rms, 3)));
        row
    };
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    printer.line("");
    printer.table(&header, logs.iter().map(row));
}

impl LogEvaluation {
    fn new(log: Option<String>, evaluation: Evaluation, axes: Axes) -> anyhow::Result<Self> {
        let name = log.as_deref().unwrap_or_default();
        let quality = evaluation.quality();
        let quality = quality.with_context(|| format!("`{name}`: no rows are left to compare"))?;
        if let Some(axis) = axes.iter().find(|axis| !quality[axis.index()].rms.is_finite()) {
            anyhow::bail!("`{name}`: the error of {} is too large for a number", axis.name());
        }
        Ok(Self { log, evaluation, quality })
    }

    fn document(&self, axes: Axes) -> impl Serialize {
        let of = &self.evaluation;
        document! {
            log?: self.log.as_ref(),
            of.{rows, skipped_rows, repeated_rows, out_of_range_rows},
            errors: axes.of(&self.quality),
        }
    }

    fn print(&self, printer: &Printer, axes: Axes) {
        let (name, of) = (self.log.as_deref().unwrap_or_default(), &self.evaluation);
        printer.line("");
        printer.line(format!(
            "{name}: {} rows used, {} skipped, {} repeated, {} outside the calibrated range",
            of.rows, of.skipped_rows, of.repeated_rows, of.out_of_range_rows
        ));
        let row = |axis: Axis| {
            let mut row = table_row(axis, &[&self.quality]);
            row.insert(3, significant(self.quality[axis.index()].bias, 4));
            row
        };
        let rows = axes.iter().map(row);
        printer.table(&["axis", "RMS", "max", "bias", "R²", "unit"], rows)
    }
}

const LIMIT: &str = "expected a finite number that is not negative";

#[derive(Debug, clap::Args)]
pub(super) struct RmsLimits {
    /// Fail if the RMS error of Fx, Fy or Fz is above this many N, or one of them is not compared
    #[arg(long, value_name = "N", value_parser = number_in(0.0..=f64::MAX, LIMIT))]
    max_rms: Option<f64>,

    /// Fail if the RMS error of Mx, My or Mz is above this many N·m, or one of them is not compared
    #[arg(long, value_name = "N·m", value_parser = number_in(0.0..=f64::MAX, LIMIT))]
    max_rms_moment: Option<f64>,
}

impl RmsLimits {
    pub(super) fn of(&self, axes: Option<Axes>) -> ErrorLimits {
        ErrorLimits { force_n: self.max_rms, moment_nm: self.max_rms_moment, axes }
    }
}
