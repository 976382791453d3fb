//! The columns of a log that say how a sensor lies and moves.

use forces::payload::{STANDARD_GRAVITY_M_S2, Vector, norm};
use log_file::{ColumnRef, Log, Wanted};
use shell_data::statistics::upper_median;

use crate::workflow::WorkflowError;

/// How far an orientation may be from one, as a share: logs have few digits.
const ROUGH: f64 = 0.02;

const NAME_COLUMNS: &str = "name the columns with `--orientation` or `--accelerations`, in a run those of another log \
                            with `--motion`";

/// What the user says of the columns of orientation and acceleration.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionColumns {
    /// Three columns of gravity, four of a quaternion (x y z w) or nine of a rotation matrix, row by row; from
    /// the sensor's frame to one whose z is up. `None` for those with usual names.
    pub orientation: Option<Vec<ColumnRef>>,
    /// Accelerations along x, y, z. `None` for those with usual names.
    pub accelerations: Option<Vec<ColumnRef>>,
    /// Gravity, m/s².
    pub gravity_m_s2: f64,
}

impl Default for MotionColumns {
    fn default() -> Self {
        Self { orientation: None, accelerations: None, gravity_m_s2: STANDARD_GRAVITY_M_S2 }
    }
}

/// Columns of a log, by position from 0.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FoundColumns {
    /// In the order in which they are tried.
    orientations: Vec<(Orientation, Vec<usize>)>,
    /// Whether the user named them.
    is_named: bool,
    accelerations: Option<Vec<usize>>,
}

/// What tells how a sensor lies.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Orientation {
    /// Gravity in the sensor's frame, in m/s² or multiples of g.
    Gravity,
    /// The rotation from the sensor's frame to one whose z is up: the last row of its matrix.
    LastRow,
    /// The same as a quaternion x y z w.
    Quaternion,
}

/// Usual names of columns, for each kind in the order in which they are looked for.
const USUAL_ORIENTATIONS: [(Orientation, &[&[&str]]); 3] = [
    (Orientation::Gravity, &[&["gx", "gy", "gz"], &["gravity_x", "gravity_y", "gravity_z"]]),
    (Orientation::LastRow, &[&["r31", "r32", "r33"]]),
    (
        Orientation::Quaternion,
        &[
            &["qx", "qy", "qz", "qw"],
            &["orientation.x", "orientation.y", "orientation.z", "orientation.w"],
        ],
    ),
];
const USUAL_ACCELERATIONS: [&[&str]; 4] = [
    &["ax", "ay", "az"],
    &["acc_x", "acc_y", "acc_z"],
    &["accel_x", "accel_y", "accel_z"],
    &["linear_acceleration.x", "linear_acceleration.y", "linear_acceleration.z"],
];

impl MotionColumns {
    /// The columns of a log.
    pub(super) fn find(&self, log: &Log) -> Result<FoundColumns, WorkflowError> {
        let by_name = |names: &[&[&str]]| names.iter().find_map(|names| positions(log, names));
        let orientations = match &self.orientation {
            Some(references) => {
                let at = log.column_positions(references)?;
                vec![match at.len() {
                    3 => (Orientation::Gravity, at),
                    4 => (Orientation::Quaternion, at),
                    9 => (Orientation::LastRow, at[6..].to_vec()),
                    found => {
                        let message = format!(
                            "`{found}` columns of orientation, expected 3 (gravity), 4 (quaternion x y z w) or 9 \
                             (rotation matrix, row by row)"
                        );
                        return Err(WorkflowError::refused(message, NAME_COLUMNS));
                    }
                }]
            }
            None => {
                let found = |(of, names)| Some((of, by_name(names)?));
                USUAL_ORIENTATIONS.into_iter().filter_map(found).collect()
            }
        };
        let accelerations = match &self.accelerations {
            Some(references) => match log.column_positions(references)? {
                at if at.len() == 3 => Some(at),
                at => {
                    let message = format!("`{}` columns of acceleration, expected 3", at.len());
                    return Err(WorkflowError::refused(message, NAME_COLUMNS));
                }
            },
            None => by_name(&USUAL_ACCELERATIONS),
        };
        let is_named = self.orientation.is_some();
        let found = FoundColumns { orientations, is_named, accelerations };
        if found.orientations.is_empty() && found.accelerations.is_none() {
            return Err(no_motion(log));
        }
        log.require(&Wanted { others: found.positions(), ..Wanted::default() })?;
        Ok(found)
    }
}

impl FoundColumns {
    /// All positions, to be [read](Wanted::others); and what is then at which position of a row.
    pub(super) fn positions(&self) -> Vec<usize> {
        let orientations = self.orientations.iter().map(|(_, at)| at);
        orientations.chain(&self.accelerations).flatten().copied().collect()
    }

    /// Gravity in the sensor's frame of every row, m/s², from the first of the columns that hold it; `None`
    /// where there are none. `columns` are those of [`Self::positions`].
    pub(super) fn gravity(
        &self,
        log: &Log,
        columns: &[Vec<f64>],
        gravity_m_s2: f64,
    ) -> Result<Option<Vec<Vector>>, WorkflowError> {
        let mut first = 0;
        for (orientation, at) in &self.orientations {
            let columns = &columns[first..first + at.len()];
            first += at.len();
            match orientation.gravity(columns, gravity_m_s2) {
                Ok(gravity) => return Ok(Some(gravity)),
                // Rates of turn go by the names of gravity, too.
                Err(_) if *orientation == Orientation::Gravity && !self.is_named => {}
                Err((row, what)) => return Err(no_orientation(log, row, &what)),
            }
        }
        Ok(None)
    }

