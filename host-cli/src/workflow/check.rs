//! Known weights on a calibrated sensor: do its forces still agree with them?

use super::convert::interval_factors;
use super::gates::{Gate, GateFailure};
use super::hung_loads::{axes_to_compare, gate_of_loads, hung_rows, stated};
use super::recalibration::known_errors;
use super::{WorkflowError, check_channels};
use calibration::physics::COVERAGE_LEVEL;
use calibration::quality::significant;
use calibration::uncertainty::HALF_WIDTH;
use calibration_file::CalibrationFile;
use forces::payload::{Vector, norm};
use load_table::{HungLoad, HungLoads};
use log_file::{Log, ReadOptions};
use report::CheckedLoad;
use shell_data::converter::Converter;
use shell_data::dataset::Dataset;
use shell_data::hint::quoted;
use shell_data::wrench::{Axes, Axis, PerAxis};

/// Largest allowed difference, as a multiple of the half-width of the 95 % interval: three standard errors. A
/// sound sensor with normal errors exceeds it somewhere in one of thirty checks of a dozen numbers each.
const MARGIN: f64 = 1.53;

#[derive(Clone, Debug)]
pub struct CheckedWeights {
    pub loads: Vec<CheckedLoad>,
    /// Passes if each line of the table was compared and differs by no more than the errors explain.
    pub gate: Gate,
}

/// Compares the weights of a table with the forces that a calibration gives for their readings. Compares the
/// `named` axes; without them, all axes of the calibration and any other axis that a weight loads. If the
/// table has a line without a load, the wrench measured there is subtracted as the zero.
pub fn check_weights(
    file: &CalibrationFile,
    logs: &[Log],
    table: &HungLoads,
    named: Option<Axes>,
    read: &ReadOptions<'_>,
) -> Result<CheckedWeights, WorkflowError> {
    let calibration = &file.calibration;
    for log in logs {
        check_channels(log, calibration.channels())?;
    }
    // Without intervals, as after `fit --from`, errors on held-out loads serve instead; they are as reliable
    // on average.
    let known = known_errors(file).map(|errors| errors.map(|error| HALF_WIDTH * error));
    let factors = match (interval_factors(calibration, COVERAGE_LEVEL), known) {
        (Ok(factors), _) => Ok(factors),
        (Err(_), Some(known)) => Err(known),
        (Err(error), None) => return Err(error),
    };
    let is_unloaded = |load: &&HungLoad| load.wrench().iter().all(|x| *x == 0.0);
    if table.loads().iter().all(|load| is_unloaded(&load)) {
        return Err(WorkflowError::refused("no weight hangs in any line of the table", None));
    }
    let (data, _) = hung_rows(logs, table, read)?;
    let asked = |load: &HungLoad| named.unwrap_or_else(|| axes_to_compare(load, calibration.axes));
    let mut gate = gate_of_loads(table, &data, asked, calibration.axes);
    let axes = named.unwrap_or(Axes::ALL).and(calibration.axes);
    let data = calibration.prepared(&data)?;
    let unloaded = table.loads().iter().find(is_unloaded).map(|load| readings_at(&data, load));
    let tare = unloaded.and_then(|readings| calibration.tare(&readings));
    let compare = |load: &HungLoad| {
        let readings = readings_at(&data, load);
        let rows = readings.first().map_or(0, Vec::len);
        (rows > 0).then(|| {
            let mut wrench = PerAxis::default();
            calibration.wrench(&readings, &mut wrench);
            let mean = |column: &Vec<f64>| column.iter().sum::<f64>() / rows as f64;
            let own: PerAxis<f64> = factors.map_or_else(
                |known| known,
                |factors| {
                    let errors = calibration.standard_errors(&readings, tare.as_ref());
                    let errors = errors.unwrap_or_default();
                    std::array::from_fn(|axis| factors[axis] * mean(&errors[axis]))
                },
            );
            let zero = tare.as_ref().map_or([0.0; 6], |tare| tare.wrench);
            let of_load = stated(load, &[]).standard_errors();
            let allowed = |axis: usize| MARGIN * own[axis].hypot(HALF_WIDTH * of_load[axis]);
            let stated = load.wrench();
            let measured: PerAxis<f64> =
                std::array::from_fn(|axis| mean(&wrench[axis]) - zero[axis]);
            let allowed: PerAxis<f64> = std::array::from_fn(allowed);
            let is_off = |axis: &Axis| {
                let difference = measured[axis.index()] - stated[axis.index()];
                !difference.is_finite() || difference.abs() > allowed[axis.index()]
            };
            let off = axes.iter().filter(is_off).collect();
            let (group, load) = (load.group.clone(), load.to_string());
            let cannot_tell = calibration
                .axes
                .iter()
                .all(|axis| stated[axis.index()].abs() <= allowed[axis.index()]);
            let turned_deg = turned_deg(&stated, &measured, &allowed);
            CheckedLoad { group, load, stated, measured, allowed, off, cannot_tell, turned_deg }
        })
    };
    let weights = table.loads().iter().filter(|load| !is_unloaded(load));
    let loads: Vec<CheckedLoad> = weights.filter_map(compare).collect();
    let cannot_tell = loads.iter().all(|of| of.cannot_tell);
    // Without a range of the training data, nothing is known of the converter.
    let converter = calibration.valid_range.as_ref().and_then(|_| calibration.converter(None));
    for (load, subject) in table.loads().iter().zip(gate.subjects()) {
        let name = &load.group;
        let ended =
            converter.map_or_else(Vec::new, |of| channels_at_end(&readings_at(&data, load), of));
        subject.lacks(if ended.is_empty() { Axes::NONE } else { Axes::ALL }, |axes| {
            let channels = quoted(ended, ", ");
            format!(
                "{axes} of load `{name}`, at which {channels} is at an end of the converter's range"
            )
        });
        for axis in axes_outside(file, load).iter() {
            subject.lacks([axis].into_iter().collect(), |_| {
                let value = significant(load.wrench()[axis.index()], 3);
                let [least, most] = calibrated(file, axis).unwrap_or_default();
                let [least, most] = [least, most].map(|end| significant(end, 3));
                let unit = axis.unit();
                format!("{axis} of load `{name}`, {value} {unit}: the calibration is for {least} to {most} {unit}", axis = axis.name())
            });
        }
        if cannot_tell && !is_unloaded(&load) {
            let name = &load.group;
            subject.lacks(Axes::ALL, |axes| format!("{axes} of load `{name}`, which is too light"));
        }
        let off = loads.iter().find(|of| of.group == load.group).map_or(Axes::NONE, |of| of.off);
        let name = format!("load `{}`", load.group);
        subject.compare(|_| (!off.is_empty()).then_some(GateFailure::Off { axes: off, name }));
    }
    Ok(CheckedWeights { loads, gate })
}

