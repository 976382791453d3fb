//! Positions of the reflectors after the plate has moved: exact rigid-body geometry.
//!
//! A photointerrupter at (x, y, 0) looks along +z. Without load, its reflector is a plane through p
//! = (x, y, gap) with normal n, tilted out of z. The plate rotates by R and moves by d, so the
//! plane goes through R p + d with normal R n, and the ray meets it at z = [(R n)·(R p + d) − (R
//! n)ₓ x − (R n)ᵧ y] / (R n)_z.
//!
//! Not modelled: the size of the spot, and the lower return of a tilted reflector, both nearly
//! constant over the small travel and part of the gain.

use super::springs::Displacement;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reflector {
    pub position_m: [f64; 2],
    /// Unloaded distance.
    pub gap_m: f64,
    /// Rotation about x, rad, by which the channel senses y (and z).
    pub tilt_x_rad: f64,
    /// Rotation about y, rad, by which the channel senses x (and z).
    pub tilt_y_rad: f64,
}

impl Reflector {
    pub(super) fn normal(&self) -> [f64; 3] {
        let (sin_x, cos_x) = libm::sincos(self.tilt_x_rad);
        let (sin_y, cos_y) = libm::sincos(self.tilt_y_rad);
        [sin_y * cos_x, -sin_x, cos_y * cos_x]
    }
}

/// The plate's motion: x ↦ R x + d.
#[derive(Clone, Copy, Debug)]
pub(super) struct RigidMotion {
    rotation: [[f64; 3]; 3],
    translation_m: [f64; 3],
}

impl RigidMotion {
    /// Converts a displacement, by Rodrigues' formula.
    pub(super) fn new(displacement: &Displacement) -> Self {
        let &[dx, dy, dz, rx, ry, rz] = displacement;
        let angle = (rx * rx + ry * ry + rz * rz).sqrt();
        // sin θ/θ and (1 − cos θ)/θ², which tend to 1 and 1/2.
        let (a, b) = if angle < 1e-9 {
            (1.0, 0.5)
        } else {
            let half = libm::sin(0.5 * angle) / angle;
            (libm::sin(angle) / angle, 2.0 * half * half)
        };
        let rotation = [
            [1.0 - b * (ry * ry + rz * rz), b * rx * ry - a * rz, b * rx * rz + a * ry],
            [b * rx * ry + a * rz, 1.0 - b * (rx * rx + rz * rz), b * ry * rz - a * rx],
            [b * rx * rz - a * ry, b * ry * rz + a * rx, 1.0 - b * (rx * rx + ry * ry)],
        ];
        Self { rotation, translation_m: [dx, dy, dz] }
    }

    pub(super) fn turn(&self, vector: &[f64; 3]) -> [f64; 3] {
        let row = |r: [f64; 3]| r[0] * vector[0] + r[1] * vector[1] + r[2] * vector[2];
        self.rotation.map(row)
    }

    /// Distance in m from the photointerrupter to `reflector`, whose unloaded normal is `normal`.
    pub(super) fn gap_m(&self, reflector: &Reflector, normal: &[f64; 3]) -> f64 {
        let [x, y] = reflector.position_m;
        let n = self.turn(normal);
        let p = self.turn(&[x, y, reflector.gap_m]);
        let d = self.translation_m;
        (n[0] * (p[0] + d[0] - x) + n[1] * (p[1] + d[1] - y) + n[2] * (p[2] + d[2])) / n[2]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FLAT: Reflector =
        Reflector { position_m: [0.02, 0.01], gap_m: 1.2e-3, tilt_x_rad: 0.0, tilt_y_rad: 0.0 };

    fn gap(reflector: &Reflector, displacement: Displacement) -> f64 {
        RigidMotion::new(&displacement).gap_m(reflector, &reflector.normal())
    }

    #[test]
    fn a_flat_reflector_sees_z_and_nothing_of_x_and_y() {
        assert_eq!(gap(&FLAT, [0.0; 6]), 1.2e-3);
        assert_eq!(gap(&FLAT, [3e-4, -2e-4, 0.0, 0.0, 0.0, 0.0]), 1.2e-3);
        assert!((gap(&FLAT, [0.0, 0.0, 1e-4, 0.0, 0.0, 0.0]) - 1.3e-3).abs() < 1e-18);
    }

    #[test]
    fn a_tilted_reflector_slides_by_the_tangent_of_its_tilt() {
        let about_y = Reflector { tilt_y_rad: 0.5, ..FLAT };
        let about_x = Reflector { tilt_x_rad: 0.5, ..FLAT };
        let slide = 1e-4 * 0.5_f64.tan();
        let x = [1e-4, 0.0, 0.0, 0.0, 0.0, 0.0];
        let y = [0.0, 1e-4, 0.0, 0.0, 0.0, 0.0];
        assert!((gap(&about_y, x) - 1.2e-3 - slide).abs() < 1e-18);
        assert!((gap(&about_y, y) - 1.2e-3).abs() < 1e-18);
        assert!((gap(&about_x, y) - 1.2e-3 + slide).abs() < 1e-18);
        assert!((gap(&about_x, x) - 1.2e-3).abs() < 1e-18);
    }

    #[test]
    fn a_large_rotation_about_y_meets_the_ray_where_trigonometry_says() {
        // The plane z = g rotated by θ about y: z cos θ + x sin θ = g.
        let theta = 0.7_f64;
        let expected = (1.2e-3 - 0.02 * theta.sin()) / theta.cos();
        let z = gap(&FLAT, [0.0, 0.0, 0.0, 0.0, theta, 0.0]);
        assert!((z - expected).abs() < 1e-17, "{z} {expected}");
    }

    #[test]
    fn rotations_keep_lengths_and_their_axis() {
        let axis = [0.3, -0.5, 0.2];
        let motion = RigidMotion::new(&[0.0, 0.0, 0.0, axis[0], axis[1], axis[2]]);
        for (turned, axis) in motion.turn(&axis).into_iter().zip(axis) {
            assert!((turned - axis).abs() < 1e-15);
        }
        let v = motion.turn(&[1.0, 2.0, 3.0]);
        assert!((v.iter().map(|x| x * x).sum::<f64>() - 14.0).abs() < 1e-14);
    }
}
