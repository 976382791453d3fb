//! Complete tasks over logs: they read logs and call the core, but do not print or write files.

pub mod align;
pub mod batch;
pub mod bench;
pub mod certificate;
pub mod check;
pub mod convert;
pub mod drift;
pub mod figures;
pub mod fit;
pub mod gates;
pub mod hung_loads;
pub mod live;
pub mod noise;
pub mod outliers;
pub mod partial;
pub mod payload;
pub mod plan;
pub mod recalibration;
pub mod remark;
pub mod report;
pub mod selection;
pub mod simulate;
pub mod synthetic_trials;
pub mod trial;

mod error;

pub use error::WorkflowError;
use log_file::{Log, Wanted};
use shell_data::hint::OTHER_CHANNELS;
use shell_data::wrench::Axes;

/// Axes of the wrench for a fit: all `train` logs must have the same axes. `test` logs must have them too,
/// and their other axes are dropped.
///
/// # Errors
/// [`WorkflowError::Refused`] if the training logs differ in their axes, [`WorkflowError::Log`] if a log
/// has no axes or a test log lacks some.
pub fn agree_on_axes(train: &[Log], test: &mut [Log]) -> Result<Axes, WorkflowError> {
    let first = train.first().ok_or(WorkflowError::NoLogs)?;
    let expected = first.axes();
    for log in train {
        log.require(&Wanted { readings: true, wrench: true, ..Wanted::default() })?;
        let found = log.axes();
        if found != expected {
            let path = log.path().display();
            let message = format!(
                "`{path}` has the axes {found} of the wrench, the logs before it have {expected}"
            );
            return Err(WorkflowError::refused(message, None));
        }
    }
    test.iter_mut().try_for_each(|log| log.keep_axes(expected))?;
    Ok(expected)
}

/// Checks that all `logs` and `others` have the wanted columns and the same number of channels; returns the
/// first log.
fn check_logs<'a>(
    logs: &'a [Log],
    others: &[Log],
    wanted: &Wanted,
) -> Result<&'a Log, WorkflowError> {
    let first = logs.first().ok_or(WorkflowError::NoLogs)?;
    for log in logs.iter().chain(others) {
        log.require(wanted)?;
        check_channels(log, first.channels())?;
    }
    Ok(first)
}

/// Checks the number of channels of a log.
///
/// # Errors
/// [`WorkflowError::Refused`].
pub fn check_channels(log: &Log, expected: usize) -> Result<(), WorkflowError> {
    let found = log.channels();
    if found == expected {
        return Ok(());
    }
    let path = log.path().display();
    let message = format!("`{path}` has `{found}` sensor channels, expected `{expected}`");
    Err(WorkflowError::refused(message, OTHER_CHANNELS))
}
