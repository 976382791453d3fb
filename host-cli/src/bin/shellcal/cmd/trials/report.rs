//! `shellcal report`: a batch of trials as one HTML file, or a certificate of a calibration on one page to print.

use std::path::Path;

use ::report::{Certificate, Heading, Input, Report};
use anyhow::Context;
use log_file::Log;
use shellcal::workflow::batch::BatchOptions;
use shellcal::workflow::certificate::{budget, intervals};
use shellcal::workflow::check::{CheckedWeights, check_weights};
use shellcal::workflow::figures::reduce_trace;
use shellcal::workflow::gates::{Gate, GateFailure};
use shellcal::workflow::report;
use trial::{TraceExtent, TrialResult};

use super::evaluation::{self, BOOTSTRAP_SEED, EvaluationArgs, ReferenceArg, TitleArg};
use crate::cmd::choices::numbers;
use crate::cmd::mapping::open_logs;
use crate::cmd::outputs;
use crate::cmd::plan::read_table;
use crate::files::{InputPath, OutputPath};
use crate::printer::{Outcome, Printer};

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal report manifest.csv --calibration calibration.json
  shellcal report manifest.csv --calibration calibration.json --reference free --output beams.html
  shellcal report calibration.json --certificate --unloaded rest.csv --output certificate.html")]
pub(crate) struct ReportArgs {
    /// Table of trials: CSV or `.toml`; with `--certificate`: a calibration
    #[arg(value_name = "MANIFEST")]
    manifest: InputPath,

    /// File to write
    #[arg(long, short, value_name = "FILE", default_value = "report.html")]
    output: OutputPath,

    #[command(flatten)]
    titled: TitleArg,

    #[command(flatten)]
    compared: ReferenceArg,

    /// Certify a calibration instead, on one page: loads, uncertainty budget, check weights, checksums
    #[arg(long, conflicts_with_all = ["reference", "calibration", "profile", "by_row"], help_heading = "Certificate")]
    certificate: bool,

    /// Log of the unloaded sensor, for repeatability and drift of the zero
    #[arg(long, value_name = "LOG", requires = "certificate", help_heading = "Certificate")]
    unloaded: Option<InputPath>,

    /// Standard uncertainty of the reference sensor or the weights, in N and N·m
    #[arg(long, value_name = "N,N·m", num_args = 1, value_parser = parse_errors, requires = "certificate", help_heading = "Certificate")]
    reference_error: Option<[f64; 2]>,

    /// Table of known weights that were hung on the calibrated sensor, as for `check`
    #[arg(long, value_name = "LOADS.csv", requires_all = ["certificate", "weights_log"], help_heading = "Certificate")]
    weights: Option<InputPath>,

    /// Logs of these weights
    #[arg(long, value_name = "LOG", num_args = 1.., requires = "weights", help_heading = "Certificate")]
    weights_log: Vec<InputPath>,

    #[command(flatten)]
    evaluation: EvaluationArgs,
}

impl ReportArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<Outcome> {
        if self.certificate {
            return self.certify(printer);
        }
        let out = printer.files.create(&self.output)?;
        let equipment = self.evaluation.equipment(TraceExtent::Log, printer)?;
        let path = &self.manifest;
        let manifest = evaluation::read(path, printer)?;
        evaluation::check_reference(&manifest, self.compared.reference.as_deref())?;
        let keep = |_, result: &mut _| {
            reduce_trace(result, &equipment.profile, true);
            Ok(())
        };
        let options = equipment.batch_options();
        let mut batch = equipment.evaluate(printer, (path, &manifest), options, keep);
        let failures = evaluation::tell_failures(printer, path, &batch);
        anyhow::ensure!(!batch.trials.is_empty(), "no trial could be evaluated");

