//! Rotations from the sensor's frame to one whose z is up, and their rate of change.

use super::vector::{Matrix, Vector, add, cross, dot, inverse, norm, product, scaled, subtract};

/// The matrix of a quaternion x y z w of any length.
pub fn from_quaternion([x, y, z, w]: [f64; 4]) -> Matrix {
    let two = 2.0 / (x * x + y * y + z * z + w * w);
    [
        [1.0 - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)],
        [two * (x * y + w * z), 1.0 - two * (x * x + z * z), two * (y * z - w * x)],
        [two * (x * z - w * y), two * (y * z + w * x), 1.0 - two * (x * x + y * y)],
    ]
}

/// The matrix of a rotation vector, rad: along the axis, with the angle as its length.
pub fn from_rotation_vector(vector: Vector) -> Matrix {
    let (angle, half) = (norm(vector), 0.5 * norm(vector));
    let axis = if angle > 0.0 { scaled(vector, half.sin() / angle) } else { [0.0; 3] };
    from_quaternion([axis[0], axis[1], axis[2], half.cos()])
}

/// The matrix of roll, pitch and yaw, rad: `Rz(yaw)·Ry(pitch)·Rx(roll)`.
pub fn from_roll_pitch_yaw([roll, pitch, yaw]: Vector) -> Matrix {
    let about = |axis: usize, angle: f64| {
        let mut vector = [0.0; 3];
        vector[axis] = angle;
        from_rotation_vector(vector)
    };
    product(&product(&about(2, yaw), &about(1, pitch)), &about(0, roll))
}

pub fn transposed(matrix: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| matrix[j][i]))
}

fn rotation_vector(m: &Matrix) -> Vector {
    let sines = [m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]];
    let (sine, cosine) = (0.5 * norm(sines), 0.5 * (m[0][0] + m[1][1] + m[2][2] - 1.0));
    let angle = sine.atan2(cosine);
    scaled(sines, if sine > 1e-12 { 0.5 * angle / sine } else { 0.5 })
}

/// The rotation nearest to a matrix or, for a mirroring matrix, to its negative.
pub fn nearest_rotation(matrix: &Matrix) -> Matrix {
    let determinant = dot(matrix[0], cross(matrix[1], matrix[2]));
    let size = determinant.cbrt();
    let mut near = matrix.map(|row| scaled(row, 1.0 / size));
    // Newton's iteration to the orthogonal factor doubles the number of correct digits per step.
    for _ in 0..30 {
        let other = transposed(&inverse(&near));
        near = std::array::from_fn(|i| scaled(add(near[i], other[i]), 0.5));
    }
    near
}

/// The angular velocity in the sensor's frame, rad/s, from rotations at ascending times, s.
pub fn angular_velocity(times_s: &[f64], rotations: &[Matrix]) -> Vec<Vector> {
    let pairs = rotations.windows(2).zip(times_s.windows(2));
    let rate = |(turn, times): (&[Matrix], &[f64])| {
        let step = rotation_vector(&product(&transposed(&turn[0]), &turn[1]));
        scaled(step, 1.0 / (times[1] - times[0]))
    };
    let between: Vec<Vector> = pairs.map(rate).collect();
    let mut found = at_samples(times_s, &between);
    // Extrapolate linearly at the ends: holding the value would halve the slope there.
    if let [first, .., last] = between[..] {
        let end = found.len() - 1;
        found[0] = subtract(scaled(first, 2.0), found[1]);
        found[end] = subtract(scaled(last, 2.0), found[end - 1]);
    }
    found
}

pub(super) fn slope(times_s: &[f64], vectors: &[Vector]) -> Vec<Vector> {
    let pairs = vectors.windows(2).zip(times_s.windows(2));
    let rate = |(of, times): (&[Vector], &[f64])| {
        scaled(subtract(of[1], of[0]), 1.0 / (times[1] - times[0]))
    };
    let between: Vec<Vector> = pairs.map(rate).collect();
    at_samples(times_s, &between)
}

/// Values at the samples from values in the middle between neighbouring samples.
fn at_samples(times_s: &[f64], between: &[Vector]) -> Vec<Vector> {
    let last = times_s.len().saturating_sub(1);
    let at = |row: usize| match row {
        _ if between.is_empty() => [0.0; 3],
        0 => between[0],
        row if row == last => between[row - 1],
        row => {
            let (before, after) =
                (times_s[row] - times_s[row - 1], times_s[row + 1] - times_s[row]);
            let share = before / (before + after);
            add(scaled(between[row - 1], 1.0 - share), scaled(between[row], share))
        }
    };
    (0..times_s.len()).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_near(found: &Matrix, expected: &Matrix) {
        for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
            // Some roundings of numbers up to 1.
            assert!((found - expected).abs() < 1e-14, "{found} {expected}");
        }
    }

    /// SciPy 1.17.1: `Rotation.from_euler("ZYX", [0.3, -0.4, 0.5])`, which is yaw, pitch and roll,
    /// with its `as_quat` and `as_rotvec`.
    #[test]
    fn rotations_equal_scipy() {
        let expected = [
            [0.8799231762812568, -0.43770193066667434, -0.1848032027151299],
            [0.27219213529543135, 0.7832138784613231, -0.5590057799959539],
            [0.3894183423086504, 0.4415801631371557, 0.8083070667743448],
        ];
        assert_near(&from_roll_pitch_yaw([0.5, -0.4, 0.3]), &expected);
        let quaternion =
            [0.2685154702459379, -0.15409707606385747, 0.19050591331489203, 0.9315905916115894];
        assert_near(&from_quaternion(quaternion), &expected);
        assert_near(&from_quaternion(quaternion.map(|value| -3.0 * value)), &expected);
        let vector = [0.5496221592538715, -0.31542006724361793, 0.3899450237666364];
        assert_near(&from_rotation_vector(vector), &expected);
        assert!(norm(subtract(rotation_vector(&expected), vector)) < 1e-14);
        assert_near(&nearest_rotation(&expected.map(|row| scaled(row, -9.8))), &expected);
        assert_near(&product(&transposed(&expected), &expected), &from_rotation_vector([0.0; 3]));
    }

    #[test]
    fn a_steady_turn_has_its_angular_velocity_and_no_slope() {
        let times: Vec<f64> = (0..40).map(|i| 0.01 * f64::from(i + i % 2)).step_by(2).collect();
        let rate = [1.0, -2.0, 4.0];
        let rotations: Vec<Matrix> =
            times.iter().map(|t| from_rotation_vector(scaled(rate, *t))).collect();
        let found = angular_velocity(&times, &rotations);
        for (found, slope) in found.iter().zip(slope(&times, &found)) {
            assert!(norm(subtract(*found, rate)) < 1e-12 && norm(slope) < 1e-9, "{found:?}");
        }
    }

    #[test]
    fn an_accelerating_turn_has_its_slope_at_the_ends_too() {
        let times = [0.0, 0.01, 0.03, 0.04, 0.06];
        let axis = [0.6, 0.0, -0.8];
        let rotations = times.map(|t| from_rotation_vector(scaled(axis, 10.0 * t * t)));
        let found = angular_velocity(&times, &rotations);
        for ((t, found), slope) in times.iter().zip(&found).zip(slope(&times, &found)) {
            assert!(norm(subtract(*found, scaled(axis, 20.0 * t))) < 1e-9, "{t}: {found:?}");
            assert!(norm(subtract(slope, scaled(axis, 20.0))) < 1e-6, "{t}: {slope:?}");
        }
    }
}
