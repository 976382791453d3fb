//! Options of every command that evaluates trials, reading of manifests, and the evaluation of all their trials.

use std::path::{Path, PathBuf};

use anyhow::bail;
use calibration_file::CalibrationFile;
use forces::RowRule;
use log_file::{Log, Mapping, ReadOptions};
use output_file::OutputError;
use shell_data::hint::did_you_mean;
use shellcal::workflow::batch::{self, Batch, BatchOptions, FailedRow};
use shellcal::workflow::trial::TrialJob;
use trial::manifest::{CellPosition, Manifest};
use trial::{Instrument, Profile, TraceExtent, TrialOptions, TrialResult};

use crate::cmd::frames::{ForceArgs, describe_forces};
use crate::cmd::mapping::{EditedArg, MappingArgs};
use crate::files::{InputPath, read_text};
use crate::printer::Printer;

/// The reference condition of comparisons.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct ReferenceArg {
    /// Reference condition, which the others are compared with
    #[arg(long, value_name = "NAME")]
    pub(super) reference: Option<String>,
}

/// The title of a figure or a report.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct TitleArg {
    /// Title [default: the file's name, or the subject]
    #[arg(long, value_name = "TEXT")]
    pub(super) title: Option<String>,
}

/// The seed of bootstraps, the same in every run, so that intervals are reproducible.
pub(super) const BOOTSTRAP_SEED: u64 = 1;

/// How trials are evaluated.
#[derive(Debug, clap::Args)]
pub(crate) struct EvaluationArgs {
    /// Calibration file; without one, there are energies but no forces
    #[arg(long, short, value_name = "CAL")]
    pub(super) calibration: Option<InputPath>,

    #[command(flatten)]
    pub(super) edited: EditedArg,

    /// Robot profile, in TOML [default: the built-in `velociroach`; see `shellcal info --robot`]
    #[arg(long, value_name = "FILE")]
    profile: Option<InputPath>,

    /// Evaluate by row, as the lab's notebooks did: each row is a sample, the filter advances once per row
    /// and has a delay, the tare is over rows, and energy is summed row by row
    #[arg(long)]
    by_row: bool,

    #[command(flatten)]
    forces: ForceArgs,

    /// Highest reading of the converter, to detect saturation [default: as `convert`]
    #[arg(long, value_name = "COUNTS")]
    full_scale: Option<f64>,

    #[command(flatten)]
    pub(super) mapping: MappingArgs,
}

pub(super) struct Equipment {
    pub(super) profile: Profile,
    pub(super) calibration: Option<CalibrationFile>,
    pub(super) mapping: Mapping,
    pub(super) options: TrialOptions,
    read: ReadOptions<'static>,
}

impl EvaluationArgs {
    pub(super) fn equipment(
        &self,
        trace: TraceExtent,
        printer: &Printer,
    ) -> anyhow::Result<Equipment> {
        let calibration =
            self.calibration.as_ref().map(|path| self.edited.usable(path, printer)).transpose()?;
        let profile = match &self.profile {
            None => Profile::velociroach(),
            Some(path) => Profile::parse(&read_text(path)?)
                .map_err(|problem| anyhow::anyhow!("{}:{problem}", path.display()))?,
        };
        let usual = TrialOptions::default();
        let converter =
            calibration.as_ref().and_then(|file| file.calibration.converter(self.full_scale));
        let rule = if self.by_row { RowRule::Rows } else { RowRule::Time };
        let options = TrialOptions {
            forces: self.forces.options(rule),
            trace,
            full_scale: converter.map_or(usual.full_scale, |of| of.high),
            unexplained: calibration.as_ref().and_then(CalibrationFile::unexplained),
        };
        let mapping = self.mapping.mapping_for(calibration.as_ref());
        let read = ReadOptions { checksum: true, ..self.mapping.read_options() };
        Ok(Equipment { profile, calibration, mapping, options, read })
    }

    /// The files that results depend on besides manifest and logs, with their roles.
    pub(super) fn files_by_role(&self) -> impl Iterator<Item = (&'static str, &Path)> {
        let calibration = self.calibration.iter().map(|path| ("calibration", path.as_path()));
        calibration.chain(self.profile.iter().map(|path| ("profile", path.as_path())))
    }
}

