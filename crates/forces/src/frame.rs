//! Wrenches in another frame: about another origin, and along rotated, mirrored or exchanged axes.
//!
//! With the axes of the new frame as rows of `P` and its origin at d, both in the old frame,
//!
//! ```text
//! F' = P·F        M' = det(P)·P·(M − d × F)
//! ```
//!
//! (moments are axial vectors: a mirror flips their sign once more).

use std::str::FromStr;

use super::payload::rotation::{from_rotation_vector, transposed};
use super::payload::{Matrix, Vector, times};
use shell_data::hint::Hint;
use shell_data::wrench::{Axes, Axis, PerAxis, cross};

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameChange {
    /// The new origin in the old frame, m.
    origin_m: Vector,
    /// The new axes in the old frame, row by row; orthonormal.
    axes: Matrix,
    /// 1, or −1 for a mirror.
    determinant: f64,
}

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is no frame")]
pub struct NoFrameChange(String);

impl Hint for NoFrameChange {
    fn hint(&self) -> Option<String> {
        Some(
            "origin in m and rotations about x, y, z in degrees (`0,0,0.05,0,0,90`), or axes (`y,x,-z`)"
                .to_owned(),
        )
    }
}

impl FrameChange {
    /// Creates a frame at `origin_m`, rotated by three angles, rad, about its x axis, then the resulting y axis, then
    /// the resulting z axis, as ATI's tool transform.
    pub fn new(origin_m: Vector, angles: Vector) -> Self {
        let about = |axis: usize| {
            let mut vector = [0.0; 3];
            vector[axis] = angles[axis];
            from_rotation_vector(vector)
        };
        // The columns of Rx·Ry·Rz are the new axes.
        let turned = |matrix: &Matrix, by: Matrix| -> Matrix {
            let columns = transposed(&by).map(|column| times(matrix, column));
            transposed(&columns)
        };
        let columns = turned(&turned(&about(0), about(1)), about(2));
        Self { origin_m, axes: transposed(&columns), determinant: 1.0 }
    }

    /// Creates a frame whose x, y and z are axes of the old frame, by index and sign; `None` if an old axis is missing.
    pub fn from_axes(axes: [(usize, f64); 3]) -> Option<Self> {
        let mut matrix = Matrix::default();
        for (row, (axis, sign)) in matrix.iter_mut().zip(axes) {
            *row.get_mut(axis)? = sign;
        }
        let [x, y, z] = matrix;
        let determinant = x.iter().zip(cross(y, z)).map(|(a, b)| a * b).sum::<f64>();
        (determinant != 0.0).then_some(Self { origin_m: [0.0; 3], axes: matrix, determinant })
    }

    pub fn wrench(&self, [fx, fy, fz, mx, my, mz]: PerAxis<f64>) -> PerAxis<f64> {
        let force = [fx, fy, fz];
        let lever = cross(self.origin_m, force);
        let [x, y, z] = times(&self.axes, force);
        let moment = [mx - lever[0], my - lever[1], mz - lever[2]];
        let [mx, my, mz] = times(&self.axes, moment).map(|value| self.determinant * value);
        [x, y, z, mx, my, mz]
    }

    pub fn apply(&self, wrench: &mut PerAxis<Vec<f64>>) {
        for row in 0..wrench[0].len() {
            let changed = self.wrench(wrench.each_ref().map(|column| column[row]));
            wrench.iter_mut().zip(changed).for_each(|(column, value)| column[row] = value);
        }
    }

    /// Transforms standard errors, as if the errors of the old axes were independent.
    pub fn apply_to_errors(&self, errors: &mut PerAxis<Vec<f64>>) {
        let columns: PerAxis<PerAxis<f64>> = std::array::from_fn(|axis| {
            let mut unit = PerAxis::default();
            unit[axis] = 1.0;
            self.wrench(unit)
        });
        for row in 0..errors[0].len() {
            let old = errors.each_ref().map(|column| column[row]);
            for (to, column) in errors.iter_mut().enumerate() {
                let parts = (0..6).map(|from| (columns[from][to] * old[from]).powi(2));
                column[row] = parts.sum::<f64>().sqrt();
            }
        }
    }

    pub fn is_known_from(axes: Axes) -> bool {
        Axis::ALL.into_iter().all(|axis| axes.contains(axis))
    }
}

