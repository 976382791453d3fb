//! What must be known of a log before its frames can be converted: tare, clock, and the load that the tare
//! has in it.

use super::options::Conversion;
use crate::workflow::WorkflowError;
use crate::workflow::selection::{fresh_rows, passed, read_with_memory};
use forces::{FirstRows, ForceError, ForcePipeline, PipelineSetup, TareRule};
use log_file::Wanted;
use shell_data::wrench::PerAxis;

/// Reads as much of the log as tare and clock need. Also returns what is to be taken off besides the load at
/// each row: the sensor's zero, or, of tared wrenches, the load that the tare has taken off already.
pub(super) fn survey(
    conversion: &Conversion<'_>,
) -> Result<(ForcePipeline, PerAxis<f64>), WorkflowError> {
    let Conversion { log, calibration, options, read } = conversion;
    let mut forces = options.forces;
    if forces.low_pass.is_some() && !log.has_time() && forces.low_pass_is_optional {
        forces.low_pass = None;
    }
    if forces.tare.follows_rests() {
        if options.load.is_some() {
            return Err(WorkflowError::RestsUnderLoad);
        }
        if !log.has_time() {
            return Err(WorkflowError::RestsWithoutTime(log.path().display().to_string()));
        }
    }
    let mut setup = match options.load {
        Some(_) => PipelineSetup::keeping_frames(forces),
        None => PipelineSetup::new(forces),
    };
    if !setup.is_done() {
        let by_time = matches!(forces.tare, TareRule::Between(..));
        let by_time = by_time || calibration.needs_time();
        let time = log.has_time() || by_time || forces.low_pass.is_some() || options.load.is_some();
        if forces.low_pass.is_some() && !log.has_time() {
            let (path, reason) = (log.path().display().to_string(), "it has no time column");
            return Err(WorkflowError::Forces { path, error: ForceError::NoRate(reason) });
        }
        let wanted = Wanted { readings: true, time, ..Wanted::default() };
        let read = read_with_memory(
            log,
            (&wanted, read),
            calibration,
            |block| (fresh_rows(log, options.rows, block), std::mem::take(block)),
            |(fresh, block)| {
                let (times_s, readings) = (&*block.time_s, &*block.readings);
                let rows = FirstRows { times_s, readings, fresh: &fresh, leg: None };
                setup.look_at(calibration, rows);
                if setup.is_done() { Err(None) } else { Ok(()) }
            },
        );
        passed(read)?;
    }
    let path = || log.path().display().to_string();
    let finished = setup.finish(calibration);
    let (pipeline, frames) =
        finished.map_err(|error| WorkflowError::Forces { path: path(), error })?;
    let zero = options.load.as_ref().map(|load| {
        let tared = frames.and_then(|frames| load.mean(&frames.times_s));
        tared.map_or(load.payload.bias(), |mean| mean.map(|load| -load))
    });
    Ok((pipeline, zero.unwrap_or_default()))
}
