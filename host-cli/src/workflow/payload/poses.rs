//! Poses at rest from logs, and the payload that they determine.

use std::collections::HashMap;

use super::columns::{MotionColumns, no_motion};
use super::orientation::Attitude;
use crate::workflow::WorkflowError;
use forces::payload::rotation::transposed;
use forces::payload::{
    Accelerometer, LeftOver, MomentDoubt, PayloadError, PayloadFit, PayloadPose,
    STANDARD_GRAVITY_M_S2, Vector, fit, frame_from_forces, moment_doubt, norm, times,
};
use log_file::{Log, ReadOptions, Wanted};
use shell_data::statistics::upper_median;
use shell_data::wrench::{Axes, PerAxis};

#[derive(Clone, Debug, PartialEq)]
pub struct FittedPayload {
    pub fit: PayloadFit,
    pub accelerometer: Option<Accelerometer>,
    pub gravity_from: GravityFrom,
    /// True if accelerations at rest point along gravity instead of against it.
    pub is_reaction: bool,
    pub forces_left: LeftOver,
    pub moment_doubt: Option<MomentDoubt>,
    /// Residual of the moments, N·m, interpreted as moments in the frame whose z is up, if that fits better.
    pub moments_upright_nm: Option<f64>,
    /// True if rows were combined into poses by labels.
    pub is_grouped: bool,
    pub rows: Vec<u64>,
    /// Number of invalid rows that were left out of all logs.
    pub skipped_rows: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum GravityFrom {
    Orientation,
    Accelerations,
}

#[derive(Clone, Copy, Default)]
struct Sum {
    rows: f64,
    wrench: PerAxis<f64>,
    acceleration: Vector,
    /// Gravity by each interpretation of [`WAYS`].
    gravity: [Vector; WAYS.len()],
    /// Moments rotated from the frame whose z is up into the sensor's frame.
    turned: Vector,
}

/// Interpretations of columns of orientation ([`FoundColumns::attitudes`](super::columns::FoundColumns)), in
/// words and as an option. The first is the requested one.
const WAYS: [((bool, bool), &str, &str); 4] = [
    ((false, false), "", ""),
    ((true, false), "the inverse rotation", "`--inverse-orientation`"),
    ((false, true), "the quaternion with w at the other end", "`--orientation-as`"),
    (
        (true, true),
        "the inverse of the quaternion with w at the other end",
        "`--orientation-as` and `--inverse-orientation`",
    ),
];

impl Sum {
    fn add(&mut self, row: Self) {
        // In a running mean, only the differences between rows are rounded, not the part that all share.
        self.rows += 1.0;
        let share = 1.0 / self.rows;
        let pairs = self.wrench.iter_mut().zip(row.wrench);
        let pairs =
            pairs.chain(self.gravity.as_flattened_mut().iter_mut().zip(row.gravity.concat()));
        let pairs = pairs.chain(self.acceleration.iter_mut().zip(row.acceleration));
        let pairs = pairs.chain(self.turned.iter_mut().zip(row.turned));
        pairs.for_each(|(mean, value)| *mean += (value - *mean) * share);
    }
}

/// Fits the payload of a sensor to logs of poses at rest. A pose is the rows with one label of the group
/// column, or each single row.
pub fn fit_payload(
    logs: &[Log],
    columns: &MotionColumns,
    read: &ReadOptions<'_>,
) -> Result<FittedPayload, WorkflowError> {
    let first = logs.first().ok_or(WorkflowError::NoLogs)?;
    let is_grouped = logs.iter().all(Log::has_groups);
    // Poses in the order of their first row.
    let (mut sums, mut by_label) = (Vec::<Sum>::new(), HashMap::new());
    let (mut ways, mut all_have_accelerations) = ([true; WAYS.len()], true);
    let mut all_turn = true;
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
        let by_way = |way| found.attitudes(log, &block.others, columns, way);
        let attitudes: Vec<Option<Vec<Attitude>>> =
            WAYS.iter().map(|(way, ..)| by_way(*way)).collect::<Result<_, _>>()?;
        let accelerations = found.accelerations(&block.others);
        if attitudes[0].is_none() && accelerations.is_none() {
            return Err(no_motion(log));
        }
        ways.iter_mut().zip(&attitudes).for_each(|(all, of)| *all &= of.is_some());
        all_have_accelerations &= accelerations.is_some();
        let labels = block.groups.iter();
        let labels = labels.flat_map(|(label, rows)| std::iter::repeat_n(Some(label), *rows));
        for (row, label) in (0..block.rows).zip(labels.chain(std::iter::repeat(None))) {
            let attitude = |way: usize| attitudes[way].as_ref().map(|all| all[row]);
            let wrench: PerAxis<f64> = std::array::from_fn(|axis| block.wrench[axis][row]);
            let rotation = attitude(0).and_then(|of| of.rotation);
            all_turn &= rotation.is_some();
            let moments = [wrench[3], wrench[4], wrench[5]];
            let of_row = Sum {
                rows: 1.0,
                wrench,
                acceleration: accelerations.as_ref().map_or([0.0; 3], |all| all[row]),
                gravity: std::array::from_fn(|way| attitude(way).map_or([0.0; 3], |of| of.gravity)),
                turned: rotation.map_or(moments, |of| times(&transposed(&of), moments)),
            };
            let next = sums.len();
            let pose = label.map_or(next, |label| *by_label.entry(label.clone()).or_insert(next));
            sums.resize(next.max(pose + 1), Sum::default());
            sums[pose].add(of_row);
        }
    }
    let accelerations: Vec<Vector> = sums.iter().map(|sum| sum.acceleration).collect();
    let mut is_reaction = false;
    let (gravity, accelerometer, gravity_from) = if ways[0] {
        check_way(first, &sums, ways)?;
        let gravity: Vec<Vector> = sums.iter().map(|sum| sum.gravity[0]).collect();
        let accelerometer =
            all_have_accelerations.then(|| Accelerometer::fit(&accelerations, &gravity)).flatten();
        (gravity, accelerometer, GravityFrom::Orientation)
    } else if all_have_accelerations {
        let forces: Vec<Vector> =
            sums.iter().map(|sum| [sum.wrench[0], sum.wrench[1], sum.wrench[2]]).collect();
        let unit = unit_m_s2(first, &accelerations, columns.gravity_m_s2)?;
        // An accelerometer measures the reaction to gravity. In logs that contain it, the sign is opposite.
        let by_sign = |unit: f64| -> Result<_, PayloadError> {
            let found = frame_from_forces(&accelerations, &forces, unit)?;
            let gravity: Vec<Vector> = accelerations.iter().map(|a| found.gravity(*a)).collect();
            let poses = poses_in(&sums, gravity.iter().copied());
            let left = fit(&poses).map_or(f64::INFINITY, |fit| fit.residual_rms_n);
            Ok((left, gravity, found))
        };
        let (usual, other) = (by_sign(unit)?, by_sign(-unit)?);
        is_reaction = other.0 < HALF * usual.0;
        let (_, gravity, found) = if is_reaction { other } else { usual };
        (gravity, Some(found), GravityFrom::Accelerations)
    } else {
        return Err(no_motion(first));
    };
    let poses = poses_in(&sums, gravity.into_iter());
    let found = fit(&poses)?;
    let moment_doubt = moment_doubt(&found, &poses);
    let moments_upright_nm = moment_doubt.filter(|_| all_turn && ways[0]).and_then(|doubt| {
        let turned = |(pose, sum): (&PayloadPose, &Sum)| {
            let mut wrench = pose.wrench;
            wrench[3..].copy_from_slice(&sum.turned);
            PayloadPose { wrench, ..*pose }
        };
        let turned: Vec<PayloadPose> = poses.iter().zip(&sums).map(turned).collect();
        let left = fit(&turned).ok()?.residual_rms_nm;
        doubt.left.is_cured_by(left).then_some(left)
    });
    let forces_left = LeftOver::of_forces(&found, &poses);
    Ok(FittedPayload {
        fit: found,
        accelerometer,
        gravity_from,
        is_reaction,
        forces_left,
        moment_doubt,
        moments_upright_nm,
        is_grouped,
        rows,
        skipped_rows,
    })
}