/// The loads of an axis in the training data, with no load, N or N·m.
fn calibrated(file: &CalibrationFile, axis: Axis) -> Option<[f64; 2]> {
    let excitation = file.origin.diagnostics.as_ref()?.excitation.as_ref()?;
    let of = excitation.axes[axis.index()];
    Some([of.min.min(0.0), of.max.max(0.0)])
}

/// Calibrated axes on which a load is outside the range of the training data by more than its error and a tenth of
/// that range: nothing is known there, so agreement and difference mean nothing.
fn axes_outside(file: &CalibrationFile, load: &HungLoad) -> Axes {
    const BEYOND: f64 = 0.1;
    let (wrench, errors) = (load.wrench(), stated(load, &[]).standard_errors());
    let is_outside = |axis: &Axis| {
        calibrated(file, *axis).is_some_and(|[least, most]| {
            let (value, error) = (wrench[axis.index()], HALF_WIDTH * errors[axis.index()]);
            let beyond = (value - most).max(least - value);
            beyond > error.max(BEYOND * (most - least))
        })
    };
    file.calibration.axes.iter().filter(is_outside).collect()
}

/// Names of the channels with most readings at an end of the converter's range.
fn channels_at_end(readings: &[Vec<f64>], converter: Converter) -> Vec<String> {
    let is_at_end = |(_, column): &(usize, &Vec<f64>)| {
        2 * column.iter().filter(|reading| converter.is_at_end(**reading)).count() > column.len()
    };
    let ended = readings.iter().enumerate().filter(is_at_end);
    ended.map(|(channel, _)| format!("s{}", channel + 1)).collect()
}

/// The angle between two forces of about the same size, degrees, if it exceeds the allowed difference.
fn turned_deg(
    stated: &PerAxis<f64>,
    measured: &PerAxis<f64>,
    allowed: &PerAxis<f64>,
) -> Option<f64> {
    /// Relative difference in size above which the forces are of different weights.
    const SAME_SIZE: f64 = 0.2;
    let part = |wrench: &PerAxis<f64>| -> Vector { std::array::from_fn(|axis| wrench[axis]) };
    let (stated, measured) = (part(stated), part(measured));
    let (one, other) = (norm(stated), norm(measured));
    let cosine = stated.iter().zip(measured).map(|(a, b)| a * b).sum::<f64>() / (one * other);
    let angle = cosine.clamp(-1.0, 1.0).acos();
    let is_alike = (other / one - 1.0).abs() <= SAME_SIZE;
    (is_alike && angle.sin() * one > norm(part(allowed)) && angle.is_finite())
        .then(|| angle.to_degrees())
}

fn readings_at(data: &Dataset, load: &HungLoad) -> Vec<Vec<f64>> {
    let mut all = Vec::new();
    for (_, block) in data.blocks() {
        let mut row = 0;
        all.resize_with(block.rows.readings.len(), Vec::new);
        for (label, count) in &*block.labels {
            if *label == load.group {
                for (all, column) in all.iter_mut().zip(&block.rows.readings) {
                    all.extend_from_slice(&column[row..row + count]);
                }
            }
            row += count;
        }
    }
    all
}
