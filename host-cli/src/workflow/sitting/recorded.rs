//! Loads in logs, and the calibration from the log and the table of a sitting.

use calibration::dynamics::DynamicsRule;
use calibration::fit::{CovarianceRule, FitOptions, HeldOut, ModelRule, Workers};
use calibration_file::Origin;
use live_view::LiveRow;
use load_table::HungLoads;
use log_file::{Log, ReadOptions, Wanted, read_dataset};
use shared_proto::CHANNELS;

use super::HeldLoad;
use crate::workflow::WorkflowError;
use crate::workflow::fit::FittedLogs;
use crate::workflow::hung_loads::{HungReference, labelled_rows, wanted};
use crate::workflow::live::saturated;

/// Reads the loads of a table from logs, in the order of their first rows: the line, and the rows. With `measured`,
/// rows have the wrench of the log. Fails with [`WorkflowError`] if a log cannot be read or does not have eight
/// channels, or its rows have no labels and are not still as often as there are loads.
pub fn held_loads(
    logs: &[Log],
    table: &HungLoads,
    measured: bool,
    read: &ReadOptions<'_>,
) -> Result<Vec<(usize, HeldLoad)>, WorkflowError> {
    if let Some(log) = logs.iter().find(|log| log.channels() != CHANNELS) {
        let (path, found) = (log.path().display(), log.channels());
        let message = format!("`{path}` has {found} channels, a sitting takes {CHANNELS}");
        return Err(WorkflowError::refused(message, None));
    }
    let wanted = Wanted { wrench: measured, ..wanted(logs) };
    let data = labelled_rows(logs, table, &wanted, read)?;
    let mut held: Vec<(usize, HeldLoad)> = Vec::new();
    for (_, block) in data.blocks() {
        let rows = &*block.rows;
        let mut first = 0;
        for (label, count) in &*block.labels {
            let line = table.loads().iter().position(|load| load.group == *label);
            for row in (first..first + count).filter(|_| line.is_some()) {
                let line = line.unwrap_or_default();
                let known = held.iter().position(|(known, _)| *known == line);
                let at = known.unwrap_or_else(|| {
                    held.push((line, HeldLoad::default()));
                    held.len() - 1
                });
                let readings = std::array::from_fn(|channel| rows.readings[channel][row]);
                let wrench = measured.then(|| std::array::from_fn(|axis| rows.wrench[axis][row]));
                held[at].1.push(&LiveRow {
                    readings: Some(readings),
                    wrench,
                    saturated: saturated(&readings),
                    ..LiveRow::default()
                });
            }
            first += count;
        }
    }
    Ok(held)
}

/// The mean readings in the first second of a sitting's log, before its first load; `None` without rows or time.
pub fn rest_readings(
    log: &Log,
    read: &ReadOptions<'_>,
) -> Result<Option<[f64; CHANNELS]>, WorkflowError> {
    const REST_S: f64 = 1.0;
    let wanted = Wanted { readings: true, time: log.has_time(), ..Wanted::default() };
    let data = read_dataset(&[(log, wanted)], read)?;
    let Some((_, block)) = data.blocks().next() else { return Ok(None) };
    let time_s = &block.rows.time_s;
    let rows = time_s.iter().take_while(|time| **time - time_s[0] < REST_S).count();
    let mean =
        |channel: usize| block.rows.readings[channel][..rows].iter().sum::<f64>() / rows as f64;
    Ok((rows > 0).then(|| std::array::from_fn(mean)))
}

/// Fits the calibration of a sitting to its logs and its table of loads, as `fit --loads` does. Fails with
/// [`WorkflowError`] if the logs cannot be read, or the loads do not determine a model.
pub fn fit_sitting(
    logs: &[Log],
    table: &HungLoads,
    origin: Origin,
    read: &ReadOptions<'_>,
) -> Result<(FittedLogs, HungReference), WorkflowError> {
    let read = ReadOptions { checksum: true, ..*read };
    let (mut data, hung) = HungReference::read(logs, table, &read)?;
    let options = FitOptions {
        model: ModelRule::Physics,
        dynamics: DynamicsRule::NOTHING,
        cross_validation: Some(HeldOut::Column),
        covariance: CovarianceRule::Auto,
        stated_loads: Some(&hung.judged_by),
        workers: Workers::new(read.threads),
        ..FitOptions::default()
    };
    let fit = data.fit(&options)?;
    let fitted = FittedLogs::new(fit, (logs, &[]), &data, (origin, options.outliers))?;
    Ok((fitted, hung))
}
