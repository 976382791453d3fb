//! What a sensor carries: fitted to poses at rest, and taken off a run.

mod columns;
mod poses;

pub use columns::MotionColumns;
use columns::{no_motion, no_orientation};
pub use poses::{FittedPayload, GravityFrom, fit_payload};

use crate::workflow::WorkflowError;
use crate::workflow::error::TIMES;
use crate::workflow::selection::{passed, read_with_memory};
use calibration::Calibration;
use forces::payload::{Accelerometer, Lag, Motion, Payload, Vector, find_lag};
use log_file::{Log, LogError, ReadOptions, Wanted};
use shell_data::block::Block;

/// The most rows that the lag of two clocks is looked for in: minutes of a fast sensor.
const LAG_ROWS: usize = 200_000;

/// Reads apparent gravity from a log: from accelerations, where the payload knows their frame, otherwise from
/// orientations, which say nothing of inertia. Also says whether accelerations were used.
///
/// # Errors
/// [`WorkflowError`].
pub fn read_motion(
    log: &Log,
    columns: &MotionColumns,
    accelerometer: Option<&Accelerometer>,
    read: &ReadOptions<'_>,
) -> Result<(Motion, bool), WorkflowError> {
    let found = columns.find(log)?;
    let wanted = Wanted { time: true, others: found.positions(), ..Wanted::default() };
    let (Block { time_s, others, .. }, _) = log.read_whole(&wanted, read)?;
    let path = log.path().display();
    let (gravity, is_measured) = match (accelerometer, found.accelerations(&others)) {
        (Some(accelerometer), Some(accelerations)) => {
            (accelerations.into_iter().map(|a| accelerometer.gravity(a)).collect(), true)
        }
        (_, accelerations) => match found.gravity(log, &others, columns.gravity_m_s2)? {
            Some(gravity) => (gravity, false),
            None if accelerations.is_some() => {
                return Err(WorkflowError::refused(
                    format!(
                        "`{path}` has accelerations, but the payload does not know the accelerometer's frame"
                    ),
                    "fit the payload to poses that have accelerations, too, or name columns of `--orientation`",
                ));
            }
            None => return Err(no_motion(log)),
        },
    };
    let gravity: Vec<Vector> = gravity;
    let bad = gravity.iter().position(|g| g.iter().any(|value| !value.is_finite()));
    if let Some(row) = bad {
        return Err(no_orientation(log, row, "motion is not finite"));
    }
    let refused = |error| WorkflowError::refused(format!("`{path}`: {error}"), TIMES);
    Ok((Motion::new(&time_s, &gravity).map_err(refused)?, is_measured))
}

/// How late a motion is against a log of readings; `None` where that is not clear.
///
/// # Errors
/// [`LogError`].
pub fn find_motion_lag(
    log: &Log,
    calibration: &Calibration,
    payload: &Payload,
    motion: &Motion,
    read: &ReadOptions<'_>,
) -> Result<Option<Lag>, LogError> {
    let wanted = Wanted { time: true, readings: true, ..Wanted::default() };
    let mut times_s: Vec<f64> = Vec::new();
    let mut forces: [Vec<f64>; 3] = Default::default();
    let read = read_with_memory(
        log,
        (&wanted, read),
        calibration,
        |block| {
            let mut wrench = Default::default();
            calibration.wrench(&block.readings, &mut wrench);
            let [x, y, z, ..] = wrench;
            (std::mem::take(&mut block.time_s), [x, y, z])
        },
        |(times, columns)| {
            times_s.extend(times);
            forces.iter_mut().zip(columns).for_each(|(all, column)| all.extend(column));
            if times_s.len() >= LAG_ROWS { Err(None) } else { Ok(()) }
        },
    );
    passed(read)?;
    Ok(find_lag(payload, motion, &times_s, &forces))
}
