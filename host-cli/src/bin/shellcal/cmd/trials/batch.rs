//! `shellcal batch`: all trials of a manifest.

use std::path::PathBuf;
use std::time::Duration;

use anyhow::ensure;
use shellcal::workflow::batch::{Batch, BatchOptions, FileStamp, stamp};
use trial::manifest::Shard;
use trial::{ConditionRow, Profile, TrialOptions, TrialResult};

use super::evaluation::EvaluationArgs;
use super::outputs::ResultArgs;
use super::{manifest, show};
use crate::files::InputPath;
use crate::printer::{Outcome, Printer};

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal batch manifest.csv --calibration calibration.json --csv results
  shellcal batch manifest.csv --calibration calibration.json --reference free --traces traces
  shellcal batch manifest.toml --calibration calibration.json --json > results.json
  shellcal batch manifest.csv --calibration calibration.json --shard 3/100 --parquet results

A manifest is CSV with the columns file, condition, t_enter_s, t_exit_s and, if wanted,
velocity_m_s, mass_kg, channel_length_m, notes, exclude; or TOML with the same keys in [[trial]]
tables. Times are in s on the log's clock, or `auto`. Files are relative to the manifest.")]
pub(crate) struct BatchArgs {
    /// Which trials there are: CSV or `.toml`
    #[arg(value_name = "MANIFEST")]
    manifest: InputPath,

    /// The condition that the others are compared with
    #[arg(long, value_name = "NAME")]
    reference: Option<String>,

    /// All the conditions that there may be; any other is an error
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    conditions: Option<Vec<String>>,

    /// What the bootstrap draws its samples from
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,

    /// Evaluate one of N equal shares of the trials, and write `trials/part-K-of-N` and `strides/part-K-of-N`
    /// into the directories of `--csv` and `--parquet`: all shares together are the results of the whole
    #[arg(long, value_name = "K/N", value_parser = parse_shard, conflicts_with = "watch")]
    shard: Option<Shard>,

    /// Keep running, and evaluate again what changes: manifest, logs, calibration or profile
    #[arg(long)]
    watch: bool,

    #[command(flatten)]
    output: ResultArgs,

    #[command(flatten)]
    evaluation: EvaluationArgs,
}

/// How often files are looked at. A look costs a system call a file.
const EVERY: Duration = Duration::from_millis(300);