        let conditions = batch.statistics(self.compared.reference.as_deref(), BOOTSTRAP_SEED);
        let phases = batch.phases();
        let files =
            [("manifest", path.as_path())].into_iter().chain(self.evaluation.files_by_role());
        let mut inputs =
            files.map(|(role, path)| input(role, path)).collect::<anyhow::Result<Vec<_>>>()?;
        inputs.extend(report::logs(&batch));
        let shown = path.display();
        let mut warnings: Vec<String> =
            manifest.suspicious().iter().map(|problem| format!("{shown}:{problem}")).collect();
        warnings.extend(equipment.slow_filter(&batch));
        let BatchOptions { trial, mapping, read, .. } = options;
        let doubtful = report::doubtful(&batch, mapping, equipment.instrument(), trial, read)?;
        let trials: Vec<TrialResult> =
            batch.trials.drain(..).map(|trial| trial.evaluated.result).collect();
        let name = self.evaluation.calibration.as_ref().map(|path| path.display().to_string());
        let title = self.titled.title.clone().unwrap_or_else(|| format!("Trials of {shown}"));
        let outcome = printer.decide(failures.is_empty());
        let document = Report {
            heading: Heading {
                title: &title,
                made_by: shellcal::PROGRAM,
                date: &outputs::date()?,
                command: &outputs::command_line(),
            },
            trials: &trials,
            failed: &failures,
            conditions: &conditions,
            phases: &phases,
            settings: &report::settings(&trial, &equipment.profile, BOOTSTRAP_SEED),
            calibration: name.as_deref().zip(equipment.calibration.as_ref()),
            robot_length_m: equipment.profile.robot.length_m,
            channel_length_m: equipment.profile.channel.length_m,
            inputs: &inputs,
            doubtful,
            warnings: &warnings,
        };
        let html = document.html();
        out.commit_with(html.as_bytes())?;
        let (trials, path) = (trials.len(), self.output.display());
        let summary = serde_json::json!({
            "file": self.output, "bytes": html.len(), "trials": trials, "failures": failures.len(),
        });
        printer.finish(&summary, |printer| {
            printer.line(format!("report on {trials} trials in `{path}`"))
        })?;
        Ok(outcome)
    }

    fn certify(&self, printer: &Printer) -> anyhow::Result<Outcome> {
        let (path, args, output) = (&self.manifest, &self.evaluation, &self.output);
        let out = printer.files.create(output)?;
        let file = args.edited.read(path)?;
        let mapping = args.mapping.mapping_for(Some(&file));
        let read = args.mapping.read_options();
        let unloaded = self.unloaded.as_ref();
        let unloaded = unloaded.map(|path| Log::open(path, &mapping)).transpose()?;
        let budget = budget(&file, unloaded.as_ref(), self.reference_error, &read)?;
        let CheckedWeights { loads: weights, gate } = match &self.weights {
            None => CheckedWeights { loads: Vec::new(), gate: Gate::default() },
            Some(table) => {
                let logs = open_logs(&self.weights_log, ("--wrench-from", &[]), &mapping)?;
                check_weights(&file, &logs, &read_table(table)?, None, &read)?
            }
        };
        let outcome = printer.judge(&gate);
        let shown = path.display().to_string();
        let serial = file.origin.sensor_serial.as_deref().unwrap_or(&shown);
        let usual_title = format!("Certificate of calibration: {serial}");
        let own = input("calibration", path)?;
        let is_missing = |failure: &GateFailure| matches!(failure, GateFailure::NotCompared { .. });
        let failures = gate.failures().into_iter().filter(is_missing);
        let not_compared: Vec<_> = failures.map(|failure| failure.to_string()).collect();
        let certificate = Certificate {
            heading: Heading {
                title: self.titled.title.as_deref().unwrap_or(&usual_title),
                made_by: shellcal::PROGRAM,
                date: &outputs::date()?,
                command: &outputs::command_line(),
            },
            file: &file,
            name: &shown,
            checksum: &own.checksum,
            budget: &budget,
            intervals: &intervals(&file),
            weights: &weights,
            not_compared: &not_compared,
        };
        out.commit_with(certificate.html().as_bytes())?;
        let off = weights.iter().map(|of| of.off.count()).sum::<usize>();
        let axes = file.calibration.axes;
        let summary = serde_json::json!({
            "file": output,
            "axes": axes.columns(),
            "combined_standard_uncertainty": axes.of(&certificate.combined()),
            "expanded_uncertainty": axes.of(&certificate.expanded()),
            "coverage_factor": axes.of(&certificate.coverage()),
            "effective_degrees_of_freedom": axes.of(&certificate.degrees_of_freedom()),
            "weights_off": off,
        });
        printer.finish(&summary, |printer| {
            printer.line(format!("certificate of `{shown}` in `{}`", output.display()))
        })?;
        Ok(outcome)
    }
}

/// A file that results depend on, with its checksum.
fn input(role: &'static str, path: &Path) -> anyhow::Result<Input> {
    report::input(role, path).with_context(|| format!("cannot read `{}`", path.display()))
}

fn parse_errors(text: &str) -> Result<[f64; 2], String> {
    let pair = numbers(text).filter(|pair| pair.iter().all(|x| *x >= 0.0));
    pair.ok_or_else(|| "expected two numbers of 0 or more, such as `0.05,0.001`".to_owned())
}
