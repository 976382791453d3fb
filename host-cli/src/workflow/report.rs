//! What a report says of its inputs: files with checksums, the calibration, the settings.

use std::io;
use std::path::Path;

use super::batch::Batch;
use super::trial::{TrialJob, doubtful_rows};
use calibration_file::{CalibrationFile, Role};
use forces::RowRule;
use log_file::{Log, LogError, Mapping, ReadOptions, checksum};
use report::{CalibrationFacts, CalibrationSource, Input, OutlierRow, OutlierTable, figure};
use trial::{Diagnostic, Instrument, Profile, TrialOptions};

/// A file with its checksum.
///
/// # Errors
/// [`io::Error`] if it cannot be read.
pub fn input(role: &str, path: &Path) -> io::Result<Input> {
    let bytes = std::fs::read(path)?;
    Ok(Input {
        role: role.to_owned(),
        path: path.display().to_string(),
        bytes: bytes.len() as u64,
        checksum: checksum::of(&bytes),
    })
}

/// The logs of a batch, each once.
pub fn logs(batch: &Batch) -> Vec<Input> {
    let mut inputs: Vec<Input> = Vec::new();
    for trial in &batch.trials {
        let path = trial.path.display().to_string();
        // Several trials can be of one log.
        if !inputs.iter().any(|input| input.path == path) {
            let bytes = std::fs::metadata(&trial.path).map_or(0, |metadata| metadata.len());
            let checksum = trial.evaluated.checksum.clone().unwrap_or_default();
            inputs.push(Input { role: "log".to_owned(), path, bytes, checksum });
        }
    }
    inputs
}

/// The frames in the windows of trials with a reading that cannot be trusted; `None` without a calibration. Only
/// logs that have some, as their diagnostics say, are read again.
///
/// # Errors
/// [`LogError`] if one of those can no longer be read.
pub fn doubtful(
    batch: &Batch,
    mapping: &Mapping,
    instrument: Instrument<'_>,
    options: TrialOptions,
    read: ReadOptions<'_>,
) -> Result<Option<OutlierTable>, LogError> {
    if instrument.calibration.is_none() {
        return Ok(None);
    }
    let read = ReadOptions { checksum: false, progress: None, ..read };
    let mut all = OutlierTable::default();
    for trial in &batch.trials {
        let result = &trial.evaluated.result;
        let is_doubt = |of: &Diagnostic| matches!(of.code, "out_of_range" | "saturated");
        if !result.diagnostics.iter().any(is_doubt) {
            continue;
        }
        let log = Log::open(&trial.path, mapping)?;
        let job = TrialJob { log: &log, instrument, options, read };
        let (rows, count) = doubtful_rows(&job, [result.row.t_enter_s, result.row.t_exit_s])?;
        let file = &result.row.file;
        let row = |(line, what)| OutlierRow { file: file.clone(), line, what };
        all.rows.extend(rows.into_iter().map(row));
        all.count += count;
    }
    Ok(Some(all))
}

/// What a report says of the calibration in a file that is named `path`.
pub fn calibration_facts<'a>(path: &str, file: &'a CalibrationFile) -> CalibrationFacts<'a> {
    let CalibrationFile { calibration, origin } = file;
    let mut facts = vec![
        ("file", path.to_owned()),
        ("made by", origin.made_by.clone()),
        ("date", origin.date.clone()),
        ("model", calibration.name()),
    ];
    if let Some(serial) = &origin.sensor_serial {
        facts.push(("sensor", serial.clone()));
    }
    if let Some(solver) = &origin.solver {
        facts.push(("solver", format!("{}, ridge {}", solver.name.name(), figure(solver.ridge))));
    }
    let known = origin.diagnostics.as_ref();
    if let Some(diagnostics) = known {
        facts.push(("rows fitted", diagnostics.rows.to_string()));
        facts.push(("rank", diagnostics.rank.to_string()));
        facts.push(("condition number", figure(diagnostics.condition)));
    }
    let sources = origin.sources.iter().map(|source| CalibrationSource {
        role: match source.role {
            Role::Train => "fit",
            Role::Test => "test",
            Role::Wrench => "give the wrench",
            Role::Matrix => "import",
            Role::Calibration => "bring up to date",
        },
        path: source.path.display().to_string(),
        rows: source.rows,
        checksum: source.checksum.clone(),
    });
    CalibrationFacts {
        facts,
        axes: calibration.axes,
        train: known.map(|known| &known.train),
        cross_validation: known.and_then(|known| known.cross_validation.as_ref()),
        test: known.and_then(|known| known.test.as_ref()),
        sources: sources.collect(),
    }
}

/// How trials were evaluated: name and value.
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