impl BatchArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<Outcome> {
        self.output.prepare(printer, self.shard)?;
        if !self.watch {
            return self.once(printer, None).map(|(_, outcome)| outcome);
        }
        ensure!(!printer.json(), "`--watch` prints tables again and again, `--json` one document");
        let stamps = |files: &[PathBuf]| -> Vec<FileStamp> {
            files.iter().map(PathBuf::as_path).map(stamp).collect()
        };
        let mut before: Option<(Vec<FileStamp>, Batch)> = None;
        loop {
            // Looked at before the job: what changes meanwhile has changed.
            let files = self.watched();
            let seen = stamps(&files);
            printer.files.renew();
            let equipment: Vec<FileStamp> =
                self.evaluation.files_by_role().map(|(_, path)| stamp(path)).collect();
            // Under another calibration or profile all results are others.
            let kept = before.take().filter(|(files, _)| *files == equipment);
            match self.once(printer, kept.as_ref().map(|(_, batch)| batch)) {
                Ok((batch, _)) => before = Some((equipment, batch)),
                Err(error) => printer.error(&error),
            }
            printer.note(format!("watching {} files; Ctrl-C ends", files.len()));
            while stamps(&files) == seen {
                std::thread::sleep(EVERY);
            }
            let mut changed = files.iter().zip(&seen).filter(|(file, seen)| stamp(file) != **seen);
            if let Some((first, _)) = changed.next() {
                let more = match changed.count() {
                    0 => String::new(),
                    more => format!(" and {more} more"),
                };
                printer.note(format!("`{}`{more} changed", first.display()));
            }
        }
    }

    /// The files that the results depend on.
    fn watched(&self) -> Vec<PathBuf> {
        let folder = manifest::folder(&self.manifest);
        let logs = manifest::parse(&self.manifest).map(|manifest| {
            let entries = manifest.rows.into_iter().flatten();
            entries.map(|entry| folder.join(entry.trial.file)).collect::<Vec<_>>()
        });
        let own = self.evaluation.files_by_role().map(|(_, path)| path.to_path_buf());
        let own = own.chain([self.manifest.to_path_buf()]);
        own.chain(logs.unwrap_or_default()).collect()
    }

    fn once(&self, printer: &Printer, before: Option<&Batch>) -> anyhow::Result<(Batch, Outcome)> {
        let equipment = self.evaluation.equipment()?;
        let manifest = manifest::read(&self.manifest, printer)?;
        manifest::check_reference(&manifest, self.reference.as_deref())?;
        let figures = self.output.figure_folder(printer)?;
        let options = BatchOptions {
            conditions: self.conditions.as_deref(),
            before,
            shard: self.shard,
            ..self.evaluation.batch_options(&equipment, self.output.trace_extent())
        };
        let trial = options.trial;
        let (path, profile) = (&self.manifest, &equipment.profile);
        let keep = |position, result: &mut _| {
            self.output.write_trial(printer, position, result, figures.as_ref(), profile)
        };
        let batch = manifest::evaluate(printer, path, &manifest, &equipment, options, keep);
        let conditions = match self.shard {
            // Statistics are of all trials.
            Some(_) => Vec::new(),
            None => batch.statistics(self.reference.as_deref(), self.seed),
        };
        self.output.write_tables(printer, &batch, &conditions, self.shard)?;
        if let Some(figures) = &figures {
            if self.shard.is_none() {
                figures.write_batch(&conditions, &batch.phases())?;
            }
            if let Some(note) = manifest::slow_filter(&batch, &trial) {
                printer.warning(note);
            }
        }
        // What is likely wrong with the manifest.
        let path = path.display();
        let suspicious = manifest.suspicious().into_iter().filter(|_| self.conditions.is_none());
        let warnings: Vec<_> = suspicious.map(|problem| format!("{path}:{problem}")).collect();
        self.show(printer, (&equipment.profile, &trial), &batch, &conditions, &warnings)?;
        let is_whole = batch.failures.is_empty();
        Ok((batch, if is_whole { Outcome::Done } else { Outcome::CheckFailed }))
    }

    fn show(
        &self,
        printer: &Printer,
        (profile, options): (&Profile, &TrialOptions),
        batch: &Batch,
        conditions: &[ConditionRow],
        warnings: &[String],
    ) -> anyhow::Result<()> {
        let manifest = self.manifest.display();
        let results: Vec<_> = batch
            .trials
            .iter()
            .map(|trial| (format!("{manifest}:{}", trial.position.line), &trial.evaluated.result))
            .collect();
        self.evaluation.note_forces(printer, options);
        show::diagnostics(printer, &results);
        warnings.iter().for_each(|warning| printer.warning(warning));
        manifest::tell_failures(printer, &self.manifest, batch);
        let bad = batch.failures.len();
        if bad > 0 {
            let of = batch.trials.len() + bad;
            printer.failure(format!("{bad} of {of} trials could not be evaluated"));
        }
        if batch.excluded > 0 {
            printer.note(format!("{} trials are left out, as the manifest says", batch.excluded));
        }
        if printer.json() {
            let trials = batch.trials.iter().map(|trial| {
                document! {
                    line: trial.position.line,
                    checksum: &trial.evaluated.checksum,
                    ..result: &trial.evaluated.result,
                }
            });
            return printer.document(&document! {
                manifest: &self.manifest,
                calibration: &self.evaluation.calibration,
                profile: profile,
                options: options,
                trials: trials.collect::<Vec<_>>(),
                failures: &batch.failures,
                excluded: batch.excluded,
                // The name of the share, if not all trials were to be evaluated.
                shard?: self.shard.map(Shard::stem),
                warnings: warnings,
                conditions: conditions,
            });
        }
        let results: Vec<&TrialResult> = results.into_iter().map(|(_, result)| result).collect();
        show::trials(printer, &results)?;
        match self.shard {
            Some(_) => Ok(()),
            None => show::conditions(printer, conditions),
        }
    }
}

fn parse_shard(text: &str) -> Result<Shard, String> {
    let parts = text
        .split_once('/')
        .and_then(|(number, of)| Shard::new(number.trim().parse().ok()?, of.trim().parse().ok()?));
    let most = Shard::MOST;
    parts.ok_or_else(|| format!("a share of at most {most}, from 1, such as `3/100`"))
}