    /// Accelerations of every row as they stand, likewise.
    pub(super) fn accelerations(&self, columns: &[Vec<f64>]) -> Option<Vec<Vector>> {
        self.accelerations.as_ref()?;
        let [x, y, z] = columns.last_chunk::<3>()?;
        Some(x.iter().zip(y).zip(z).map(|((x, y), z)| [*x, *y, *z]).collect())
    }
}

impl Orientation {
    /// Gravity of every row, m/s²; or the first row that is no orientation, from 0, and why.
    fn gravity(
        self,
        columns: &[Vec<f64>],
        gravity_m_s2: f64,
    ) -> Result<Vec<Vector>, (usize, String)> {
        let rows = columns[0].len();
        // Few digits turn a direction a little, and must not make gravity weaker.
        let down = |up: Vector| {
            let size = norm(up);
            up.map(|value| -value * gravity_m_s2 / size)
        };
        let vector = |row: usize| -> Vector { std::array::from_fn(|axis| columns[axis][row]) };
        let (mut expected, mut unit) = (1.0, gravity_m_s2);
        if self == Self::Gravity {
            let mut sizes: Vec<f64> = (0..rows).map(|row| norm(vector(row))).collect();
            let median = upper_median(&mut sizes).unwrap_or_default();
            if (9.6..9.95).contains(&median) {
                (expected, unit) = (median, 1.0);
            }
        }
        let gravity = |row: usize| {
            let (what, size, gravity) = match self {
                Self::Gravity => {
                    ("gravity is", norm(vector(row)), vector(row).map(|value| value * unit))
                }
                Self::LastRow => {
                    let what = "the last row of the rotation matrix is";
                    (what, norm(vector(row)), down(vector(row)))
                }
                Self::Quaternion => {
                    let [x, y, z, w]: [f64; 4] = std::array::from_fn(|i| columns[i][row]);
                    let square = x * x + y * y + z * z + w * w;
                    let (x_up, y_up) = (2.0 * (x * z - w * y), 2.0 * (y * z + w * x));
                    let up = [x_up, y_up, square - 2.0 * (x * x + y * y)];
                    ("the quaternion is", square.sqrt(), down(up))
                }
            };
            let is_near = (size / expected - 1.0).abs() <= ROUGH;
            let text = || format!("{what} `{size:.4}` long, expected {expected:.4}");
            if is_near { Ok(gravity) } else { Err((row, text())) }
        };
        (0..rows).map(gravity).collect()
    }
}

/// A log that does not say how the sensor lies.
pub(super) fn no_motion(log: &Log) -> WorkflowError {
    let message = format!(
        "`{}` has no columns of orientation (`gx gy gz` of gravity, `r11` … `r33`, `qx qy qz qw`) or acceleration \
         (`ax ay az`)",
        log.path().display()
    );
    WorkflowError::refused(message, NAME_COLUMNS)
}

/// A row, counted from 0, whose values are no rotation or direction.
pub(super) fn no_orientation(log: &Log, row: usize, what: &str) -> WorkflowError {
    let message = format!("`{}`, data row {}: {what}", log.path().display(), row + 1);
    let hint = "correct the row, or name the right columns with `--orientation`";
    WorkflowError::refused(message, hint)
}

/// The positions of columns with these names, without regard to case, spaces and punctuation, and with a unit
/// after them; all or `None`.
fn positions(log: &Log, names: &[&str]) -> Option<Vec<usize>> {
    let plain = |name: &str| -> String {
        let name = name.split(['(', '[']).next().unwrap_or(name);
        name.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
    };
    let columns: Vec<String> = log.columns().iter().map(|column| plain(&column.name)).collect();
    let position = |name: &&str| {
        let name = plain(name);
        columns.iter().position(|column| {
            column.strip_prefix(name.as_str()).is_some_and(|rest| ["", "ms2", "g"].contains(&rest))
        })
    };
    names.iter().map(position).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn column(values: &[f64]) -> Vec<f64> {
        values.to_vec()
    }

    #[test]
    fn a_matrix_and_a_quaternion_say_the_same() {
        // Turned by 40° about x: gravity gets a part along −y of the sensor.
        let (s, c) = 40_f64.to_radians().sin_cos();
        let matrix = Orientation::LastRow;
        let matrix = matrix.gravity(&[column(&[0.0]), column(&[s]), column(&[c])], 9.8).unwrap();
        let (hs, hc) = 20_f64.to_radians().sin_cos();
        let quaternion = [hs, 0.0, 0.0, hc].map(|value| vec![value]);
        let quaternion = Orientation::Quaternion.gravity(&quaternion, 9.8).unwrap();
        for axis in 0..3 {
            let expected = [0.0, -9.8 * s, -9.8 * c][axis];
            assert!((matrix[0][axis] - expected).abs() < 1e-14);
            assert!((quaternion[0][axis] - expected).abs() < 1e-14);
        }
    }

    #[test]
    fn rates_of_turn_are_no_gravity() {
        let gravity = Orientation::Gravity;
        let of = |rows: [[f64; 3]; 3]| {
            let columns: [Vec<f64>; 3] =
                std::array::from_fn(|axis| rows.map(|row| row[axis]).to_vec());
            gravity.gravity(&columns, 9.81)
        };
        let turning = of([[0.1, 0.0, 0.0], [3.0, 1.0, 0.0], [-2.0, 0.5, 0.5]]);
        assert!(turning.is_err());
        let in_g = of([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]).unwrap();
        assert_eq!(in_g[0], [0.0, 0.0, 9.81]);
        let local = of([[0.0, 0.0, 9.82], [0.0, 9.82, 0.0], [-9.82, 0.0, 0.0]]).unwrap();
        assert_eq!(local[2], [-9.82, 0.0, 0.0]);
    }
}
