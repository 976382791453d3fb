//! Evaluation of all trials of a manifest: in parallel, reported in order; a bad trial does not stop the others.

use std::collections::HashMap;
use std::convert::Infallible;
use std::path::{Path, PathBuf};

use super::WorkflowError;
use super::trial::{Evaluated, TrialJob, evaluate_in_window};
use log_file::pipeline;
use log_file::{Log, Mapping, ReadOptions};
use output_file::OutputError;
use serde::Serialize;
use shell_data::hint::with_causes;
use trial::manifest::{CellPosition, Entry, Manifest, ManifestProblem, Shard};
use trial::{
    ConditionRow, Instrument, Per, PhaseProfile, Quantity, TrialError, TrialOptions, TrialResult,
    ValueSample,
};

#[derive(Clone, Copy)]
pub struct BatchOptions<'a> {
    pub trial: TrialOptions,
    pub mapping: &'a Mapping,
    /// How logs are read; `threads` is the number of trials evaluated at a time.
    pub read: ReadOptions<'a>,
    /// The share of the rows to evaluate; `None` for all. Conflicts between rows are found in all rows.
    pub shard: Option<Shard>,
    /// Called with the number of finished trials.
    pub progress: Option<&'a (dyn Fn(usize) + Sync)>,
}

#[derive(Clone, Debug, Default)]
pub struct Batch {
    /// The evaluated trials, in the order of the manifest.
    pub trials: Vec<BatchTrial>,
    pub failures: Vec<FailedRow>,
    pub excluded: usize,
}

#[derive(Clone, Debug)]
pub struct BatchTrial {
    pub position: CellPosition,
    pub path: PathBuf,
    pub evaluated: Evaluated,
}

#[derive(Clone, Debug, Serialize)]
pub struct FailedRow {
    #[serde(flatten)]
    pub position: CellPosition,
    /// Name in the manifest; empty if the row names none.
    pub file: String,
    pub message: String,
}

/// Evaluates the trials of `manifest`, whose files are relative to `folder`. `keep` receives each result on
/// the thread that computed it, to write data that is too large to hold, and may take its trace. The results
/// are in the order of the manifest for any number of threads.
pub fn run(
    manifest: &Manifest,
    folder: &Path,
    instrument: Instrument<'_>,
    options: &BatchOptions<'_>,
    keep: impl Fn(CellPosition, &mut TrialResult) -> Result<(), OutputError> + Sync,
) -> Batch {
    let path_of = |file: &str| {
        let path = folder.join(file);
        path.canonicalize().unwrap_or(path)
    };
    let faults: HashMap<usize, ManifestProblem> =
        manifest.faults(None, path_of).into_iter().collect();
    let mut batch = Batch::default();
    let mut done = 0;
    let count = manifest.rows.len();
    let mut numbers = options.shard.map_or(0..count, |shard| shard.rows(count));
    let read = ReadOptions { progress: None, threads: 1, ..options.read };
    let work = |(): &mut (), number: &mut usize| -> Option<Result<BatchTrial, FailedRow>> {
        let row = &manifest.rows[*number];
        let file = row.as_ref().map_or_else(|_| String::new(), |entry| entry.trial.file.clone());
        let failed = |position, message| FailedRow { position, file, message };
        let entry = match (faults.get(number), row) {
            (Some(problem), _) | (None, Err(problem)) => {
                return Some(Err(failed(problem.position, problem.message.clone())));
            }
            (None, Ok(entry)) if entry.exclude => return None,
            (None, Ok(entry)) => entry,
        };
        Some(match evaluate_entry(entry, folder, instrument, options, &read) {
            Err(error) => Err(failed(faulty_cell(entry, &error), with_causes(&error))),
            Ok(mut trial) => match keep(trial.position, &mut trial.evaluated.result) {
                Err(error) => Err(failed(entry.file_position, with_causes(&error))),
                Ok(()) => Ok(trial),
            },
        })
    };
    let fold = |outcome| {
        match outcome {
            None => batch.excluded += 1,
            Some(Ok(trial)) => batch.trials.push(trial),
            Some(Err(failed)) => batch.failures.push(failed),
        }
        done += 1;
        if let Some(progress) = options.progress {
            progress(done);
        }
        Ok::<_, Infallible>(())
    };
    let threads = options.read.thread_count();
    let Ok(_) = pipeline::run(&mut numbers, threads, || (), work, fold);
    batch
}

