//! Columns of a log with the orientation and the motion of a sensor.

use super::orientation::{Attitude, Orientation};
use crate::workflow::WorkflowError;
use forces::payload::{STANDARD_GRAVITY_M_S2, Vector};
use log_file::{ColumnRef, Log, Wanted};

const NAME_COLUMNS: &str = "name the columns with `--orientation` or `--accelerations`, in a run those of another log \
                            with `--motion`";

#[derive(Clone, Debug, PartialEq)]
pub struct MotionColumns {
    /// Columns of orientation. `None` for columns with usual names.
    pub orientation: Option<Vec<ColumnRef>>,
    /// Kind of the orientation columns. `None` to infer it from their names and number: three of gravity, four of
    /// a quaternion (x y z w), nine of a rotation matrix, row by row.
    pub orientation_as: Option<Orientation>,
    /// True if rotations are to the sensor's frame instead of from it.
    pub is_inverse: bool,
    /// Accelerations along x, y, z. `None` for columns with usual names.
    pub accelerations: Option<Vec<ColumnRef>>,
    /// Angular velocity about x, y, z. `None` for columns with usual names.
    pub angular_velocity: Option<Vec<ColumnRef>>,
    pub gravity_m_s2: f64,
}

impl Default for MotionColumns {
    fn default() -> Self {
        Self {
            orientation: None,
            orientation_as: None,
            is_inverse: false,
            accelerations: None,
            angular_velocity: None,
            gravity_m_s2: STANDARD_GRAVITY_M_S2,
        }
    }
}

/// Columns of a log, by position from 0.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FoundColumns {
    /// Candidates, in the order in which they are tried.
    orientations: Vec<(Orientation, Vec<usize>)>,
    is_named: bool,
    accelerations: Option<Vec<usize>>,
    angular_velocity: Option<Vec<usize>>,
    /// Unit of the angular velocity columns, rad/s.
    rate_unit: f64,
}

/// Usual names of columns, for each kind in search order.
const USUAL_ORIENTATIONS: [(Orientation, &[&[&str]]); 6] = [
    (Orientation::Gravity, &[&["gx", "gy", "gz"], &["gravity_x", "gravity_y", "gravity_z"]]),
    (Orientation::Matrix, &[&["r11", "r12", "r13", "r21", "r22", "r23", "r31", "r32", "r33"]]),
    (Orientation::LastRow, &[&["r31", "r32", "r33"]]),
    (
        Orientation::Quaternion,
        &[
            &["qx", "qy", "qz", "qw"],
            &["orientation.x", "orientation.y", "orientation.z", "orientation.w"],
        ],
    ),
    (Orientation::RotationVector, &[&["rx", "ry", "rz"], &["rotvec_x", "rotvec_y", "rotvec_z"]]),
    (Orientation::RollPitchYaw, &[&["roll", "pitch", "yaw"]]),
];
const USUAL_ACCELERATIONS: [&[&str]; 4] = [
    &["ax", "ay", "az"],
    &["acc_x", "acc_y", "acc_z"],
    &["accel_x", "accel_y", "accel_z"],
    &["linear_acceleration.x", "linear_acceleration.y", "linear_acceleration.z"],
];
const USUAL_RATES: [&[&str]; 5] = [
    &["wx", "wy", "wz"],
    &["gyro_x", "gyro_y", "gyro_z"],
    &["gyr_x", "gyr_y", "gyr_z"],
    &["omega_x", "omega_y", "omega_z"],
    &["angular_velocity.x", "angular_velocity.y", "angular_velocity.z"],
];
/// Units after a name, without punctuation.
const UNITS: [&str; 9] = ["", "ms2", "g", "rad", "deg", "degrees", "rads", "degs", "dps"];

