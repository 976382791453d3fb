//! Conversion of accelerometer readings to gravity in the sensor's frame.
//!
//! A still accelerometer reads −g, in its own frame and unit and with offsets. Poses with known
//! gravity determine these: `a = A·g + b` is fitted by least squares, axis by axis (the noise is in
//! a), and inverted to `g = A⁻¹·(a − b)`. If only the accelerometer knows the orientation, its
//! frame follows from the forces: the rotation R that best satisfies `F ≈ m·R·u + F₀` for the
//! directions `u = −a` (Wahba, SIAM Review 7, 409, 1965; by singular values, Markley, J. Astronaut.
//! Sci. 38, 245, 1988). The offsets then remain in the sensor's zero.

use faer::Mat;

use super::PayloadError;
use super::fit::{LEAST_SPREAD, check_spread, spread};
use super::vector::{
    Matrix, Vector, add, dot, inverse, mean, norm, product, scaled, subtract, sum_of_products,
    times,
};

/// The minimum number of poses for the twelve parameters of an accelerometer.
const LEAST_POSES: usize = 6;

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Accelerometer {
    /// The matrix from logged accelerations to gravity in the sensor's frame, m/s².
    pub matrix: Matrix,
    /// Gravity at an accelerometer reading of zero, m/s².
    pub offset_m_s2: Vector,
    /// RMS error of gravity per axis; zero if only the accelerometer knows gravity.
    pub residual_rms_m_s2: Vector,
}

impl Accelerometer {
    /// Fits frame, scale and offsets to accelerations and gravity, m/s². `None` for too few poses,
    /// or gravity that does not turn in all three dimensions.
    pub fn fit(accelerations: &[Vector], gravity: &[Vector]) -> Option<Self> {
        let count = accelerations.len();
        if count < LEAST_POSES || count != gravity.len() {
            return None;
        }
        let (mean_a, mean_g) = (mean(accelerations.iter().copied()), mean(gravity.iter().copied()));
        let pairs = || {
            let turns = gravity.iter().map(|g| subtract(*g, mean_g));
            accelerations.iter().map(|a| subtract(*a, mean_a)).zip(turns)
        };
        let scatter = sum_of_products(pairs().map(|(_, turn)| (turn, turn)));
        let size = gravity.iter().map(|g| norm(*g)).sum::<f64>() / count as f64;
        // Compare the volume of the scatter with its size: gravity must not stay in a plane.
        let determinant = dot(scatter[0], super::vector::cross(scatter[1], scatter[2]));
        let share = determinant.max(0.0).sqrt() / (count as f64).powf(1.5) / size.powi(3);
        if share.is_nan() || share < LEAST_SPREAD {
            return None;
        }
        let response = product(&sum_of_products(pairs()), &inverse(&scatter));
        let matrix = inverse(&response);
        let offset_m_s2 = subtract(mean_g, times(&matrix, mean_a));
        let mut fitted = Self { matrix, offset_m_s2, residual_rms_m_s2: [0.0; 3] };
        let squares = accelerations.iter().zip(gravity).fold([0.0; 3], |sum, (a, g)| {
            add(sum, subtract(fitted.gravity(*a), *g).map(|left| left * left))
        });
        fitted.residual_rms_m_s2 = squares.map(|sum| (sum / count as f64).sqrt());
        fitted.matrix.iter().flatten().all(|value| value.is_finite()).then_some(fitted)
    }

    pub fn gravity(&self, acceleration: Vector) -> Vector {
        add(times(&self.matrix, acceleration), self.offset_m_s2)
    }
}

