//! A manifest from its file, and all of its trials: what several commands do.

use std::path::Path;

use anyhow::bail;
use output_file::OutputError;
use shell_data::hint::did_you_mean;
use shellcal::workflow::batch::{self, Batch, BatchOptions, FailedRow};
use trial::manifest::{CellPosition, Manifest};
use trial::{TrialOptions, TrialResult};

use super::evaluation::Equipment;
use crate::files::read_text;
use crate::printer::Printer;

/// Reads a manifest, and sees to it that no output replaces its logs.
pub(super) fn read(path: &Path, printer: &Printer) -> anyhow::Result<Manifest> {
    let manifest = parse(path)?;
    for entry in manifest.rows.iter().flatten() {
        printer.files.protect(&folder(path).join(&entry.trial.file))?;
    }
    Ok(manifest)
}

/// A manifest from its file: CSV or `.toml`.
pub(super) fn parse(path: &Path) -> anyhow::Result<Manifest> {
    let shown = path.display();
    let text = read_text(path)?;
    let is_toml = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    Manifest::parse(&text, is_toml).map_err(|problem| anyhow::anyhow!("{shown}:{problem}"))
}

/// Whether the trials of a manifest have the condition that others are to be compared with.
pub(super) fn check_reference(manifest: &Manifest, reference: Option<&str>) -> anyhow::Result<()> {
    let entries = manifest.rows.iter().flatten().filter(|entry| !entry.exclude);
    require_condition("trial", entries.map(|entry| &*entry.trial.condition), reference)
}

/// Whether one of the `conditions` is the `reference`, if there is to be one.
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

/// The folder that the logs of a manifest are relative to.
pub(super) fn folder(path: &Path) -> &Path {
    path.parent().unwrap_or(Path::new(""))
}

/// The name that files about a trial start with: that of its log, and its line in the manifest.
pub(super) fn stem(position: CellPosition, result: &TrialResult) -> String {
    let stem = Path::new(&result.row.file).file_stem().unwrap_or_default().to_string_lossy();
    format!("{stem}.{}", position.line)
}

/// Evaluates the trials of a manifest, with a progress bar. `keep` may use traces and should reduce them.
pub(super) fn evaluate(
    printer: &Printer,
    path: &Path,
    manifest: &Manifest,
    equipment: &Equipment,
    options: BatchOptions<'_>,
    keep: impl Fn(CellPosition, &mut TrialResult) -> Result<(), OutputError> + Sync,
) -> Batch {
    let rows = manifest.rows.len();
    let share = options.shard.map_or(rows, |shard| shard.rows(rows).len());
    let bar = printer.count("trials", share as u64);
    let progress = |done: usize| bar.set_position(done as u64);
    let options = BatchOptions { progress: Some(&progress), ..options };
    let batch = batch::run(manifest, folder(path), equipment.instrument(), &options, keep);
    bar.finish_and_clear();
    batch
}

/// What to know about forces over a stride, where the low-pass leaves little of them.
pub(super) fn slow_filter(batch: &Batch, options: &TrialOptions) -> Option<String> {
    let rows = batch.trials.iter().map(|trial| &trial.evaluated.result.row);
    let strides_hz = rows.filter_map(|row| row.stride_frequency_hz).fold(0.0, f64::max);
    let cutoff_hz = options.forces.low_pass?.cutoff_hz;
    (strides_hz > 0.5 * cutoff_hz).then(|| {
        format!(
            "{strides_hz:.1} strides per second are near or above the low-pass of {cutoff_hz} Hz: it \
             leaves little of what forces do within a stride; raise `--lowpass` to see more"
        )
    })
}

/// Tells which trials could not be evaluated: the files of these, and why.
pub(super) fn tell_failures(
    printer: &Printer,
    path: &Path,
    batch: &Batch,
) -> Vec<(String, String)> {
    let of = |FailedRow { position, file, message }: &FailedRow| {
        let path = path.display();
        // Reading errors name the file themselves.
        let named = if message.contains(file) { String::new() } else { format!("`{file}`: ") };
        printer.failure(format!("{path}:{position}: {named}{message}"));
        (file.clone(), format!("{path}:{position}: {message}"))
    };
    batch.failures.iter().map(of).collect()
}
