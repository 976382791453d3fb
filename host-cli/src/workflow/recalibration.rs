//! Update of a calibration with a few new loads: from logs to a calibration file.

use std::collections::HashMap;

use super::gates::{Gate, GateSubject};
use super::hung_loads::{self, axes_to_compare, gate_of_loads, hung_rows, load_name, stated};
use super::{WorkflowError, agree_on_axes, check_channels};
use calibration::Calibration;
use calibration::FitError;
use calibration::fit::{Evaluation, Workers, evaluate, label_poses_or_files};
use calibration::physics::{Observation, TrainingRows};
use calibration::quality::AxisQuality;
use calibration::recalibration::{NewLoads, Recalibration, RecalibrationError};
use calibration::validation::cross_validation::{CrossValidation, HeldOutQuality};
use calibration_file::{CalibrationFile, Diagnostics, Origin};
use load_table::{HungLoad, HungLoads};
use log_file::{Log, ReadOptions, Wanted, read_logs};
use shell_data::dataset::Dataset;
use shell_data::wrench::{Axes, PerAxis};

#[derive(Debug)]
pub struct Recalibrated {
    pub found: Recalibration,
    /// Rows, labelled by load.
    pub rows: Dataset,
    pub loads: usize,
    /// Passes if every load of the table was used.
    pub gate: Gate,
    errors: Evaluation,
}

/// Finds changes of a sensor since it was calibrated. The wrench comes from the logs, or from a table of the
/// loads that were hung.
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
    let (rows, mut gate) = match table {
        Some(table) => {
            let rows = hung_rows(logs, table, read)?.0;
            let asked = |load: &HungLoad| axes_to_compare(load, calibration.axes);
            let gate = gate_of_loads(table, &rows, asked, calibration.axes);
            (rows, gate)
        }
        None => (read_rows(logs, calibration.axes, read)?, Gate::default()),
    };
    gate.subjects().iter_mut().for_each(GateSubject::hold);
    let (training, labels) = TrainingRows::from_dataset(&rows);
    let observations = training.observations().map_err(FitError::from)?;
    let errors: HashMap<&str, PerAxis<f64>> = (table.into_iter().flat_map(HungLoads::loads))
        .map(|load| (load.group.as_str(), stated(load, &[]).standard_errors()))
        .collect();
    let error = |o: &Observation| errors.get(labels[o.group as usize].as_str());
    let reference_errors: Vec<PerAxis<f64>> =
        observations.iter().map(|o| error(o).copied().unwrap_or_default()).collect();
    let calibration_errors = known_errors(file).unwrap_or_default();
    let name = |group: u64| {
        let label = labels[group as usize].as_str();
        let load = table.and_then(|table| table.loads().iter().find(|load| load.group == label));
        load.map_or_else(|| format!("load `{label}`"), load_name)
    };
    if let Some(largest) = file.largest_loads() {
        let is_too_large = |o: &&Observation| {
            let mut pairs = o.wrench.iter().zip(&largest);
            pairs.any(|(load, largest)| load.abs() > MOST_TIMES * largest && *largest > 0.0)
        };
        if let Some(o) = observations.iter().find(is_too_large) {
            return Err(WorkflowError::refused(
                format!("{} is over {MOST_TIMES} times what was calibrated", name(o.group)),
                WRONG_LOAD,
            ));
        }
    }
    if table.is_some() && observations.len() == labels.len() {
        let errors = reference_errors
            .iter()
            .map(|of| std::array::from_fn(|axis| of[axis].hypot(calibration_errors[axis])));
        let order = better_order(calibration, &observations, &errors.collect::<Vec<_>>());
        if let Some((at, other)) = order {
            let [at, other] = [at, other].map(|at| name(observations[at].group));
            return Err(WorkflowError::refused(
                format!("the loads hang in another order: the rows at {at} fit {other}"),
                "put the lines of the table in the order of the log, or mend the log's labels",
            ));
        }
    }
    let found = calibration.recalibrated(&NewLoads {
        observations: &observations,
        reference_errors: &reference_errors,
        calibration_errors,
    });
    let found = found.map_err(|error| match error {
        RecalibrationError::Impossible { group, .. } => {
            WorkflowError::refused(format!("{error}: look at {}", name(group)), WRONG_LOAD)
        }
        error => error.into(),
    })?;
    let evaluations = evaluate(&found.calibration, &rows, Workers::new(read.threads))?;
    let errors = Evaluation::total(&evaluations);
    Ok(Recalibrated { found, rows, loads: labels.len(), gate, errors })
}

/// A load of more than this many times the largest calibrated load is probably a typing error.
const MOST_TIMES: f64 = 10.0;