impl Equipment {
    pub(super) fn instrument(&self) -> Instrument<'_> {
        let calibration = self.calibration.as_ref().map(|file| &file.calibration);
        Instrument { profile: &self.profile, calibration }
    }

    pub(super) fn job<'a>(&'a self, log: &'a Log) -> TrialJob<'a> {
        TrialJob { log, instrument: self.instrument(), options: self.options, read: self.read }
    }

    pub(super) fn note_forces(&self, printer: &Printer) {
        if self.calibration.is_some() {
            printer.note(describe_forces(&self.options.forces));
        }
    }

    pub(super) fn batch_options(&self) -> BatchOptions<'_> {
        BatchOptions {
            trial: self.options,
            mapping: &self.mapping,
            read: self.read,
            shard: None,
            progress: None,
        }
    }

    /// Evaluates the trials of a manifest, with a progress bar. `keep` may use traces and should reduce them.
    pub(super) fn evaluate(
        &self,
        printer: &Printer,
        (path, manifest): (&Path, &Manifest),
        options: BatchOptions<'_>,
        keep: impl Fn(CellPosition, &mut TrialResult) -> Result<(), OutputError> + Sync,
    ) -> Batch {
        let rows = manifest.rows.len();
        let share = options.shard.map_or(rows, |shard| shard.rows(rows).len());
        let bar = printer.count("trials", share as u64);
        let progress = |done: usize| bar.set_position(done as u64);
        let options = BatchOptions { progress: Some(&progress), ..options };
        batch::run(manifest, folder(path), self.instrument(), &options, keep)
    }

    /// A warning about forces over a stride, if the low-pass suppresses most of them.
    pub(super) fn slow_filter(&self, batch: &Batch) -> Option<String> {
        let rows = batch.trials.iter().map(|trial| &trial.evaluated.result.row);
        let strides_hz = rows.filter_map(|row| row.stride_frequency_hz).fold(0.0, f64::max);
        let cutoff_hz = self.options.forces.low_pass?.cutoff_hz;
        (strides_hz > 0.5 * cutoff_hz).then(|| {
            format!(
                "{strides_hz:.1} strides per second are near or above the low-pass of {cutoff_hz} Hz: it \
                 leaves little of what forces do within a stride; raise `--lowpass` to see more"
            )
        })
    }
}

/// Reads a manifest, and protects its logs from being replaced by outputs.
pub(super) fn read(path: &Path, printer: &Printer) -> anyhow::Result<Manifest> {
    let manifest = parse(path)?;
    for entry in manifest.rows.iter().flatten() {
        printer.files.protect(&folder(path).join(&entry.trial.file))?;
    }
    Ok(manifest)
}

/// Reads a manifest from its file: CSV or `.toml`.
pub(super) fn parse(path: &Path) -> anyhow::Result<Manifest> {
    let shown = path.display();
    let text = read_text(path)?;
    let is_toml = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    Manifest::parse(&text, is_toml).map_err(|problem| anyhow::anyhow!("{shown}:{problem}"))
}

/// The logs of a manifest that are evaluated; none if it cannot be read, which is reported when the command runs.
pub(crate) fn manifest_logs(path: &Path) -> Vec<PathBuf> {
    let manifest = parse(path).unwrap_or_default();
    let entries = manifest.rows.iter().flatten().filter(|entry| !entry.exclude);
    entries.map(|entry| folder(path).join(&entry.trial.file)).collect()
}

/// Checks that the trials of a manifest include the reference condition, if there is one.
pub(super) fn check_reference(manifest: &Manifest, reference: Option<&str>) -> anyhow::Result<()> {
    let entries = manifest.rows.iter().flatten().filter(|entry| !entry.exclude);
    require_condition("trial", entries.map(|entry| &*entry.trial.condition), reference)
}

pub(super) fn require_condition<'a>(
    what: &str,
    conditions: impl Iterator<Item = &'a str>,
    reference: Option<&str>,
) -> anyhow::Result<()> {
    let Some(reference) = reference else { return Ok(()) };
    let names: Vec<&str> = conditions.collect();
    if names.contains(&reference) {
        return Ok(());
    }
    let hint = did_you_mean(reference, names);
    bail!("no {what} has the condition `{reference}` of `--reference`{hint}")
}

pub(super) fn folder(path: &Path) -> &Path {
    path.parent().unwrap_or(Path::new(""))
}

/// The name prefix of files about a trial: the stem of its log, and its line in the manifest.
pub(super) fn stem(position: CellPosition, result: &TrialResult) -> String {
    let stem = Path::new(&result.row.file).file_stem().unwrap_or_default().to_string_lossy();
    format!("{stem}.{}", position.line)
}

/// Reports the trials that could not be evaluated; returns their files and the reasons.
pub(super) fn tell_failures(
    printer: &Printer,
    path: &Path,
    batch: &Batch,
) -> Vec<(String, String)> {
    let of = |FailedRow { position, file, message }: &FailedRow| {
        let path = path.display();
        // Reading errors already name the file.
        let named = if message.contains(file) { String::new() } else { format!("`{file}`: ") };
        printer.failure(format!("{path}:{position}: {named}{message}"));
        (file.clone(), format!("{path}:{position}: {message}"))
    };
    batch.failures.iter().map(of).collect()
}
