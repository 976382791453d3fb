//! Columns with the orientation of a sensor, as rotations and gravity in its frame.

use forces::payload::rotation::{
    from_quaternion, from_roll_pitch_yaw, from_rotation_vector, transposed,
};
use forces::payload::{Matrix, Vector, norm};
use shell_data::statistics::upper_median;

/// Relative tolerance for an orientation to be valid: logs have few digits.
const ROUGH: f64 = 0.02;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Orientation {
    /// Gravity in the sensor's frame, in m/s² or multiples of g.
    Gravity,
    /// Rotation matrix from the sensor's frame to a frame with z up, row by row.
    Matrix,
    /// Only the last row of that matrix.
    LastRow,
    /// The rotation as a quaternion x y z w.
    Quaternion,
    QuaternionWxyz,
    /// The rotation as a vector along its axis, with the angle as its length, rad.
    RotationVector,
    /// The rotation as roll, pitch and yaw, rad.
    RollPitchYaw,
    RollPitchYawDegrees,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Attitude {
    /// Gravity in the sensor's frame, m/s².
    pub(super) gravity: Vector,
    /// Rotation from the sensor's frame to one whose z is up, if known.
    pub(super) rotation: Option<Matrix>,
}

impl Orientation {
    pub const fn columns(self) -> usize {
        match self {
            Self::Matrix => 9,
            Self::Quaternion | Self::QuaternionWxyz => 4,
            _ => 3,
        }
    }

    /// The quaternion with its scalar at the other end.
    pub(super) fn other_order(self) -> Option<Self> {
        match self {
            Self::Quaternion => Some(Self::QuaternionWxyz),
            Self::QuaternionWxyz => Some(Self::Quaternion),
            _ => None,
        }
    }

    /// The orientation of the sensor in every row. The error is the first row that is no orientation, from 0,
    /// and the reason. `is_inverse` if rotations are to the sensor's frame.
    pub(super) fn attitudes(
        self,
        columns: &[Vec<f64>],
        gravity_m_s2: f64,
        is_inverse: bool,
    ) -> Result<Vec<Attitude>, (usize, String)> {
        let rows = columns[0].len();
        let vector = |row: usize, first: usize| -> Vector {
            std::array::from_fn(|axis| columns[first + axis][row])
        };
        let (mut expected, mut unit) = (1.0, gravity_m_s2);
        if self == Self::Gravity {
            let mut sizes: Vec<f64> = (0..rows).map(|row| norm(vector(row, 0))).collect();
            let median = upper_median(&mut sizes).unwrap_or_default();
            if (9.6..9.95).contains(&median) {
                (expected, unit) = (median, 1.0);
            }
        }
        let attitude = |row: usize| {
            let of = |size: f64, what: &str| {
                let is_near = (size / expected - 1.0).abs() <= ROUGH;
                let text = || format!("{what} `{size:.4}` long, expected {expected:.4}");
                if is_near { Ok(()) } else { Err((row, text())) }
            };
            let three = vector(row, 0);
            let rotation = match self {
                Self::Gravity => {
                    of(norm(three), "gravity is")?;
                    let gravity = three.map(|value| value * unit);
                    return Ok(Attitude { gravity, rotation: None });
                }
                Self::LastRow => {
                    of(norm(three), "the last row of the rotation matrix is")?;
                    return Ok(Attitude { gravity: down(three, gravity_m_s2), rotation: None });
                }
                Self::Matrix => {
                    let matrix = [0, 3, 6].map(|first| vector(row, first));
                    for line in matrix {
                        of(norm(line), "a row of the rotation matrix is")?;
                    }
                    matrix
                }
                Self::Quaternion | Self::QuaternionWxyz => {
                    let mut four: [f64; 4] = std::array::from_fn(|i| columns[i][row]);
                    if self == Self::QuaternionWxyz {
                        four.rotate_left(1);
                    }
                    of(four.iter().map(|q| q * q).sum::<f64>().sqrt(), "the quaternion is")?;
                    from_quaternion(four)
                }
                Self::RotationVector => from_rotation_vector(three),
                Self::RollPitchYaw => from_roll_pitch_yaw(three),
                Self::RollPitchYawDegrees => from_roll_pitch_yaw(three.map(f64::to_radians)),
            };
            let rotation = if is_inverse { transposed(&rotation) } else { rotation };
            let gravity = down(rotation[2], gravity_m_s2);
            Ok(Attitude { gravity, rotation: Some(rotation) })
        };
        (0..rows).map(attitude).collect()
    }
}

/// Gravity opposite to a direction. Few digits turn a direction a little, but must not make gravity weaker.
fn down(up: Vector, gravity_m_s2: f64) -> Vector {
    let size = norm(up);
    up.map(|value| -value * gravity_m_s2 / size)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gravity(of: Orientation, columns: &[&[f64]], m_s2: f64) -> Result<Vec<Vector>, usize> {
        let columns: Vec<Vec<f64>> = columns.iter().map(|column| column.to_vec()).collect();
        let found = of.attitudes(&columns, m_s2, false).map_err(|(row, _)| row)?;
        Ok(found.iter().map(|of| of.gravity).collect())
    }

    #[test]
    fn all_ways_to_write_a_rotation_say_the_same() {
        // Turned by 40° about x: gravity gets a component along the sensor's −y.
        let angle = 40_f64.to_radians();
        let ((s, c), (hs, hc)) = (angle.sin_cos(), (0.5 * angle).sin_cos());
        let expected = [0.0, -9.8 * s, -9.8 * c];
        for (of, values) in [
            (Orientation::LastRow, vec![0.0, s, c]),
            (Orientation::Matrix, vec![1.0, 0.0, 0.0, 0.0, c, -s, 0.0, s, c]),
            (Orientation::Quaternion, vec![hs, 0.0, 0.0, hc]),
            (Orientation::QuaternionWxyz, vec![hc, hs, 0.0, 0.0]),
            (Orientation::RotationVector, vec![angle, 0.0, 0.0]),
            (Orientation::RollPitchYaw, vec![angle, 0.0, 1.0]),
            (Orientation::RollPitchYawDegrees, vec![40.0, 0.0, -120.0]),
        ] {
            assert_eq!(values.len(), of.columns());
            let columns: Vec<Vec<f64>> = values.iter().map(|value| vec![*value]).collect();
            let found = of.attitudes(&columns, 9.8, false).unwrap()[0].gravity;
            for (found, expected) in found.iter().zip(expected) {
                assert!((found - expected).abs() < 1e-14, "{of:?}: {found} {expected}");
            }
        }
    }

    #[test]
    fn rates_of_turn_are_no_gravity() {
        let of = Orientation::Gravity;
        let turning = [&[0.1, 3.0, -2.0][..], &[0.0, 1.0, 0.5], &[0.0, 0.0, 0.5]];
        assert_eq!(gravity(of, &turning, 9.81), Err(0));
        let in_g = gravity(of, &[&[0.0, 1.0][..], &[0.0, 0.0], &[1.0, 0.0]], 9.81).unwrap();
        assert_eq!(in_g[0], [0.0, 0.0, 9.81]);
        let local = gravity(of, &[&[0.0, -9.82][..], &[9.82, 0.0], &[0.0, 0.0]], 9.81).unwrap();
        assert_eq!(local[1], [-9.82, 0.0, 0.0]);
    }
}
