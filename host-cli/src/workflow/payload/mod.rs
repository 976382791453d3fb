//! The payload of a sensor: fitted to poses at rest, and subtracted from a run.

mod columns;
mod orientation;
mod poses;

pub use columns::MotionColumns;
use columns::{FoundColumns, no_motion, no_orientation};
use orientation::Attitude;
pub use orientation::Orientation;
pub use poses::{FittedPayload, GravityFrom, fit_payload};

use crate::workflow::WorkflowError;
use crate::workflow::error::TIMES;
use crate::workflow::selection::{passed, read_with_memory};
use calibration::Calibration;
use forces::payload::rotation::{self, nearest_rotation};
use forces::payload::{
    Accelerometer, Inertia, Lag, Motion, Payload, STANDARD_GRAVITY_M_S2, Vector, find_lag,
    gravity_at_centre, norm, times,
};
use log_file::{Log, LogError, ReadOptions, Wanted};
use shell_data::block::Block;
use shell_data::statistics::upper_median;

/// Maximum number of rows used to find the lag of two clocks: minutes of a fast sensor.
const LAG_ROWS: usize = 200_000;

#[derive(Clone, Debug, PartialEq)]
pub struct RunMotion {
    /// Apparent gravity at the centre of mass of the payload.
    pub motion: Motion,
    /// Kind of inertia that the motion includes.
    pub inertia: Inertia,
    /// Factor on the accelerations, if their unit is not that of the poses.
    pub rescaled: Option<f64>,
}

/// Plausible median apparent gravity of a run, relative to gravity; confusing g and m/s² is a factor of 9.8.
const PLAUSIBLE: std::ops::Range<f64> = 0.4..2.5;

/// Reads apparent gravity at the centre of a payload from a log: from accelerations if the payload knows
/// their frame, otherwise from orientations, which contain no inertia. Angular velocity is read from its
/// columns, or derived from orientations.
pub fn read_motion(
    log: &Log,
    columns: &MotionColumns,
    (payload, accelerometer): (&Payload, Option<&Accelerometer>),
    read: &ReadOptions<'_>,
) -> Result<RunMotion, WorkflowError> {
    let found = columns.find(log)?;
    let wanted = Wanted { time: true, others: found.positions(), ..Wanted::default() };
    let (Block { time_s, others, .. }, _) = log.read_whole(&wanted, read)?;
    let path = log.path().display();
    let attitudes = found.attitudes(log, &others, columns, (false, false))?;
    let accelerations = found.accelerations(&others);
    let mut rescaled = None;
    let (gravity, is_measured) = match (accelerometer, accelerations, &attitudes) {
        (Some(accelerometer), Some(accelerations), _) => {
            let scale = unit_in_run(log, accelerometer, &accelerations, columns.gravity_m_s2)?;
            rescaled = (scale != 1.0).then_some(scale);
            let gravity = |a: Vector| accelerometer.gravity(a.map(|value| scale * value));
            (accelerations.into_iter().map(gravity).collect(), true)
        }
        (_, _, Some(attitudes)) => (attitudes.iter().map(|of| of.gravity).collect(), false),
        (None, Some(_), None) => {
            return Err(WorkflowError::refused(
                format!(
                    "`{path}` has accelerations, but the payload does not know the accelerometer's frame"
                ),
                "fit the payload to poses that have accelerations, too, or name columns of `--orientation`",
            ));
        }
        _ => return Err(no_motion(log)),
    };
    let gravity: Vec<Vector> = gravity;
    // Samples at the same time have no slope.
    let is_later = |row: &usize| *row == 0 || time_s[*row] != time_s[row - 1];
    let rows: Vec<usize> = (0..gravity.len()).filter(is_later).collect();
    let times_s: Vec<f64> = rows.iter().map(|&row| time_s[row]).collect();
    let rates = angular_velocity(&found, &others, attitudes.as_deref(), accelerometer);
    let picked: Vec<Vector> = rows.iter().map(|&row| gravity[row]).collect();
    let (gravity, inertia) = match rates(&times_s, &rows) {
        Some(rates) if is_measured => {
            (gravity_at_centre(&times_s, &picked, &rates, payload.centre_m), Inertia::Whole)
        }
        _ if is_measured => (picked, Inertia::WithoutTurning),
        _ => (picked, Inertia::Nothing),
    };
    let bad = gravity.iter().position(|g| g.iter().any(|value| !value.is_finite()));
    if let Some(row) = bad {
        return Err(no_orientation(log, rows[row], "motion is not finite"));
    }
    let refused = |error| WorkflowError::refused(format!("`{path}`: {error}"), TIMES);
    let motion = Motion::new(&times_s, &gravity).map_err(refused)?;
    Ok(RunMotion { motion, inertia, rescaled })
}

/// Finds the angular velocity in the sensor's frame, rad/s, at some rows: from a gyroscope, which is assumed
/// to be in the frame of the accelerometer, or from rotations.
fn angular_velocity<'a>(
    found: &'a FoundColumns,
    others: &'a [Vec<f64>],
    attitudes: Option<&'a [Attitude]>,
    accelerometer: Option<&'a Accelerometer>,
) -> impl Fn(&[f64], &[usize]) -> Option<Vec<Vector>> + 'a {
    move |times_s, rows| {
        if let Some(rates) = found.angular_velocity(others) {
            let frame = accelerometer.map(|of| nearest_rotation(&of.matrix));
            let turned =
                |row: &usize| frame.as_ref().map_or(rates[*row], |of| times(of, rates[*row]));
            return Some(rows.iter().map(turned).collect());
        }
        let rotation = |row: &usize| attitudes?[*row].rotation;
        let rotations = rows.iter().map(rotation).collect::<Option<Vec<_>>>()?;
        Some(rotation::angular_velocity(times_s, &rotations))
    }
}

/// Factor that converts accelerations of a run to the unit of the poses, derived from their magnitude.
fn unit_in_run(
    log: &Log,
    accelerometer: &Accelerometer,
    accelerations: &[Vector],
    gravity_m_s2: f64,
) -> Result<f64, WorkflowError> {
    let mut sizes: Vec<f64> =
        accelerations.iter().map(|a| norm(accelerometer.gravity(*a)) / gravity_m_s2).collect();
    let Some(share) = upper_median(&mut sizes) else { return Ok(1.0) };
    let units = [1.0, STANDARD_GRAVITY_M_S2, 1.0 / STANDARD_GRAVITY_M_S2];
    units.into_iter().find(|unit| PLAUSIBLE.contains(&(unit * share))).ok_or_else(|| {
        WorkflowError::refused(
            format!(
                "`{}`: apparent gravity is `{:.4}` m/s² by its accelerations, {gravity_m_s2} expected",
                log.path().display(),
                share * gravity_m_s2
            ),
            "give accelerations of the run in the unit of those that the payload was fitted to",
        )
    })
}

/// The lag of a motion relative to a log of readings; `None` if it is not clear.
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
        (calibration, false),
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