const WRONG_LOAD: &str =
    "mend the line of the table; where it is right, the sensor is to be calibrated anew";

/// Maximum RMS difference, in standard errors, if the loads were hung in the order of the table.
const AGREES: f64 = 2.0;

/// Two loads that were probably exchanged: the readings at the first fit the second. Found only if another
/// order of all loads agrees with the old calibration and the stated order does not. A common offset of all
/// loads is removed, since a zero drifts.
fn better_order(
    calibration: &Calibration,
    observations: &[Observation],
    errors: &[PerAxis<f64>],
) -> Option<(usize, usize)> {
    let column = |channel| observations.iter().map(|o| o.readings[channel]).collect();
    let readings: Vec<Vec<f64>> = (0..calibration.channels()).map(column).collect();
    let mut predicted: PerAxis<Vec<f64>> = PerAxis::default();
    calibration.wrench(&readings, &mut predicted);
    let (count, axes) = (observations.len(), calibration.axes);
    let mean = |of: &dyn Fn(usize) -> f64| (0..count).map(of).sum::<f64>() / count as f64;
    let offset: PerAxis<f64> = std::array::from_fn(|axis| {
        mean(&|at| {
            predicted[axis].get(at).copied().unwrap_or_default() - observations[at].wrench[axis]
        })
    });
    // Squared difference between readings and load, in standard errors.
    let square = |at: usize, load: usize| -> f64 {
        let of_axis = |axis: usize| {
            let difference = predicted[axis][at] - offset[axis] - observations[load].wrench[axis];
            (difference / errors[load][axis]).powi(2)
        };
        axes.iter().map(|axis| of_axis(axis.index())).sum()
    };
    let mut order: Vec<usize> = (0..count).collect();
    let total = |order: &[usize]| -> f64 {
        order.iter().enumerate().map(|(at, load)| square(at, *load)).sum()
    };
    let is_agreed = |sum: f64| sum / (count * axes.count()) as f64 <= AGREES * AGREES;
    let is_known = |of: &PerAxis<f64>| axes.iter().all(|axis| of[axis.index()] > 0.0);
    if !errors.iter().all(is_known) || is_agreed(total(&order)) {
        return None;
    }
    // Make the best exchange of two loads, as long as one improves the total.
    loop {
        let pairs = (0..count).flat_map(|a| (0..a).map(move |b| (a, b)));
        let gain = |&(a, b): &(usize, usize)| {
            square(a, order[a]) + square(b, order[b]) - square(a, order[b]) - square(b, order[a])
        };
        let best = pairs.max_by(|x, y| gain(x).total_cmp(&gain(y)))?;
        let is_gain = gain(&best) > 1e-9 * total(&order);
        if !is_gain {
            break;
        }
        order.swap(best.0, best.1);
    }
    let moved = order.iter().enumerate().find(|(at, load)| at != *load);
    moved.filter(|_| is_agreed(total(&order))).map(|(at, load)| (at, *load))
}

fn read_rows(logs: &[Log], axes: Axes, read: &ReadOptions<'_>) -> Result<Dataset, WorkflowError> {
    agree_on_axes(logs, &mut [])?;
    logs.iter().try_for_each(|log| log.require_axes(axes))?;
    let wanted = Wanted { wrench: true, ..hung_loads::wanted(logs) };
    let data = read_logs(logs, &wanted, read)?;
    Ok(label_poses_or_files(&data))
}

/// Errors on held-out loads, or the best estimate in a file.
pub(super) fn known_errors(file: &CalibrationFile) -> Option<PerAxis<f64>> {
    let known = file.origin.diagnostics.as_ref()?;
    let held_out = known.cross_validation.as_ref().map(|of| of.grouped.map(|axis| axis.rms));
    let rms = |of: PerAxis<AxisQuality>| of.map(|axis| axis.rms);
    Some(held_out.unwrap_or_else(|| rms(known.test.unwrap_or(known.train))))
}

impl Recalibrated {
    /// Returns the updated calibration file, with sensor, model and solver from `before`; or `before` itself if
    /// nothing has changed. `origin` receives solver and errors.
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
            cross_validation: found.held_out.map(|means| CrossValidation {
                groups: *loads,
                folds: *loads,
                rows: errors.rows,
                undetermined: Vec::new(),
                // Held-out loads are means over their rows; a frame also has the noise of a row.
                grouped: std::array::from_fn(|axis| {
                    let of_row = train[axis].rms.powi(2) - found.after[axis].powi(2);
                    let rms = (means[axis].rms.powi(2) + of_row.max(0.0)).sqrt();
                    HeldOutQuality { rms, ..means[axis] }
                }),
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