/// The reversed sign of accelerations is chosen if its residual is below this share of the usual sign's.
const HALF: f64 = 0.5;

fn poses_in(sums: &[Sum], gravity: impl Iterator<Item = Vector>) -> Vec<PayloadPose> {
    let pose =
        |(sum, gravity_m_s2): (&Sum, Vector)| PayloadPose { wrench: sum.wrench, gravity_m_s2 };
    sums.iter().zip(gravity).map(pose).collect()
}

/// Refuses orientations if another interpretation lets the forces follow gravity far better.
fn check_way(log: &Log, sums: &[Sum], known: [bool; WAYS.len()]) -> Result<(), WorkflowError> {
    let poses = |way: usize| poses_in(sums, sums.iter().map(|sum| sum.gravity[way]));
    let asked = fit(&poses(0));
    let (scatter, left) = match &asked {
        Ok(fit) => (fit.payload.mass_kg * fit.gravity_m_s2, LeftOver::of_forces(fit, &poses(0))),
        Err(PayloadError::NoMass { .. }) => (0.0, LeftOver { rms: f64::INFINITY, scatter: 1.0 }),
        Err(_) => return Ok(()),
    };
    if !left.is_suspected() {
        return Ok(());
    }
    let of = |way: usize| Some((way, fit(&poses(way)).ok()?.residual_rms_n));
    let others = (1..WAYS.len()).filter(|&way| known[way]).filter_map(of);
    let Some((way, rms)) = others.min_by(|(_, a), (_, b)| a.total_cmp(b)) else { return Ok(()) };
    if !left.is_cured_by(rms) {
        return Ok(());
    }
    let path = log.path().display();
    let message = match asked {
        Ok(_) => format!(
            "`{path}`: forces do not follow gravity: {:.4} N (RMS) of a weight of {scatter:.4} N are left over",
            left.rms
        ),
        Err(_) => format!("`{path}`: forces do not follow gravity"),
    };
    let (_, words, option) = WAYS[way];
    let hint = format!("{words} leaves {rms:.4} N: say so with {option}");
    Err(WorkflowError::refused(message, &*hint))
}

/// Unit of accelerations at rest, derived from their magnitude.
fn unit_m_s2(log: &Log, accelerations: &[Vector], gravity_m_s2: f64) -> Result<f64, WorkflowError> {
    let mut sizes: Vec<f64> = accelerations.iter().map(|a| norm(*a)).collect();
    let size = upper_median(&mut sizes).unwrap_or_default();
    // Offsets of an accelerometer are within a tenth of gravity.
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
