//! `shellcal report CAL.json --certificate`: a calibration on one page to print.

use ::report::{Certificate, CheckedLoad, Heading};
use anyhow::Context;
use calibration_file::CalibrationFile;
use log_file::{Log, Mapping, ReadOptions};
use shellcal::workflow::certificate::{budget, intervals};
use shellcal::workflow::check::check_weights;

use super::evaluation::EvaluationArgs;
use crate::cmd::choices::numbers;
use crate::cmd::mapping::open_logs;
use crate::cmd::origin;
use crate::cmd::plan::read_table;
use crate::files::{InputPath, OutputPath};
use crate::printer::{Outcome, Printer};

/// What a certificate is made from beside the calibration.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Certificate")]
pub(super) struct CertificateArgs {
    /// Certify a calibration instead, on one page: loads, uncertainty budget, check weights, checksums
    #[arg(long, conflicts_with_all = ["reference", "calibration", "profile", "by_row"])]
    pub(super) certificate: bool,

    /// A log of the unloaded sensor: repeatability, and drift of the zero
    #[arg(long, value_name = "LOG", requires = "certificate")]
    unloaded: Option<InputPath>,

    /// The standard uncertainty of the reference sensor or the weights, in N and N·m
    #[arg(long, value_name = "N,N·m", num_args = 1, value_parser = parse_errors, requires = "certificate")]
    reference_error: Option<[f64; 2]>,

    /// Known weights that were hung on the calibrated sensor, as `check` takes them
    #[arg(long, value_name = "LOADS.csv", requires_all = ["certificate", "weights_log"])]
    weights: Option<InputPath>,

    /// The logs of these weights
    #[arg(long, value_name = "LOG", num_args = 1.., requires = "weights")]
    weights_log: Vec<InputPath>,
}

fn parse_errors(text: &str) -> Result<[f64; 2], String> {
    let pair = numbers(text).filter(|pair| pair.iter().all(|x| *x >= 0.0));
    pair.ok_or_else(|| "expected two numbers of 0 or more, such as `0.05,0.001`".to_owned())
}

impl CertificateArgs {
    /// Certifies the calibration at `path`.
    pub(super) fn run(
        &self,
        (path, title): (&InputPath, Option<&str>),
        evaluation: &EvaluationArgs,
        output: &OutputPath,
        printer: &Printer,
    ) -> anyhow::Result<Outcome> {
        let out = printer.files.create(output)?;
        let file = evaluation.edited.read(path)?;
        let mapping = evaluation.mapping.mapping_for(&file);
        let read = ReadOptions { checksum: false, ..evaluation.read_options() };
        let unloaded = self.unloaded.as_ref();
        let unloaded = unloaded.map(|path| Log::open(path, &mapping)).transpose()?;
        let budget = budget(&file, unloaded.as_ref(), self.reference_error, &read)?;
        let weights = self.weights(&file, &mapping, &read)?;
        let shown = path.display().to_string();
        let serial = file.origin.sensor_serial.as_deref().unwrap_or(&shown);
        let usual_title = format!("Certificate of calibration: {serial}");
        let own = shellcal::workflow::report::input("calibration", path)
            .with_context(|| format!("cannot read `{shown}`"))?;
        let certificate = Certificate {
            heading: Heading {
                title: title.unwrap_or(&usual_title),
                made_by: shellcal::PROGRAM,
                date: &origin::date()?,
                command: &origin::command_line(),
            },
            file: &file,
            name: &shown,
            checksum: &own.checksum,
            budget: &budget,
            intervals: &intervals(&file),
            weights: &weights,
        };
        out.commit_with(certificate.html().as_bytes())?;
        let off = weights.iter().map(|of| of.off.count()).sum::<usize>();
        let axes = file.calibration.axes;
        let summary = serde_json::json!({
            "file": output,
            "axes": axes.columns(),
            "combined_standard_uncertainty": axes.of(&certificate.combined()),
            "expanded_uncertainty": axes.of(&certificate.expanded()),
            "weights_off": off,
        });
        printer.finish(&summary, |printer| {
            printer.line(format!("certificate of `{shown}` in `{}`", output.display()))
        })?;
        if off > 0 {
            printer.warning(format!("{off} check weights differ by more than is to be expected"));
            return Ok(Outcome::CheckFailed);
        }
        Ok(Outcome::Done)
    }

    /// The check weights, and what the calibration says of them.
    fn weights(
        &self,
        file: &CalibrationFile,
        mapping: &Mapping,
        read: &ReadOptions<'_>,
    ) -> anyhow::Result<Vec<CheckedLoad>> {
        let Some(table) = &self.weights else { return Ok(Vec::new()) };
        let logs = open_logs(&self.weights_log, ("--wrench-from", &[]), mapping)?;
        Ok(check_weights(file, &logs, &read_table(table)?, read)?)
    }
}
