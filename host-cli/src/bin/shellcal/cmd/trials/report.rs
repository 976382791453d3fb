//! `shellcal report`: a batch of trials as one HTML file.

use std::path::Path;

use ::report::{Heading, Input, Report};
use anyhow::Context;
use shellcal::workflow::figures::reduce_trace;
use shellcal::workflow::report;
use trial::{TraceExtent, TrialResult};

use super::certificate::CertificateArgs;
use super::evaluation::EvaluationArgs;
use super::manifest;
use crate::cmd::origin;
use crate::files::{InputPath, OutputPath};
use crate::printer::{Outcome, Printer};

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal report manifest.csv --calibration calibration.json
  shellcal report manifest.csv --calibration calibration.json --reference free --output beams.html
  shellcal report calibration.json --certificate --unloaded rest.csv --output certificate.html")]
pub(crate) struct ReportArgs {
    /// Which trials there are: CSV or `.toml`; with `--certificate`: a calibration
    #[arg(value_name = "MANIFEST")]
    manifest: InputPath,

    /// File to write
    #[arg(long, short, value_name = "FILE", default_value = "report.html")]
    output: OutputPath,

    /// Title of the report [default: the manifest's name]
    #[arg(long, value_name = "TEXT")]
    title: Option<String>,

    /// The condition that the others are compared with
    #[arg(long, value_name = "NAME")]
    reference: Option<String>,

    /// What the bootstrap draws its samples from
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,

    #[command(flatten)]
    certificate: CertificateArgs,

    #[command(flatten)]
    evaluation: EvaluationArgs,
}

impl ReportArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<Outcome> {
        if self.certificate.certificate {
            let calibration = (&self.manifest, self.title.as_deref());
            let (certificate, evaluation) = (&self.certificate, &self.evaluation);
            return certificate.run(calibration, evaluation, &self.output, printer);
        }
        let out = printer.files.create(&self.output)?;
        let equipment = self.evaluation.equipment()?;
        let path = &self.manifest;
        let manifest = manifest::read(path, printer)?;
        manifest::check_reference(&manifest, self.reference.as_deref())?;
        let keep = |_, result: &mut _| {
            reduce_trace(result, &equipment.profile, true);
            Ok(())
        };
        let evaluation = &self.evaluation;
        let options = evaluation.batch_options(&equipment, TraceExtent::Log);
        let mut batch = manifest::evaluate(printer, path, &manifest, &equipment, options, keep);
        let failures = manifest::tell_failures(printer, path, &batch);
        anyhow::ensure!(!batch.trials.is_empty(), "no trial could be evaluated");

        let conditions = batch.statistics(self.reference.as_deref(), self.seed);
        let phases = batch.phases();
        let mut inputs = self.inputs()?;
        inputs.extend(report::logs(&batch));
        let shown = path.display();
        let options = evaluation.options(&equipment, TraceExtent::Log);
        let mut warnings: Vec<String> =
            manifest.suspicious().iter().map(|problem| format!("{shown}:{problem}")).collect();
        warnings.extend(manifest::slow_filter(&batch, &options));
        let (mapping, read) = (&equipment.mapping, evaluation.read_options());
        let doubtful = report::doubtful(&batch, mapping, equipment.instrument(), options, read)?;
        let trials: Vec<TrialResult> =
            batch.trials.drain(..).map(|trial| trial.evaluated.result).collect();
        let name = evaluation.calibration.as_ref().map(|path| path.display().to_string());
        let title = self.title.clone().unwrap_or_else(|| format!("Trials of {shown}"));
        let document = Report {
            heading: Heading {
                title: &title,
                made_by: shellcal::PROGRAM,
                date: &origin::date()?,
                command: &origin::command_line(),
            },
            trials: &trials,
            failed: &failures,
            conditions: &conditions,
            phases: &phases,
            settings: &report::settings(&options, &equipment.profile, self.seed),
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
        Ok(if failures.is_empty() { Outcome::Done } else { Outcome::CheckFailed })
    }

    /// The files but for the logs, with their checksums.
    fn inputs(&self) -> anyhow::Result<Vec<Input>> {
        let files = [("manifest", self.manifest.as_path())].into_iter();
        let files = files.chain(self.evaluation.files_by_role());
        let input = |(role, path): (&str, &Path)| {
            report::input(role, path).with_context(|| format!("cannot read `{}`", path.display()))
        };
        files.map(input).collect()
    }
}
