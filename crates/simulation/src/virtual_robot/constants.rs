//! Constants of the VelociRoACH and of the lab's telemetry, as the virtual robot is built.
//!
//! They are stated here on their own, not taken from the robot profile that trials are processed
//! with: a slip in one of the two then shows as a difference.

use std::f64::consts::TAU;

/// Standard gravity, m/s² (3rd CGPM, 1901).
pub(super) const GRAVITY: f64 = 9.806_65;
/// Encoder counts in a turn.
pub(super) const TURN: i64 = 1 << 16;
/// rad in a count.
pub(super) const RAD_PER_COUNT: f64 = TAU / TURN as f64;

/// What a trial is made with.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Constants {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Length of the robot, m.
    pub robot_m: f64,
    /// Length of the channel, m.
    pub channel_m: f64,
    /// Resistance of a motor's winding, Ω.
    pub motor_resistance_ohm: f64,
}

impl Constants {
    /// Table I of the paper; 3.3 Ω as the lab takes it.
    pub const VELOCIROACH: Self =
        Self { mass_kg: 0.087, robot_m: 0.18, channel_m: 0.28, motor_resistance_ohm: 3.3 };

    /// The robot's weight, N.
    pub(super) fn weight_n(&self) -> f64 {
        self.mass_kg * GRAVITY
    }
}
