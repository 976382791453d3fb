//! A rigid plate on springs: stiffness, compliance, and deviations from Hooke's law.
//!
//! The plate hangs on springs at points pᵢ, each with a stiffness along x, y and z. A displacement
//! u = (d, θ) moves the foot of a spring by d + θ × pᵢ. The energy is ½ uᵀK u with K = Σ Jᵢᵀ
//! diag(kᵢ) Jᵢ, and a wrench w displaces the plate by K⁻¹w. (Springs are linear in the small
//! rotations θ; `geometry` computes reflectors exactly.)
//!
//! Wire springs in a printed seat also creep and stick. The model applies both effects to the
//! wrench:
//!
//! - *creep*: part of the response is late, a first-order relaxation (standard linear solid);
//! - *hysteresis*: part of the response follows the load through play, one stop element of a
//!   Prandtl–Ishlinskii model (Visintin, *Differential Models of Hysteresis*, 1994, ch. III).

use shell_data::wrench::PerAxis;

/// Translation in m along x, y, z, then rotation vector in rad.
pub type Displacement = [f64; 6];

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spring {
    pub position_m: [f64; 3],
    pub stiffness_n_per_m: [f64; 3],
}

// Chosen so that a cubic calibration with the paper's numbers of rows (77,522 and 19,932)
// has the paper's errors, 0.118, 0.122 and 0.126 N. A tenth of the travel is late, and a hysteresis
// loop is 2 · 0.2 · 0.7 N = 0.28 N wide, a tenth of the largest push.

/// Additional displacement under constant load, as a fraction of the immediate one.
pub(super) const CREEP: f64 = 0.10;
const CREEP_S: f64 = 1.5;
/// Fraction of the response that passes through the play.
pub(super) const HYSTERESIS: f64 = 0.2;
/// Half-width of the play for forces, N, and moments, N·m.
const PLAY: [f64; 2] = [0.7, 0.025];

/// Computes the 6 × 6 stiffness about the origin: N/m for forces by translations, N·m/rad for
/// moments by rotations, N otherwise.
pub fn stiffness(springs: &[Spring]) -> [[f64; 6]; 6] {
    let mut matrix = [[0.0; 6]; 6];
    for spring in springs {
        let [x, y, z] = spring.position_m;
        let jacobian =
            [[1.0, 0.0, 0.0, 0.0, z, -y], [0.0, 1.0, 0.0, -z, 0.0, x], [0.0, 0.0, 1.0, y, -x, 0.0]];
        for (row, k) in jacobian.into_iter().zip(spring.stiffness_n_per_m) {
            for i in 0..6 {
                for j in 0..6 {
                    matrix[i][j] += k * row[i] * row[j];
                }
            }
        }
    }
    matrix
}

/// Inverts a symmetric positive definite `stiffness`, by Gauss–Jordan elimination without pivoting
/// (stable for such matrices); `None` if it is not positive definite. Written out, since a
/// library's kernels round differently on different processors.
pub(crate) fn compliance(stiffness: &[[f64; 6]; 6]) -> Option<[[f64; 6]; 6]> {
    let mut left = *stiffness;
    let mut right: [[f64; 6]; 6] =
        std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))));
    for k in 0..6 {
        let pivot = left[k][k];
        // Rounding leaves a pivot of this size in place of zero.
        if pivot.is_nan() || pivot <= 1e-12 * stiffness[k][k] {
            return None;
        }
        for j in 0..6 {
            left[k][j] /= pivot;
            right[k][j] /= pivot;
        }
        for i in (0..6).filter(|&i| i != k) {
            let factor = left[i][k];
            for j in 0..6 {
                left[i][j] -= factor * left[k][j];
                right[i][j] -= factor * right[k][j];
            }
        }
    }
    Some(right)
}

#[derive(Clone, Debug)]
pub(super) struct Suspension {
    compliance: [[f64; 6]; 6],
    creep: f64,
    hysteresis: f64,
    time_s: Option<f64>,
    late: PerAxis<f64>,
    play: PerAxis<f64>,
}

impl Suspension {
    pub(super) fn new(compliance: [[f64; 6]; 6], creep: f64, hysteresis: f64) -> Self {
        Self { compliance, creep, hysteresis, time_s: None, late: [0.0; 6], play: [0.0; 6] }
    }

