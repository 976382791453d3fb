//! A calibration brought up to date by a few new loads: from logs to a calibration file.

use std::collections::HashMap;

use super::hung_loads::{self, hung_rows, stated};
use super::{WorkflowError, agree_on_axes, check_channels};
use calibration::FitError;
use calibration::fit::{Evaluation, Workers, evaluate, label_poses_or_files};
use calibration::physics::{Observation, TrainingRows};
use calibration::quality::AxisQuality;
use calibration::recalibration::{NewLoads, Recalibration};
use calibration::validation::cross_validation::CrossValidation;
use calibration_file::{CalibrationFile, Diagnostics, Origin};
use load_table::HungLoads;
use log_file::{Log, ReadOptions, Wanted, read_logs};
use shell_data::dataset::Dataset;
use shell_data::wrench::{Axes, PerAxis};

/// A calibration that has been brought up to date, and the rows that were used.
#[derive(Debug)]
pub struct Recalibrated {
    /// What has changed.
    pub found: Recalibration,
    /// The rows, labelled by loads.
    pub rows: Dataset,
    /// How many loads they are.
    pub loads: usize,
    /// Of the calibration on these rows, as it was.
    errors: Evaluation,
}

/// Finds what has changed of a sensor since it was calibrated. The wrench is that of the logs, or of a table of loads
/// that hung there.
///
/// # Errors
/// [`WorkflowError`].
pub fn recalibrate(
    file: &CalibrationFile,
    logs: &[Log],
    table: Option<&HungLoads>,
    read: &ReadOptions<'_>,
) -> Result<Recalibrated, WorkflowError> {
    let calibration = &file.calibration;
    for log in logs {
        check_channels(log, calibration.channels())?;
    }
    let rows = match table {
        Some(table) => hung_rows(logs, table, read)?.0,
        None => read_rows(logs, calibration.axes, read)?,
    };
    let (training, labels) = TrainingRows::from_dataset(&rows);
    let observations = training.observations().map_err(FitError::from)?;
    let errors: HashMap<&str, PerAxis<f64>> = (table.into_iter().flat_map(HungLoads::loads))
        .map(|load| (load.group.as_str(), stated(load, &[]).standard_errors()))
        .collect();
    let error = |o: &Observation| errors.get(labels[o.group as usize].as_str());
    let reference_errors: Vec<PerAxis<f64>> =
        observations.iter().map(|o| error(o).copied().unwrap_or_default()).collect();
    let found = calibration.recalibrated(&NewLoads {
        observations: &observations,
        reference_errors: &reference_errors,
        calibration_errors: known_errors(file).unwrap_or_default(),
    })?;
    let evaluations = evaluate(&found.calibration, &rows, Workers::new(read.threads))?;
    let errors = Evaluation::total(&evaluations);
    Ok(Recalibrated { found, rows, loads: labels.len(), errors })
}

fn read_rows(logs: &[Log], axes: Axes, read: &ReadOptions<'_>) -> Result<Dataset, WorkflowError> {
    agree_on_axes(logs, &mut [])?;
    logs.iter().try_for_each(|log| log.require_axes(axes))?;
    let wanted = Wanted { wrench: true, ..hung_loads::wanted(logs) };
    let data = read_logs(logs, &wanted, read)?;
    Ok(label_poses_or_files(&data))
}

/// Errors on loads that were held out, or the best that a file knows of.
pub(super) fn known_errors(file: &CalibrationFile) -> Option<PerAxis<f64>> {
    let known = file.origin.diagnostics.as_ref()?;
    let held_out = known.cross_validation.as_ref().map(|of| of.grouped.map(|axis| axis.rms));
    let rms = |of: PerAxis<AxisQuality>| of.map(|axis| axis.rms);
    Some(held_out.unwrap_or_else(|| rms(known.test.unwrap_or(known.train))))
}

impl Recalibrated {
    /// Its calibration file: of the sensor, model and solver of `before`; that itself, where nothing has changed. Solver
    /// and errors are set in `origin`.
    pub fn file(&self, before: &CalibrationFile, origin: Origin) -> CalibrationFile {
        let Self { found, errors, loads, .. } = self;
        if found.quantities.is_empty() {
            return before.clone();
        }
        let old = &before.origin;
        let fitted = old.diagnostics.as_ref();
        let diagnostics = errors.quality().map(|train| Diagnostics {
            rows: errors.rows,
            skipped_rows: errors.skipped_rows,
            repeated_rows: errors.repeated_rows,
            rank: fitted.map_or(0, |of| of.rank),
            condition: fitted.and_then(|of| of.condition),
            train,
            cross_validation: found.held_out.map(|grouped| CrossValidation {
                groups: *loads,
                folds: *loads,
                rows: errors.rows,
                undetermined: Vec::new(),
                grouped,
                random_folds: 0,
                random: None,
                by_fold: Vec::new(),
            }),
            ..Diagnostics::default()
        });
        CalibrationFile {
            calibration: found.calibration.clone(),
            origin: Origin {
                sensor_serial: origin.sensor_serial.or_else(|| old.sensor_serial.clone()),
                solver: old.solver,
                diagnostics,
                columns: origin.columns.or_else(|| old.columns.clone()),
                ..origin
            },
        }
    }
}