impl FromStr for FrameChange {
    type Err = NoFrameChange;

    fn from_str(text: &str) -> Result<Self, NoFrameChange> {
        let refused = || NoFrameChange(text.to_owned());
        let fields: Vec<&str> = text.split(',').map(str::trim).collect();
        let numbers: Option<Vec<f64>> = fields
            .iter()
            .map(|field| field.parse().ok().filter(|value: &f64| value.is_finite()))
            .collect();
        match (numbers.as_deref(), &fields[..]) {
            (Some(&[x, y, z, a, b, c]), _) => {
                Ok(Self::new([x, y, z], [a, b, c].map(f64::to_radians)))
            }
            (None, &[x, y, z]) => {
                let axis = |field: &str| {
                    let (sign, name) = match field.strip_prefix(['-', '−']) {
                        Some(name) => (-1.0, name),
                        None => (1.0, field.strip_prefix('+').unwrap_or(field)),
                    };
                    let axis =
                        ["x", "y", "z"].iter().position(|axis| name.eq_ignore_ascii_case(axis));
                    axis.map(|axis| (axis, sign))
                };
                let axes = [axis(x), axis(y), axis(z)];
                let [Some(x), Some(y), Some(z)] = axes else { return Err(refused()) };
                Self::from_axes([x, y, z]).ok_or_else(refused)
            }
            _ => Err(refused()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn changed(text: &str, wrench: PerAxis<f64>) -> PerAxis<f64> {
        text.parse::<FrameChange>().unwrap().wrench(wrench)
    }

    fn assert_near(found: PerAxis<f64>, expected: PerAxis<f64>) {
        for (found, expected) in found.iter().zip(expected) {
            // Sines of right angles are off by 1e-16, and the numbers go up to 10.
            assert!((found - expected).abs() < 1e-14, "{found} {expected}");
        }
    }

    #[test]
    fn moments_are_about_the_new_origin() {
        // 2 N along x at 0.05 m above the old origin: no moment about that point.
        let at_point = changed("0,0,0.05,0,0,0", [2.0, 0.0, 0.0, 0.0, 0.1, 0.0]);
        assert_near(at_point, [2.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    }

    /// After 90° about x, the new y is the old z; the next 90° are about it. Another order gives another frame.
    #[test]
    fn turns_are_about_axes_that_have_turned_before() {
        let wrench = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        assert_near(changed("0,0,0,90,0,0", wrench), [1.0, 3.0, -2.0, 4.0, 6.0, -5.0]);
        assert_near(changed("0,0,0,0,0,90", wrench), [2.0, -1.0, 3.0, 5.0, -4.0, 6.0]);
        // After the rotation about x: x, z, −y. Then about the new y (the old z): x' = −z'', z' = x''.
        assert_near(changed("0,0,0,90,90,0", wrench), [2.0, 3.0, 1.0, 5.0, 6.0, 4.0]);
    }

    #[test]
    fn a_mirror_keeps_moments_axial() {
        // y mirrored: a force along x at y = +1 gives −1 about z; at the mirrored position it gives +1.
        let mirrored = changed("x,-y,z", [1.0, 0.0, 0.0, 0.0, 0.0, -1.0]);
        assert_near(mirrored, [1.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        let exchanged = changed("y,-x,z", [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_near(exchanged, [2.0, -1.0, 3.0, 5.0, -4.0, 6.0]);
        for wrong in ["x,x,z", "x,y", "1,2,3", "0,0,0,0,0,inf", "a,b,c", ""] {
            assert!(wrong.parse::<FrameChange>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn errors_of_exchanged_axes_are_exchanged_and_levers_add() {
        let mut errors = PerAxis::<Vec<f64>>::default();
        errors.iter_mut().zip(1..).for_each(|(column, error)| column.push(f64::from(error)));
        "y,x,-z".parse::<FrameChange>().unwrap().apply_to_errors(&mut errors);
        assert_eq!(errors.concat(), [2.0, 1.0, 3.0, 5.0, 4.0, 6.0]);
        let mut errors = [3.0, 0.0, 0.0, 0.0, 4.0, 0.0].map(|error| vec![error]);
        "0,0,1,0,0,0".parse::<FrameChange>().unwrap().apply_to_errors(&mut errors);
        assert_eq!(errors.concat(), [3.0, 0.0, 0.0, 0.0, 5.0, 0.0]);
    }
}