    /// Displacement of the plate under `wrench`, which has held since the previous call.
    pub(super) fn displacement(&mut self, time_s: f64, wrench: &PerAxis<f64>) -> Displacement {
        let elapsed_s = self.time_s.replace(time_s).map_or(0.0, |before| time_s - before);
        let relaxed = -libm::expm1(-elapsed_s.max(0.0) / CREEP_S);
        let mut response = [0.0; 6];
        for axis in 0..6 {
            let load = wrench[axis];
            let half_width = PLAY[axis / 3];
            self.late[axis] += relaxed * (self.creep * load - self.late[axis]);
            self.play[axis] = self.play[axis].clamp(load - half_width, load + half_width);
            response[axis] = (1.0 - self.hysteresis) * load
                + self.hysteresis * self.play[axis]
                + self.late[axis];
        }
        product(&self.compliance, &response)
    }
}

fn product(matrix: &[[f64; 6]; 6], vector: &[f64; 6]) -> [f64; 6] {
    std::array::from_fn(|i| matrix[i].iter().zip(vector).map(|(m, v)| m * v).sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn springs() -> [Spring; 4] {
        [[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]].map(|[x, y]| Spring {
            position_m: [0.03 * x, 0.02 * y, 0.004],
            stiffness_n_per_m: [1000.0, 1500.0 + 100.0 * x, 3000.0 - 200.0 * y],
        })
    }

    #[test]
    fn stiffness_times_displacement_is_the_load() {
        let stiffness = stiffness(&springs());
        let compliance = compliance(&stiffness).unwrap();
        let wrench = [1.0, -2.0, 3.0, 0.04, -0.05, 0.06];
        let back = product(&stiffness, &product(&compliance, &wrench));
        for (back, load) in back.into_iter().zip(wrench) {
            // The matrix has entries from 2 to 12,000 (condition 6e3): 6e3 ulps.
            assert!((back - load).abs() < 1e-12, "{back} {load}");
        }
    }

    #[test]
    fn spring_forces_balance_the_load() {
        // Independent check: add up the springs' forces and moments at the displaced plate.
        let compliance = compliance(&stiffness(&springs())).unwrap();
        let wrench = [0.5, 1.5, -2.5, -0.03, 0.02, 0.01];
        let u = product(&compliance, &wrench);
        let mut sum = [0.0; 6];
        for spring in springs() {
            let [x, y, z] = spring.position_m;
            let moved = [
                u[0] + u[4] * z - u[5] * y,
                u[1] + u[5] * x - u[3] * z,
                u[2] + u[3] * y - u[4] * x,
            ];
            let f: [f64; 3] = std::array::from_fn(|a| spring.stiffness_n_per_m[a] * moved[a]);
            let m = [y * f[2] - z * f[1], z * f[0] - x * f[2], x * f[1] - y * f[0]];
            for (sum, part) in sum.iter_mut().zip(f.into_iter().chain(m)) {
                *sum += part;
            }
        }
        for (sum, load) in sum.into_iter().zip(wrench) {
            assert!((sum - load).abs() < 1e-12, "{sum} {load}");
        }
    }

    #[test]
    fn springs_that_leave_the_plate_loose_have_no_compliance() {
        assert!(compliance(&stiffness(&springs()[..1])).is_none());
        assert!(compliance(&stiffness(&[])).is_none());
        assert!(compliance(&[[f64::NAN; 6]; 6]).is_none());
    }

    #[test]
    fn creep_goes_the_way_of_a_standard_linear_solid() {
        let compliance = compliance(&stiffness(&springs())).unwrap();
        let mut suspension = Suspension::new(compliance, 0.1, 0.0);
        let load = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0];
        let at_once = suspension.displacement(0.0, &load)[2];
        let mut later = 0.0;
        for step in 1..=30 {
            later = suspension.displacement(0.1 * f64::from(step), &load)[2];
        }
        let expected = at_once * (1.0 + 0.1 * (1.0 - (-2.0_f64).exp()));
        assert!((later / expected - 1.0).abs() < 1e-13, "{later} {expected}");
    }

    #[test]
    fn a_load_that_comes_and_goes_leaves_half_the_play_behind() {
        let compliance = compliance(&stiffness(&springs())).unwrap();
        let mut suspension = Suspension::new(compliance, 0.0, 0.2);
        let fx = |value| [value, 0.0, 0.0, 0.0, 0.0, 0.0];
        suspension.displacement(0.0, &fx(3.0));
        let left = suspension.displacement(1.0, &fx(0.0));
        // The play ends at +0.7 N, and contributes 0.2 of that.
        let expected = product(&compliance, &fx(0.14));
        for (left, expected) in left.into_iter().zip(expected) {
            assert!((left - expected).abs() < 1e-18);
        }
    }
}
