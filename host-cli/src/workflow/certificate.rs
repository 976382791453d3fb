//! Content of a certificate of a calibration: its uncertainty budget, from the calibration file and from logs
//! of the calibrated sensor.

use super::WorkflowError;
use super::convert::interval_factors;
use super::drift::drift;
use super::noise::noise;
use super::recalibration::known_errors;
use super::selection::RowFilter;
use calibration::physics::COVERAGE_LEVEL;
use calibration::quality::significant;
use calibration_file::{CalibrationFile, Diagnostics};
use log_file::{Log, ReadOptions};
use report::Contribution;
use shell_data::wrench::{Axis, AxisValues, PerAxis};

/// Scatter or mean of the forces, as a share of the calibrated loads, above which the sensor was probably
/// loaded during a log; noise is about a hundredth.
const LOADED: f64 = 0.05;

/// A mean force of less than this many times the error on loads may be such an error itself.
const MEAN_ERRORS: f64 = 3.0;

/// The uncertainty of a single frame, by source. A log of the `unloaded` sensor gives repeatability and drift;
/// `reference` is the standard uncertainty of the reference, N and N·m. Fails with [`WorkflowError`] if the log of
/// the unloaded sensor cannot be used.
pub fn budget(
    file: &CalibrationFile,
    unloaded: Option<&Log>,
    reference: Option<[f64; 2]>,
    read: &ReadOptions<'_>,
) -> Result<Vec<Contribution>, WorkflowError> {
    let mut budget = vec![of_model(file)];
    match unloaded {
        Some(log) => {
            let repeatability = of_noise(file, log, budget[0].standard, read)?;
            budget.extend([repeatability, of_drift(file, log, read)?]);
        }
        None => {
            let basis = "not stated: a log of the unloaded sensor tells it".to_owned();
            budget.push(measured("drift of the zero", basis, None));
        }
    }
    let basis = match reference {
        Some(_) => "as stated for the reference sensor or the weights",
        None => "not stated",
    };
    let standard = reference
        .map(|[force, moment]| std::array::from_fn(|axis| if axis < 3 { force } else { moment }));
    let stated = measured("reference", basis.to_owned(), standard);
    budget.push(Contribution { evaluation: "B", ..stated });
    Ok(budget)
}

fn measured(source: &'static str, basis: String, standard: Option<PerAxis<f64>>) -> Contribution {
    let degrees_of_freedom = None;
    Contribution { source, evaluation: "A", basis, standard, degrees_of_freedom, is_part: false }
}

/// Errors on held-out loads, or the best estimate in the file.
fn of_model(file: &CalibrationFile) -> Contribution {
    // This is a root mean square over groups: a group is one observation, however many rows it has.
    let mut degrees_of_freedom = None;
    let rows = match &file.origin.diagnostics {
        Some(Diagnostics { cross_validation: Some(of), .. }) => {
            degrees_of_freedom = Some(of.groups as f64);
            format!("{} groups of rows that were not used for the fit", of.groups)
        }
        Some(Diagnostics { test: Some(_), .. }) => "test logs".to_owned(),
        Some(_) => "the rows that were fitted: too small for new loads".to_owned(),
        None => {
            let basis = "the calibration file does not say".to_owned();
            return measured("model and mounting", basis, None);
        }
    };
    let basis = format!("root mean square error on {rows}");
    let of_model = measured("model and mounting", basis, known_errors(file));
    Contribution { degrees_of_freedom, ..of_model }
}