/// Finds the accelerometer's frame from forces on a still sensor, N, and accelerations in units of `unit_m_s2`, which
/// is negative if the accelerations point along gravity.
///
/// # Errors
/// [`PayloadError`] if all directions of gravity are equal or lie on a line.
pub fn frame_from_forces(
    accelerations: &[Vector],
    forces: &[Vector],
    unit_m_s2: f64,
) -> Result<Accelerometer, PayloadError> {
    let (mean_a, mean_f) = (mean(accelerations.iter().copied()), mean(forces.iter().copied()));
    let turns = accelerations.iter().map(|a| subtract(*a, mean_a));
    check_spread(spread(turns.clone(), accelerations.iter().copied()))?;
    let pulls = forces.iter().map(|force| subtract(*force, mean_f));
    let against = -unit_m_s2.signum();
    let products = sum_of_products(turns.map(|turn| scaled(turn, against)).zip(pulls));
    let not_finite = || PayloadError::NotFinite(1);
    let svd = Mat::from_fn(3, 3, |i, j| products[i][j]).svd().map_err(|_| not_finite())?;
    let (u, v) = (svd.U(), svd.V());
    let column =
        |m: faer::MatRef<'_, f64>, j: usize| -> Vector { std::array::from_fn(|i| m[(i, j)]) };
    let handed = |m| dot(column(m, 0), super::vector::cross(column(m, 1), column(m, 2)));
    // A mirror image is not a rotation: flip the weakest direction.
    let signs = [1.0, 1.0, (handed(u) * handed(v)).signum()];
    let rotation: Matrix = std::array::from_fn(|i| {
        std::array::from_fn(|j| (0..3).map(|k| v[(i, k)] * signs[k] * u[(j, k)]).sum())
    });
    Ok(Accelerometer {
        matrix: rotation.map(|row| scaled(row, -unit_m_s2)),
        offset_m_s2: [0.0; 3],
        residual_rms_m_s2: [0.0; 3],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn directions() -> Vec<Vector> {
        let angle = |i: i32, k: f64| f64::from(i) * k;
        (0..9)
            .map(|i| {
                let (a, b) = (angle(i, 0.9), angle(i, 2.3));
                [a.cos() * b.cos(), a.cos() * b.sin(), a.sin()].map(|v| 9.81 * v)
            })
            .collect()
    }

    #[test]
    fn known_frame_scale_and_offsets_are_recovered() {
        // Readings in multiples of g, with exchanged axes, one of them 2 % too long, and offsets.
        let says = |g: &Vector| [0.02 - g[2] / 9.81, 0.05 + 1.02 * g[0] / 9.81, 0.1 - g[1] / 9.81];
        let gravity = directions();
        let accelerations: Vec<Vector> = gravity.iter().map(says).collect();
        let found = Accelerometer::fit(&accelerations, &gravity).unwrap();
        for (a, g) in accelerations.iter().zip(&gravity) {
            assert!(norm(subtract(found.gravity(*a), *g)) < 1e-13);
        }
        let plane: Vec<Vector> = gravity.iter().map(|g| [g[0], g[1], 0.0]).collect();
        let says: Vec<Vector> = plane.iter().map(says).collect();
        assert_eq!(Accelerometer::fit(&says, &plane), None);
        assert_eq!(Accelerometer::fit(&accelerations[..5], &gravity[..5]), None);
    }

    #[test]
    fn the_frame_of_an_accelerometer_is_found_from_forces() {
        let (s, c) = 0.7_f64.sin_cos();
        let turned = |g: &Vector| [c * g[0] - s * g[1], s * g[0] + c * g[1], g[2]];
        // Gravity turns in three dimensions, then in a plane.
        let flat: Vec<Vector> = directions().iter().map(|g| [g[0], 0.0, g[2]]).collect();
        for gravity in [directions(), flat] {
            let accelerations: Vec<Vector> =
                gravity.iter().map(|g| scaled(turned(g), -1.0 / 9.81)).collect();
            let forces: Vec<Vector> =
                gravity.iter().map(|g| add(scaled(*g, 0.3), [5.0, -2.0, 1.0])).collect();
            let found = frame_from_forces(&accelerations, &forces, 9.81).unwrap();
            for (a, g) in accelerations.iter().zip(&gravity) {
                assert!(norm(subtract(found.gravity(*a), *g)) < 1e-12, "{found:?}");
            }
            let along: Vec<Vector> = accelerations.iter().map(|a| scaled(*a, -1.0)).collect();
            let found = frame_from_forces(&along, &forces, -9.81).unwrap();
            for (a, g) in along.iter().zip(&gravity) {
                assert!(norm(subtract(found.gravity(*a), *g)) < 1e-12, "{found:?}");
            }
        }
        let still = [[0.0, 0.0, -1.0]; 5];
        assert!(frame_from_forces(&still, &[[1.0, 0.0, 0.0]; 5], 9.81).is_err());
    }
}