impl MotionColumns {
    pub(super) fn find(&self, log: &Log) -> Result<FoundColumns, WorkflowError> {
        let by_name = |names: &[&[&str]]| names.iter().find_map(|names| positions(log, names));
        let mut orientations: Vec<(Orientation, Vec<usize>)> = match &self.orientation {
            Some(references) => {
                let at = log.column_positions(references)?;
                vec![(self.kind(log, &at)?, at)]
            }
            None => {
                let found = |(of, names)| Some((of, by_name(names)?));
                let wanted =
                    |(of, _): &(Orientation, _)| self.orientation_as.is_none_or(|it| it == *of);
                USUAL_ORIENTATIONS.into_iter().filter_map(found).filter(wanted).collect()
            }
        };
        for (of, at) in &mut orientations {
            if *of == Orientation::RollPitchYaw && unit(log, at) == Some(DEGREE) {
                *of = Orientation::RollPitchYawDegrees;
            }
        }
        let three = |references: &Option<Vec<ColumnRef>>, usual: &[&[&str]], what: &str| {
            let Some(references) = references else { return Ok(by_name(usual)) };
            match log.column_positions(references)? {
                at if at.len() == 3 => Ok(Some(at)),
                at => {
                    let message = format!("`{}` columns of {what}, expected 3", at.len());
                    Err(WorkflowError::refused(message, NAME_COLUMNS))
                }
            }
        };
        let accelerations = three(&self.accelerations, &USUAL_ACCELERATIONS, "acceleration")?;
        let angular_velocity = three(&self.angular_velocity, &USUAL_RATES, "angular velocity")?;
        let rate_unit = angular_velocity.as_ref().and_then(|at| unit(log, at)).unwrap_or(1.0);
        let is_named = self.orientation.is_some();
        let found =
            FoundColumns { orientations, is_named, accelerations, angular_velocity, rate_unit };
        if found.orientations.is_empty() && found.accelerations.is_none() {
            return Err(no_motion(log));
        }
        log.require(&Wanted { others: found.positions(), ..Wanted::default() })?;
        Ok(found)
    }

    /// The kind of the orientation columns that the user named.
    fn kind(&self, log: &Log, at: &[usize]) -> Result<Orientation, WorkflowError> {
        let is_named = |(_, names): &(Orientation, &[&[&str]])| {
            names.iter().any(|names| positions(log, names).as_deref() == Some(at))
        };
        let by_name = || USUAL_ORIENTATIONS.iter().find(|of| is_named(of)).map(|(of, _)| *of);
        let by_number = || match at.len() {
            3 => Some(Orientation::Gravity),
            4 => Some(Orientation::Quaternion),
            9 => Some(Orientation::Matrix),
            _ => None,
        };
        let kind = self.orientation_as.or_else(by_name).or_else(by_number);
        kind.filter(|kind| kind.columns() == at.len()).ok_or_else(|| {
            let message = format!(
                "`{}` columns of orientation, expected 3 (gravity), 4 (quaternion x y z w) or 9 (rotation matrix, row \
                 by row)",
                at.len()
            );
            WorkflowError::refused(message, NAME_COLUMNS)
        })
    }
}

impl FoundColumns {
    /// All positions, to be [read](Wanted::others); the columns read have this order.
    pub(super) fn positions(&self) -> Vec<usize> {
        let orientations = self.orientations.iter().map(|(_, at)| at);
        let all = orientations.chain(&self.accelerations).chain(&self.angular_velocity);
        all.flatten().copied().collect()
    }

    /// The orientation of the sensor in every row, from the first columns that give it; `None` if there are
    /// none. `columns` are the values at [`Self::positions`]. `way` selects an alternative interpretation:
    /// the inverse rotation, and for quaternions the scalar at the other end.
    pub(super) fn attitudes(
        &self,
        log: &Log,
        columns: &[Vec<f64>],
        rule: &MotionColumns,
        (is_turned, is_reordered): (bool, bool),
    ) -> Result<Option<Vec<Attitude>>, WorkflowError> {
        let mut first = 0;
        for &(mut of, ref at) in &self.orientations {
            let columns = &columns[first..first + at.len()];
            first += at.len();
            if is_reordered {
                let Some(other) = of.other_order() else { return Ok(None) };
                of = other;
            }
            let angles = || columns.iter().flatten().map(|angle| angle.abs()).fold(0.0, f64::max);
            if of == Orientation::RollPitchYaw
                && rule.orientation_as.is_none()
                && unit(log, at).is_none()
            {
                // Angles beyond a full turn cannot be radians; smaller ones may be either.
                if angles() <= std::f64::consts::TAU {
                    let message = format!(
                        "`{}`: roll, pitch and yaw have no unit in their names",
                        log.path().display()
                    );
                    let hint = "say `--orientation-as rpy-deg` or `--orientation-as rpy-rad`";
                    return Err(WorkflowError::refused(message, hint));
                }
                of = Orientation::RollPitchYawDegrees;
            }
            match of.attitudes(columns, rule.gravity_m_s2, rule.is_inverse != is_turned) {
                Ok(attitudes) => return Ok(Some(attitudes)),
                // Angular rates have the same names as gravity.
                Err(_) if of == Orientation::Gravity && !self.is_named => {}
                Err((row, what)) => return Err(no_orientation(log, row, &what)),
            }
        }
        Ok(None)
    }

