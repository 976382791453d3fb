//! What a sensor carries: loads on it that are not contact.
//!
//! A tool, a shell, a hand behind the sensor weighs on it, and pulls when it is accelerated. With the
//! apparent gravity `g` in the sensor's frame (gravity less acceleration, what an accelerometer measures but
//! for its sign),
//!
//! ```text
//! F = m·g + F₀        T = c × m·g + T₀
//! ```
//!
//! with mass m, centre of mass c and the sensor's own zero F₀, T₀. Poses at rest whose orientation is known
//! give all ten by least squares ([`fit()`]), and the frame, scale and offset of an accelerometer besides
//! ([`Accelerometer`]). In a run the accelerometer then says g at any time ([`Motion`]), the angular velocity what
//! [turning adds](gravity_at_centre) at c, and the load is taken off. Torque from turning faster and faster (the tensor
//! of inertia) is not modelled.
//!
//! Pure: no files, no printing.

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

/// Gravity where nothing else is said, m/s² (the standard value of the third CGPM, 1901).
pub const STANDARD_GRAVITY_M_S2: f64 = 9.806_65;

/// A rigid body on a sensor, and the sensor's zero.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Payload {
    /// Mass m, kg.
    pub mass_kg: f64,
    /// Centre of mass c in the sensor's frame, m.
    pub centre_m: Vector,
    /// F₀, N.
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

    /// The force that turning by 1 rad/s adds at the centre at most, N.
    pub fn turning_n(&self) -> f64 {
        self.mass_kg * norm(self.centre_m)
    }

    /// The sensor's zero, N and N·m.
    pub fn bias(&self) -> PerAxis<f64> {
        let ([x, y, z], [mx, my, mz]) = (self.force_bias_n, self.moment_bias_nm);
        [x, y, z, mx, my, mz]
    }
}

/// What is taken off of a load beside weight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Inertia {
    /// Nothing: gravity is from orientations.
    Nothing,
    /// The acceleration of the sensor, but not what turning adds at the centre of the body.
    WithoutTurning,
    /// Both.
    Whole,
}

/// What a sensor carries in a run.
#[derive(Clone, Debug, PartialEq)]
pub struct CarriedLoad {
    /// The body.
    pub payload: Payload,
    /// Apparent gravity at the body's centre over time, on the clock of the wrench.
    pub motion: Motion,
    /// What is taken off beside weight.
    pub inertia: Inertia,
    /// What accelerations were multiplied by, where their unit was not that of the poses.
    pub rescaled: Option<f64>,
    /// How much later the clock of the motion was found to be, taken or not.
    pub lag: Option<Lag>,
}

impl CarriedLoad {
    /// The mean load at some times, without the sensor's zero; `None` of none.
    pub fn mean(&self, times_s: &[f64]) -> Option<PerAxis<f64>> {
        let mut sum = PerAxis::<f64>::default();
        for &time in times_s {
            let load = self.payload.load(self.motion.at(time));
            sum.iter_mut().zip(load).for_each(|(sum, load)| *sum += load);
        }
        (!times_s.is_empty()).then(|| sum.map(|sum| sum / times_s.len() as f64))
    }

    /// Takes the load at each row's time off its wrench, and `zero`. Returns the number of rows where the
    /// load is not known.
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
