//! Contribution of turning to the acceleration of a body whose centre is away from the sensor. With the sensor's
//! angular velocity ω and its slope α, the centre c has the additional acceleration `α × c + ω × (ω × c)`; apparent
//! gravity at c is smaller by this acceleration.

use super::rotation::slope;
use super::vector::{Vector, add, cross, subtract};

/// Converts apparent gravity at the sensor, in its frame, m/s², to that at `centre_m`, by the angular velocity at
/// ascending times, rad/s.
pub fn gravity_at_centre(
    times_s: &[f64],
    gravity_m_s2: &[Vector],
    angular_velocity: &[Vector],
    centre_m: Vector,
) -> Vec<Vector> {
    let accelerations = slope(times_s, angular_velocity);
    let turns = angular_velocity.iter().zip(accelerations);
    let turning = |(omega, alpha): (&Vector, Vector)| {
        add(cross(alpha, centre_m), cross(*omega, cross(*omega, centre_m)))
    };
    gravity_m_s2.iter().zip(turns.map(turning)).map(|(g, added)| subtract(*g, added)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_steady_turn_pulls_outwards_and_an_accelerating_one_backwards() {
        let times: Vec<f64> = (0..5).map(|i| 0.01 * f64::from(i)).collect();
        let still = [[0.0; 3]; 5];
        // 3 rad/s about z at 0.1 m along x: 0.9 m/s² outwards.
        let found = gravity_at_centre(&times, &still, &[[0.0, 0.0, 3.0]; 5], [0.1, 0.0, 0.0]);
        assert!(found.iter().all(|g| (g[0] - 0.9).abs() < 1e-14 && g[1] == 0.0 && g[2] == 0.0));
        // An angular acceleration of 20 rad/s²: 2 m/s² against the turn.
        let faster: Vec<Vector> = times.iter().map(|t| [0.0, 0.0, 20.0 * t]).collect();
        let found = gravity_at_centre(&times, &still, &faster, [0.1, 0.0, 0.0]);
        assert!(found.iter().all(|g| (g[1] + 2.0).abs() < 1e-12), "{found:?}");
    }
}
