//! Poses at rest from logs, and what they tell.

use std::collections::HashMap;

use super::columns::{MotionColumns, no_motion};
use crate::workflow::WorkflowError;
use forces::payload::{
    Accelerometer, PayloadFit, PayloadPose, STANDARD_GRAVITY_M_S2, Vector, fit, frame_from_forces,
    norm,
};
use log_file::{Log, ReadOptions, Wanted};
use shell_data::statistics::upper_median;
use shell_data::wrench::{Axes, PerAxis};

/// What poses told.
#[derive(Clone, Debug, PartialEq)]
pub struct FittedPayload {
    /// What the sensor carries.
    pub fit: PayloadFit,
    /// How its accelerometer sits.
    pub accelerometer: Option<Accelerometer>,
    /// What said how the sensor lies.
    pub gravity_from: GravityFrom,
    /// Whether rows of a pose were put together by labels.
    pub is_grouped: bool,
    /// Rows of each log.
    pub rows: Vec<u64>,
    /// Rows that were wrong and left out, of all.
    pub skipped_rows: u64,
}

/// What said how the sensor lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum GravityFrom {
    /// Columns of orientation.
    Orientation,
    /// Accelerations alone.
    Accelerations,
}

/// The mean of the rows of a pose.
#[derive(Clone, Copy, Default)]
struct Sum {
    rows: f64,
    wrench: PerAxis<f64>,
    gravity: Vector,
    acceleration: Vector,
}

impl Sum {
    fn add(&mut self, wrench: PerAxis<f64>, gravity: Vector, acceleration: Vector) {
        // A running mean keeps what is common out of the rounding.
        self.rows += 1.0;
        let share = 1.0 / self.rows;
        let pairs = self.wrench.iter_mut().zip(wrench);
        let pairs = pairs.chain(self.gravity.iter_mut().zip(gravity));
        let pairs = pairs.chain(self.acceleration.iter_mut().zip(acceleration));
        pairs.for_each(|(mean, value)| *mean += (value - *mean) * share);
    }
}

/// Fits what a sensor carries to logs of poses at rest: a pose is the rows under a label of the group column, or
/// every row by itself.
///
/// # Errors
/// [`WorkflowError`].
pub fn fit_payload(
    logs: &[Log],
    columns: &MotionColumns,
    read: &ReadOptions<'_>,
) -> Result<FittedPayload, WorkflowError> {
    let first = logs.first().ok_or(WorkflowError::NoLogs)?;
    let is_grouped = logs.iter().all(Log::has_groups);
    // Poses in the order in which they begin.
    let (mut sums, mut by_label) = (Vec::<Sum>::new(), HashMap::new());
    let (mut all_have_gravity, mut all_have_accelerations) = (true, true);
    let (mut rows, mut skipped_rows) = (Vec::new(), 0);
    for log in logs {
        let found = columns.find(log)?;
        log.require_axes(Axes::ALL)?;
        let wanted = Wanted {
            wrench: true,
            groups: is_grouped,
            others: found.positions(),
            ..Wanted::default()
        };
        let (block, summary) = log.read_whole(&wanted, read)?;
        rows.push(summary.rows);
        skipped_rows += summary.skipped_rows;
        let gravity = found.gravity(log, &block.others, columns.gravity_m_s2)?;
        let accelerations = found.accelerations(&block.others);
        if gravity.is_none() && accelerations.is_none() {
            return Err(no_motion(log));
        }
        all_have_gravity &= gravity.is_some();
        all_have_accelerations &= accelerations.is_some();
        let labels = block.groups.iter();
        let labels = labels.flat_map(|(label, rows)| std::iter::repeat_n(Some(label), *rows));
        for (row, label) in (0..block.rows).zip(labels.chain(std::iter::repeat(None))) {
            let at =
                |column: &Option<Vec<Vector>>| column.as_ref().map_or([0.0; 3], |all| all[row]);
            let wrench = std::array::from_fn(|axis| block.wrench[axis][row]);
            let next = sums.len();
            let pose = label.map_or(next, |label| *by_label.entry(label.clone()).or_insert(next));
            sums.resize(next.max(pose + 1), Sum::default());
            sums[pose].add(wrench, at(&gravity), at(&accelerations));
        }
    }
    let accelerations: Vec<Vector> = sums.iter().map(|sum| sum.acceleration).collect();
    let (gravity, accelerometer, gravity_from) = if all_have_gravity {
        let gravity: Vec<Vector> = sums.iter().map(|sum| sum.gravity).collect();
        let accelerometer =
            all_have_accelerations.then(|| Accelerometer::fit(&accelerations, &gravity)).flatten();
        (gravity, accelerometer, GravityFrom::Orientation)
    } else if all_have_accelerations {
        let forces: Vec<Vector> =
            sums.iter().map(|sum| [sum.wrench[0], sum.wrench[1], sum.wrench[2]]).collect();
        let unit = unit_m_s2(first, &accelerations, columns.gravity_m_s2)?;
        let found = frame_from_forces(&accelerations, &forces, unit)?;
        let gravity = accelerations.iter().map(|a| found.gravity(*a)).collect();
        (gravity, Some(found), GravityFrom::Accelerations)
    } else {
        return Err(no_motion(first));
    };
    let pose =
        |(sum, gravity_m_s2): (&Sum, Vector)| PayloadPose { wrench: sum.wrench, gravity_m_s2 };
    let fit = fit(&sums.iter().zip(gravity).map(pose).collect::<Vec<_>>())?;
    Ok(FittedPayload { fit, accelerometer, gravity_from, is_grouped, rows, skipped_rows })
}

/// What one of the accelerations at rest is, by their size.
fn unit_m_s2(log: &Log, accelerations: &[Vector], gravity_m_s2: f64) -> Result<f64, WorkflowError> {
    let mut sizes: Vec<f64> = accelerations.iter().map(|a| norm(*a)).collect();
    let size = upper_median(&mut sizes).unwrap_or_default();
    // Offsets of an accelerometer are within a tenth of what it measures.
    match size {
        0.8..1.2 => Ok(gravity_m_s2),
        8.0..12.0 => Ok(gravity_m_s2 / STANDARD_GRAVITY_M_S2),
        _ => Err(WorkflowError::refused(
            format!(
                "`{}`: accelerations at rest are `{size:.4}` long, neither m/s² nor multiples of g",
                log.path().display()
            ),
            "scale them to m/s², or give orientations besides: then any unit will do",
        )),
    }
}
