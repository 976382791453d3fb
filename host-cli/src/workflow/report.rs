//! Inputs of a report: files with checksums, and the settings.

use std::io;
use std::path::Path;

use super::batch::Batch;
use super::selection::{RowFilter, fresh_rows};
use forces::RowRule;
use log_file::{Log, LogError, Mapping, ReadOptions, Wanted, checksum};
use report::{Input, OutlierRow, OutlierTable};
use shell_data::block::Block;
use trial::{Diagnostic, Instrument, Profile, TrialOptions, TrialResult};

const NAMED: usize = 20;

/// A file with its checksum. Fails with [`io::Error`] if the file cannot be read.
pub fn input(role: &str, path: &Path) -> io::Result<Input> {
    let bytes = std::fs::read(path)?;
    Ok(Input {
        role: role.to_owned(),
        path: path.display().to_string(),
        bytes: bytes.len() as u64,
        checksum: checksum::of(&bytes),
    })
}

/// Logs of a batch, each once.
pub fn logs(batch: &Batch) -> Vec<Input> {
    let mut inputs: Vec<Input> = Vec::new();
    for trial in &batch.trials {
        let path = trial.path.display().to_string();
        // Several trials may use the same log.
        if !inputs.iter().any(|input| input.path == path) {
            let bytes = std::fs::metadata(&trial.path).map_or(0, |metadata| metadata.len());
            let checksum = trial.evaluated.checksum.clone().unwrap_or_default();
            inputs.push(Input { role: "log".to_owned(), path, bytes, checksum });
        }
    }
    inputs
}

/// The frames in the windows of trials that have an untrustworthy reading; `None` without a calibration. Only
/// logs whose diagnostics report such frames are read again; the first frames of each are named.
pub fn doubtful(
    batch: &Batch,
    mapping: &Mapping,
    instrument: Instrument<'_>,
    options: TrialOptions,
    read: ReadOptions<'_>,
) -> Result<Option<OutlierTable>, LogError> {
    let Some(calibration) = instrument.calibration else { return Ok(None) };
    let read = ReadOptions { checksum: false, progress: None, ..read };
    let converter = calibration.converter(Some(options.full_scale));
    let doubt = |(channel, reading): (usize, f64)| {
        let range = calibration.valid_range.as_ref().and_then(|ranges| ranges.get(channel));
        let why = match range {
            _ if converter.is_some_and(|of| of.is_at_end(reading)) => {
                "an end of the converter".to_owned()
            }
            Some(range) if !range.contains(reading) => {
                format!("calibrated from {} to {}", range.min, range.max)
            }
            _ => return None,
        };
        Some(format!("`s{}` is {reading}, {why}", channel + 1))
    };
    let mut all = OutlierTable::default();
    for trial in &batch.trials {
        let TrialResult { row, diagnostics, .. } = &trial.evaluated.result;
        let is_doubt = |of: &Diagnostic| matches!(of.code, "out_of_range" | "saturated");
        if !diagnostics.iter().any(is_doubt) {
            continue;
        }
        let log = Log::open(&trial.path, mapping)?;
        let wanted = Wanted { time: true, readings: true, ..Wanted::default() };
        let look = |block: &mut Block| -> Vec<OutlierRow> {
            let fresh = fresh_rows(&log, RowFilter::All, block);
            let doubtful = |at: usize| {
                let time_s = block.time_s[at];
                let is_used = fresh[at] && (row.t_enter_s..=row.t_exit_s).contains(&time_s);
                let readings = block.readings.iter().map(|column| column[at]).enumerate();
                let doubts: Vec<String> = readings.filter(|_| is_used).filter_map(doubt).collect();
                (!doubts.is_empty()).then(|| OutlierRow {
                    file: row.file.clone(),
                    line: block.lines.line(at),
                    what: format!("{time_s:.3} s: {}", doubts.join("; ")),
                })
            };
            (0..block.rows).filter_map(doubtful).collect()
        };
        let most = all.rows.len() + NAMED;
        log.read(&wanted, &read, look, |found| {
            all.count += found.len();
            let room = most - all.rows.len();
            all.rows.extend(found.into_iter().take(room));
            Ok::<_, LogError>(())
        })?;
    }
    Ok(Some(all))
}

/// Settings of the evaluation of trials: name and value.
pub fn settings(options: &TrialOptions, profile: &Profile, seed: u64) -> Vec<(String, String)> {
    let low_pass = options.forces.low_pass;
    let low_pass =
        low_pass.map_or("none".to_owned(), |low_pass| format!("Butterworth, {low_pass}"));
    let rule = match options.forces.rule {
        RowRule::Time => "by time",
        RowRule::Rows => "by row",
    };
    let mut settings = vec![
        ("tare".to_owned(), options.forces.tare.to_string()),
        ("low-pass".to_owned(), low_pass),
        ("means and integrals".to_owned(), rule.to_owned()),
        ("bootstrap seed".to_owned(), seed.to_string()),
    ];
    let Ok(serde_json::Value::Object(tables)) = serde_json::to_value(profile) else {
        return settings;
    };
    for (table, value) in tables {
        match value {
            serde_json::Value::Object(keys) => {
                let key = |(key, value): (String, serde_json::Value)| {
                    (format!("{table}.{key}"), value.to_string())
                };
                settings.extend(keys.into_iter().map(key));
            }
            serde_json::Value::String(text) => settings.push((format!("profile {table}"), text)),
            value => settings.push((table, value.to_string())),
        }
    }
    settings
}