fn evaluate_entry(
    entry: &Entry,
    folder: &Path,
    instrument: Instrument<'_>,
    options: &BatchOptions<'_>,
    read: &ReadOptions<'_>,
) -> Result<BatchTrial, WorkflowError> {
    let path = folder.join(&entry.trial.file);
    let log = Log::open(&path, options.mapping)?;
    let window_s = (entry.enter.value, entry.exit.value);
    let job = TrialJob { log: &log, instrument, options: options.trial, read: *read };
    let evaluated = evaluate_in_window(&job, entry.trial.clone(), window_s)?;
    Ok(BatchTrial { position: entry.position, path, evaluated })
}

fn faulty_cell(entry: &Entry, error: &WorkflowError) -> CellPosition {
    match error {
        WorkflowError::Trial(TrialError::OutsideLog { enter, first, .. }) if enter >= first => {
            entry.exit.position
        }
        WorkflowError::Trial(TrialError::ExitBeforeEntry { .. }) => entry.exit.position,
        WorkflowError::Trial(TrialError::OutsideLog { .. } | TrialError::Gap { .. })
        | WorkflowError::Window(_)
        | WorkflowError::NoForces
        | WorkflowError::NoCalibration => entry.enter.position,
        _ => entry.file_position,
    }
}

impl Batch {
    /// The conditions, in the order of their first row in the manifest.
    pub fn conditions(&self) -> Vec<&str> {
        let mut conditions: Vec<&str> = Vec::new();
        for row in self.trials.iter().map(|trial| &trial.evaluated.result.row) {
            if !conditions.contains(&&*row.condition) {
                conditions.push(&row.condition);
            }
        }
        conditions
    }

    /// Statistics of every quantity in every condition, per trial and per stride; differences are from `reference`.
    pub fn statistics(&self, reference: Option<&str>, seed: u64) -> Vec<ConditionRow> {
        let conditions = self.conditions();
        let mut rows = Vec::new();
        for per in Per::ALL {
            for quantity in Quantity::ALL {
                let sample = |condition: &str| self.sample(condition, per, quantity);
                let reference = reference.map(|name| (name, sample(name)));
                for &condition in &conditions {
                    let sample = sample(condition);
                    let Some(statistics) = sample.statistics(seed) else { continue };
                    let other = reference.as_ref().filter(|(name, _)| *name != condition);
                    let difference =
                        other.and_then(|(name, other)| sample.difference(other, name, seed));
                    let condition = condition.to_owned();
                    rows.push(ConditionRow { condition, per, quantity, statistics, difference });
                }
            }
        }
        rows
    }

    /// Drag and lift over the phase of the leg in each condition, merged from the trials that have a phase profile.
    pub fn phases(&self) -> Vec<(String, PhaseProfile)> {
        let results = || self.trials.iter().map(|trial| &trial.evaluated.result);
        let of = |condition: &str| {
            let profiles = results()
                .filter(|result| result.row.condition == condition)
                .filter_map(|result| result.phase.clone());
            Some((condition.to_owned(), profiles.reduce(|all, one| all.merged(&one))?))
        };
        self.conditions().into_iter().filter_map(of).collect()
    }

    /// Values of a quantity in a condition; the strides of one trial form a group.
    pub fn sample(&self, condition: &str, per: Per, quantity: Quantity) -> ValueSample {
        let results = self.trials.iter().map(|trial| &trial.evaluated.result);
        let mut sample = ValueSample::default();
        for result in results.filter(|result| result.row.condition == condition) {
            match per {
                Per::Trial => sample.add_cluster(quantity.of(&result.row.measures)),
                Per::Stride => {
                    let strides = result.stride_rows.iter();
                    sample.add_cluster(strides.filter_map(|stride| quantity.of(&stride.measures)));
                }
            }
            // A stride's drag energy refers to its own length: scale the trial's error by the ratio of their energies.
            match result.row.shared_error(quantity) {
                Some((parts, degrees)) => {
                    let scale = match (per, quantity.of(&result.row.measures)) {
                        (Per::Stride, Some(whole)) if quantity == Quantity::DragEnergy => {
                            let strides = result.stride_rows.iter();
                            let values = strides.filter_map(|stride| quantity.of(&stride.measures));
                            values.sum::<f64>() / (result.stride_rows.len().max(1) as f64 * whole)
                        }
                        _ => 1.0,
                    };
                    let parts: Vec<f64> = parts.iter().map(|part| scale * part).collect();
                    sample.add_shared_error(&parts, degrees);
                }
                None if result.row.has_unknown_error => sample.add_unknown_error(),
                None => {}
            }
        }
        sample
    }
}