    /// Accelerations of every row, in the unit of the log, from the columns of [`Self::positions`].
    pub(super) fn accelerations(&self, columns: &[Vec<f64>]) -> Option<Vec<Vector>> {
        self.accelerations.as_ref()?;
        let rates = self.angular_velocity.as_ref().map_or(0, Vec::len);
        vectors(&columns[..columns.len() - rates], 1.0)
    }

    /// Angular velocity of every row, rad/s, from the columns of [`Self::positions`].
    pub(super) fn angular_velocity(&self, columns: &[Vec<f64>]) -> Option<Vec<Vector>> {
        self.angular_velocity.as_ref()?;
        vectors(columns, self.rate_unit)
    }
}

fn vectors(columns: &[Vec<f64>], unit: f64) -> Option<Vec<Vector>> {
    let [x, y, z] = columns.last_chunk::<3>()?;
    Some(x.iter().zip(y).zip(z).map(|((x, y), z)| [*x, *y, *z].map(|v| unit * v)).collect())
}

pub(super) fn no_motion(log: &Log) -> WorkflowError {
    let message = format!(
        "`{}` has no columns of orientation (`gx gy gz` of gravity, `r11` … `r33`, `qx qy qz qw`, `rx ry rz`) or \
         acceleration (`ax ay az`)",
        log.path().display()
    );
    WorkflowError::refused(message, NAME_COLUMNS)
}

/// Error for a row, counted from 0, whose values are not a rotation or direction.
pub(super) fn no_orientation(log: &Log, row: usize, what: &str) -> WorkflowError {
    let message = format!("`{}`, data row {}: {what}", log.path().display(), row + 1);
    let hint = "correct the row, name the right columns with `--orientation`, or say what they are with \
                `--orientation-as`";
    WorkflowError::refused(message, hint)
}

const DEGREE: f64 = std::f64::consts::PI / 180.0;

/// Unit of the angles in these columns, rad, if all names state it.
fn unit(log: &Log, at: &[usize]) -> Option<f64> {
    let of = |at: &usize| {
        let name = log.columns()[*at].name.to_lowercase();
        let has = |words: &[&str]| words.iter().any(|word| name.contains(word));
        match (has(&["deg", "°", "dps"]), has(&["rad"])) {
            (true, false) => Some(DEGREE),
            (false, true) => Some(1.0),
            _ => None,
        }
    };
    let first = of(at.first()?)?;
    at.iter().all(|at| of(at) == Some(first)).then_some(first)
}

/// The positions of columns with these names, ignoring case, spaces, punctuation, and a trailing unit; `None`
/// unless all are found.
fn positions(log: &Log, names: &[&str]) -> Option<Vec<usize>> {
    let plain = |name: &str| -> String {
        let name = name.split(['(', '[']).next().unwrap_or(name);
        name.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
    };
    let columns: Vec<String> = log.columns().iter().map(|column| plain(&column.name)).collect();
    let position = |name: &&str| {
        let name = plain(name);
        columns.iter().position(|column| {
            column.strip_prefix(name.as_str()).is_some_and(|rest| UNITS.contains(&rest))
        })
    };
    names.iter().map(position).collect()
}