/// Repeatability from a log of the unloaded sensor; `known` holds the errors on loads.
fn of_noise(
    file: &CalibrationFile,
    log: &Log,
    known: Option<PerAxis<f64>>,
    read: &ReadOptions<'_>,
) -> Result<Contribution, WorkflowError> {
    let found = noise(log, &file.calibration, RowFilter::Fresh, None, read)?;
    let (frames, path, axes) = (found.frames, log.path().display(), file.calibration.axes);
    let standard = by_axis(&found.axes, |scatter| scatter.rms);
    let mean = by_axis(&found.axes, |scatter| scatter.mean.abs());
    let [model, loads] = [known, file.largest_loads()].map(|of| of.unwrap_or([f64::INFINITY; 6]));
    // The name and figures of the first axis whose value is too large for an unloaded sensor.
    let loaded = |of: PerAxis<f64>, errors: f64| {
        let is_load = |axis: &Axis| {
            let at = axis.index();
            of[at] > LOADED * loads[at] && of[at] > errors * model[at]
        };
        let axis = axes.iter().find(is_load)?;
        let [value, error] = [of, model].map(|of| significant(of[axis.index()], 3));
        let (name, unit) = (axis.name(), axis.unit());
        Some((name, format!("{value} {unit}, the error on loads is {error} {unit}")))
    };
    if let Some((name, figures)) = loaded(standard, 1.0) {
        return Err(WorkflowError::refused(
            format!("`{path}` is of a loaded sensor: {name} scatters by {figures}"),
            "record the sensor at rest without a load, such as `shellcal record PORT --duration 60 -o rest.csv`",
        ));
    }
    // A model without a constant gives forces only as differences from a tare.
    let has_zero = file.calibration.polynomial().is_none_or(|of| of.model().intercept);
    if let Some((name, figures)) = loaded(mean, MEAN_ERRORS).filter(|_| has_zero) {
        return Err(WorkflowError::refused(
            format!(
                "`{path}` is of a loaded sensor, or its zero has moved since the calibration: the mean of {name} is {figures}"
            ),
            "take the load off and record again; if there was none, calibrate again, or update the calibration with \
             `shellcal fit --from`",
        ));
    }
    let largest = |unit: &str| {
        let of_unit = axes.iter().filter(|axis| axis.unit() == unit);
        let largest = of_unit.map(|axis| mean[axis.index()]).reduce(f64::max)?;
        Some(format!("{} {unit}", significant(largest, 2)))
    };
    let zero = match has_zero {
        true => {
            let largest: Vec<_> = ["N", "N·m"].into_iter().filter_map(largest).collect();
            format!("mean up to {} off the calibrated zero", largest.join(" and "))
        }
        false => "the calibration has no zero to compare the mean with".to_owned(),
    };
    let basis = format!("scatter of {frames} frames of the unloaded sensor, `{path}`; {zero}");
    // Errors of means over many rows are smaller than the noise of one row, and do not include it.
    let is_within = |axis: Axis| standard[axis.index()] <= model[axis.index()];
    let is_part = known.is_some() && axes.iter().all(is_within);
    let degrees_of_freedom = Some(frames.saturating_sub(1).max(1) as f64);
    let scatter = measured("repeatability", basis, Some(standard));
    Ok(Contribution { is_part, degrees_of_freedom, ..scatter })
}

fn of_drift(
    file: &CalibrationFile,
    log: &Log,
    read: &ReadOptions<'_>,
) -> Result<Contribution, WorkflowError> {
    let found = drift(log, Some(&file.calibration), None, RowFilter::Fresh, read);
    let mut degrees_of_freedom = None;
    let (basis, standard) = match found {
        Ok(found) => {
            let intervals = found.rests;
            degrees_of_freedom = Some(intervals.saturating_sub(1).max(1) as f64);
            let basis = format!(
                "standard deviation of the zero in {intervals} stationary intervals, tared before the first"
            );
            (basis, found.axes.map(|axes| by_axis(&axes, |of| of.wander)))
        }
        Err(error @ WorkflowError::Log(_)) => return Err(error),
        Err(error) => (format!("not stated: {error}"), None),
    };
    let of_zero = measured("drift of the zero", basis, standard);
    Ok(Contribution { degrees_of_freedom, ..of_zero })
}

fn by_axis<T>(values: &AxisValues<T>, of: impl Fn(&T) -> f64) -> PerAxis<f64> {
    let mut all = PerAxis::default();
    values.iter().for_each(|(axis, value)| all[axis.index()] = of(value));
    all
}

pub fn intervals(file: &CalibrationFile) -> String {
    match interval_factors(&file.calibration, COVERAGE_LEVEL).is_ok() {
        true => "`shellcal convert` gives the 95 % interval of each frame, which is narrower or wider than this with \
                 the load; it comes from groups of rows that were held out.",
        false => "The calibration has no 95 % intervals of single frames: no groups of rows were held out for them.",
    }
    .to_owned()
}
