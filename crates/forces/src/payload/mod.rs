//! Payload of a sensor: loads that are not contact.
//!
//! A tool, a shell or a hand behind the sensor has weight and inertia. With the apparent gravity
//! `g` in the sensor's frame (gravity less acceleration, the negative of an accelerometer's
//! reading),
//!
//! ```text
//! F = m·g + F₀        T = c × m·g + T₀
//! ```
//!
//! with mass m, centre of mass c and the sensor's own zero F₀, T₀. Still poses with known orientation determine all ten
//! parameters ([`fit()`]), and the frame, scale and offset of an accelerometer ([`Accelerometer`]). During a run the
//! accelerometer gives g at any time ([`Motion`]), the angular velocity gives the [contribution of
//! turning](gravity_at_centre) at c, and the load is subtracted. Torque from angular acceleration (the tensor of
//! inertia) is not modelled. The module neither reads files nor prints.

mod accelerometer;
mod doubt;
mod fit;
mod lag;
mod motion;
pub mod rotation;
mod turning;
mod vector;

pub use accelerometer::{Accelerometer, frame_from_forces};
pub use doubt::{LeftOver, MomentDoubt, MomentExchange, moment_doubt};
pub use fit::{LEAST_SPREAD, PayloadError, PayloadFit, PayloadPose, fit};
pub use lag::{Lag, find_lag};
pub use motion::{Motion, MotionError};
pub use turning::gravity_at_centre;
pub use vector::{Matrix, Vector, norm, times};

use shell_data::wrench::PerAxis;
use vector::cross;

/// Gravity by default, m/s² (the standard value of the third CGPM, 1901).
pub const STANDARD_GRAVITY_M_S2: f64 = 9.806_65;

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Payload {
    pub mass_kg: f64,
    pub centre_m: Vector,
    pub force_bias_n: Vector,
    /// T₀, N·m.
    pub moment_bias_nm: Vector,
}

impl Payload {
    /// The wrench of the body in apparent gravity, m/s², without the sensor's zero: N and N·m.
    pub fn load(&self, gravity_m_s2: Vector) -> PerAxis<f64> {
        let [x, y, z] = gravity_m_s2.map(|g| self.mass_kg * g);
        let [mx, my, mz] = cross(self.centre_m, [x, y, z]);
        [x, y, z, mx, my, mz]
    }

    /// The maximum force at the centre due to turning at 1 rad/s, N.
    pub fn turning_n(&self) -> f64 {
        self.mass_kg * norm(self.centre_m)
    }

    pub fn bias(&self) -> PerAxis<f64> {
        let ([x, y, z], [mx, my, mz]) = (self.force_bias_n, self.moment_bias_nm);
        [x, y, z, mx, my, mz]
    }
}

/// Inertial forces that are subtracted in addition to weight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Inertia {
    /// No inertial forces: gravity is computed from orientations.
    Nothing,
    /// Acceleration of the sensor, without the turning of the body's centre about it.
    WithoutTurning,
    Whole,
}

#[derive(Clone, Debug, PartialEq)]
pub struct CarriedLoad {
    pub payload: Payload,
    /// Apparent gravity at the body's centre, on the clock of the wrench.
    pub motion: Motion,
    pub inertia: Inertia,
    /// Factor applied to accelerations because their unit differed from that of the poses.
    pub rescaled: Option<f64>,
    /// The estimated lag of the motion's clock, applied or not.
    pub lag: Option<Lag>,
}

impl CarriedLoad {
    /// The mean load over `times_s`, without the sensor's zero; `None` if there are no times.
    pub fn mean(&self, times_s: &[f64]) -> Option<PerAxis<f64>> {
        let mut sum = PerAxis::<f64>::default();
        for &time in times_s {
            let load = self.payload.load(self.motion.at(time));
            sum.iter_mut().zip(load).for_each(|(sum, load)| *sum += load);
        }
        (!times_s.is_empty()).then(|| sum.map(|sum| sum / times_s.len() as f64))
    }

    /// Subtracts the load at each row's time, and `zero`. Returns the number of rows whose load is unknown.
    pub fn subtract(
        &self,
        times_s: &[f64],
        zero: &PerAxis<f64>,
        wrench: &mut PerAxis<Vec<f64>>,
    ) -> u64 {
        let mut unknown = 0;
        for (row, &time) in times_s.iter().enumerate() {
            let load = self.payload.load(self.motion.at(time));
            unknown += u64::from(self.motion.is_far(time));
            for ((column, load), zero) in wrench.iter_mut().zip(load).zip(zero) {
                column[row] -= load + zero;
            }
        }
        unknown
    }
}
