//! `shellcal report`: a batch of trials as one HTML file.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::Context;
use log_file::checksum;
use shellcal::output::AtomicFile;
use shellcal::report::{Input, Report};
use shellcal::trial::{LowPass, Profile, Rule, TareRule, TraceExtent, TrialOptions, TrialResult};

use super::evaluation::EvaluationArgs;
use super::manifest;
use crate::cmd::origin;
use crate::outcome::Outcome;
use crate::printer::Printer;

const EXAMPLES: &str = "\
Examples:
  shellcal report manifest.csv --calibration calibration.json
  shellcal report manifest.csv --calibration calibration.json --reference free --output beams.html";

#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct ReportArgs {
    /// Which trials there are: CSV, or TOML if it is called so
    #[arg(value_name = "MANIFEST")]
    manifest: PathBuf,

    /// File to write
    #[arg(long, short, value_name = "FILE", default_value = "report.html")]
    output: PathBuf,

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
    evaluation: EvaluationArgs,
}

impl ReportArgs {
    pub(crate) fn run(&self, printer: &mut Printer) -> anyhow::Result<Outcome> {
        let mut out = AtomicFile::create(&self.output)?;
        let equipment = self.evaluation.equipment()?;
        let path = &self.manifest;
        let manifest = manifest::read(path)?;
        manifest::check_reference(&manifest, self.reference.as_deref())?;
        let keep = |_, result: &mut _| {
            manifest::reduce(result, &equipment.profile, true);
            Ok(())
        };
        let evaluation = &self.evaluation;
        let mut batch = manifest::evaluate(printer, path, &manifest, evaluation, &equipment, keep);
        let failed = manifest::tell_failures(printer, path, &batch);
        anyhow::ensure!(!batch.trials.is_empty(), "no trial could be evaluated");

        let conditions = batch.statistics(self.reference.as_deref(), self.seed);
        let phases = batch.phases();
        let mut inputs = vec![input("manifest", path)?];
        for (role, file) in evaluation.files_by_role() {
            inputs.push(input(role, file)?);
        }
        for trial in &batch.trials {
            let log = trial.path.display().to_string();
            // Several trials can be of one log.
            if !inputs.iter().any(|input| input.path == log) {
                let bytes = std::fs::metadata(&trial.path).map_or(0, |metadata| metadata.len());
                let checksum = trial.evaluated.checksum.clone().unwrap_or_default();
                inputs.push(Input { role: "log".to_owned(), path: log, bytes, checksum });
            }
        }
        let shown = path.display();
        let options = evaluation.options(&equipment, TraceExtent::Log);
        let mut warnings: Vec<String> =
            manifest.remarkable().iter().map(|problem| format!("{shown}:{problem}")).collect();
        warnings.extend(manifest::slow_filter(&batch, &options));
        let of_failure = |failure: &shellcal::workflow::batch::Failure| {
            let place = format!("{shown}:{}", failure.place);
            (failure.file.clone(), format!("{place}: {}", failure.message))
        };
        let failures: Vec<_> = batch.failures.iter().map(of_failure).collect();
        let trials: Vec<TrialResult> =
            batch.trials.drain(..).map(|trial| trial.evaluated.result).collect();
        let calibration = evaluation.calibration().map(|path| path.display().to_string());
        let title = self.title.clone().unwrap_or_else(|| format!("Trials of {shown}"));
        let report = Report {
            title: &title,
            made_by: &origin::program(),
            date: &origin::date()?,
            command: &command_line(),
            trials: &trials,
            failed: &failures,
            conditions: &conditions,
            phases: &phases,
            settings: &settings(&options, &equipment.profile, self.seed),
            calibration: calibration.as_deref().zip(equipment.calibration.as_ref()),
            robot_length_m: equipment.profile.robot.length_m,
            channel_length_m: equipment.profile.channel.length_m,
            inputs: &inputs,
            warnings: &warnings,
        };
        let html = report.html();
        out.write_all(html.as_bytes())
            .with_context(|| format!("cannot write `{}`", self.output.display()))?;
        out.commit()?;
        if printer.json() {
            printer.document(&serde_json::json!({
                "file": self.output,
                "bytes": html.len(),
                "trials": trials.len(),
                "failures": failures.len(),
            }))?;
        } else {
            let count = trials.len();
            printer.line(format!("report on {count} trials in `{}`", self.output.display()))?;
        }
        Ok(if failed { Outcome::CheckFailed } else { Outcome::Done })
    }
}

/// A file with its checksum.
fn input(role: &str, path: &Path) -> anyhow::Result<Input> {
    let bytes = std::fs::read(path).with_context(|| format!("cannot read `{}`", path.display()))?;
    Ok(Input {
        role: role.to_owned(),
        path: path.display().to_string(),
        bytes: bytes.len() as u64,
        checksum: checksum::of(&bytes),
    })
}

/// What the command was called with, so that a shell takes it again.
fn command_line() -> String {
    let quoted = |word: String| {
        let is_plain = |c: char| c.is_alphanumeric() || "_-./:=,+@%".contains(c);
        match !word.is_empty() && word.chars().all(is_plain) {
            true => word,
            false => format!("'{}'", word.replace('\'', r"'\''")),
        }
    };
    let words = std::env::args_os().skip(1).map(|word| quoted(word.to_string_lossy().into_owned()));
    ["shellcal".to_owned()].into_iter().chain(words).collect::<Vec<_>>().join(" ")
}

/// How trials were evaluated, as people read it.
fn settings(options: &TrialOptions, profile: &Profile, seed: u64) -> Vec<(String, String)> {
    let tare = match options.tare {
        TareRule::Untared => "none".to_owned(),
        TareRule::First(frames) => format!("mean of the first {frames} frames"),
        TareRule::Between(from_s, to_s) => format!("mean from {from_s} s to {to_s} s"),
    };
    let low_pass = options.low_pass.map_or("none".to_owned(), |low_pass| {
        let LowPass { cutoff_hz, order, zero_phase } = low_pass;
        let phase = if zero_phase { "forth and back, without delay" } else { "causal" };
        format!("Butterworth, order {order}, {cutoff_hz} Hz, {phase}")
    });
    let rule = match options.rule {
        Rule::Time => "by time",
        Rule::Rows => "by row",
    };
    let mut settings: Vec<(String, String)> = [
        ("tare", tare),
        ("low-pass", low_pass),
        ("means and integrals", rule.to_owned()),
        ("bootstrap seed", seed.to_string()),
    ]
    .map(|(name, value)| (name.to_owned(), value))
    .into();
    if let Ok(serde_json::Value::Object(tables)) = serde_json::to_value(profile) {
        for (table, value) in tables {
            match value {
                serde_json::Value::Object(keys) => settings.extend(
                    keys.into_iter()
                        .map(|(key, value)| (format!("{table}.{key}"), value.to_string())),
                ),
                serde_json::Value::String(text) => {
                    settings.push((format!("profile {table}"), text))
                }
                value => settings.push((table, value.to_string())),
            }
        }
    }
    settings
}
