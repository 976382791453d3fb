//! Loads in logs, and the calibration from the log and the table of a sitting.

use calibration::dynamics::DynamicsRule;
use calibration::fit::{CovarianceRule, FitOptions, HeldOut, ModelRule, Workers};
use calibration_file::Origin;
use live_view::LiveRow;
use load_table::HungLoads;
use log_file::{Log, ReadOptions, Wanted};
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

/// Fits the calibration of a sitting to its logs and its table of loads, as `fit --loads` does. Fails with
/// [`WorkflowError`] if the logs cannot be read, or the loads do not determine a model.
pub fn fit_sitting(
    logs: &[Log],
    table: &HungLoads,
    origin: Origin,
    read: &ReadOptions<'_>,
) -> Result<FittedLogs, WorkflowError> {
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
    FittedLogs::new(fit, (logs, &[]), &data, (origin, options.outliers))
}
