//! Tasks over logs: they join reading and computation, but print nothing and write no files.

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
pub mod sitting;
pub mod synthetic_trials;
pub mod trial;

mod error;

pub use error::WorkflowError;
use log_file::{Log, Wanted};
use shell_data::hint::OTHER_CHANNELS;
use shell_data::wrench::Axes;

/// The wrench axes for a fit: those of every log in `train`. The logs of `test` must have them, too; their
/// other axes are not used. Fails with [`WorkflowError::Refused`] if the training logs have different axes,
/// [`WorkflowError::Log`] if a log has none or a test log lacks some.
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

/// The first of `logs`, after a check that all of them, and `others`, have the `wanted` columns and the same
/// number of channels.
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

/// Checks the number of channels of a log. Fails with [`WorkflowError::Refused`].
pub fn check_channels(log: &Log, expected: usize) -> Result<(), WorkflowError> {
    let found = log.channels();
    if found == expected {
        return Ok(());
    }
    let path = log.path().display();
    let message = format!("`{path}` has `{found}` sensor channels, expected `{expected}`");
    Err(WorkflowError::refused(message, OTHER_CHANNELS))
}
