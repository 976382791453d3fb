//! Battery and motors: voltage and power that follow from the controller's duty.
//!
//! The power of a motor is the lab's formula, with duty d as a fraction, battery voltage V, back
//! EMF e and winding resistance R,
//!
//! ```text
//! P = |d V (V − e) / R|,
//! ```
//!
//! so that the battery delivers I = |d| (V − e)/R to each motor, and its voltage sags: V = V₀ − r
//! ΣI − (drain so far), linear in V.

use super::CONSTANTS;
use super::gait::{Gait, LegSide};
use shell_data::random::RandomStream;

const FULL_DUTY: f64 = 4096.0;
const DUTY_LIMIT: f64 = 3000.0;
/// Mean duty and its scatter between rows, counts: the real log has 1,560 ± 1,040.
const DUTY: [f64; 2] = [1550.0, 700.0];
/// Duty due to the load of the feet, twice a turn, counts.
const FEET_DUTY: f64 = 500.0;
/// Back EMF at the legs' speed, V·s/rad: the real log has 157 counts, 1.59 V, at 13 turns a second.
const BACK_EMF_V_S: f64 = 1.59 / (std::f64::consts::TAU * 13.0);
/// 882 counts in the real log before the motors start.
const OPEN_V: f64 = 3.899;
/// A sag of 0.14 V under 0.45 A.
const INTERNAL_OHM: f64 = 0.31;
const DRAIN_V_S: f64 = 0.002;

#[derive(Clone, Debug)]
pub(super) struct Drive {
    start_s: f64,
    duty: [Vec<f64>; 2],
}

impl Drive {
    pub(super) fn new(
        gait: &Gait,
        start_s: f64,
        times_s: &[f64],
        random: &mut RandomStream,
    ) -> Self {
        let duty = LegSide::BOTH.map(|side| {
            let at = |&time_s: &f64| {
                let scatter = random.normal();
                if time_s < start_s {
                    return 0.0;
                }
                if gait.is_stalled(time_s) {
                    return DUTY_LIMIT;
                }
                let feet = libm::sin(2.0 * gait.angle_rad(side, time_s));
                let duty = DUTY[0] + DUTY[1] * scatter + FEET_DUTY * feet;
                duty.clamp(-DUTY_LIMIT, DUTY_LIMIT).round()
            };
            times_s.iter().map(at).collect()
        });
        Self { start_s, duty }
    }

    pub(super) fn duty(&self, side: LegSide, row: usize) -> f64 {
        self.duty[side as usize][row]
    }

    pub(super) fn back_emf_v(gait: &Gait, side: LegSide, time_s: f64) -> f64 {
        BACK_EMF_V_S * gait.speed_rad_s(side, time_s)
    }

    pub(super) fn battery_v(&self, gait: &Gait, row: usize, time_s: f64) -> f64 {
        let drained_v = DRAIN_V_S * (time_s - self.start_s).max(0.0);
        // I = |d| (V − e)/R for each, V = V₀ − r ΣI.
        let (mut conductance, mut from_emf) = (0.0, 0.0);
        for side in LegSide::BOTH {
            let share = self.duty(side, row).abs() / FULL_DUTY / CONSTANTS.motor_resistance_ohm;
            conductance += share;
            from_emf += share * Self::back_emf_v(gait, side, time_s);
        }
        (OPEN_V - drained_v + INTERNAL_OHM * from_emf) / (1.0 + INTERNAL_OHM * conductance)
    }

    pub(super) fn power_w(&self, gait: &Gait, row: usize, time_s: f64) -> f64 {
        let battery_v = self.battery_v(gait, row, time_s);
        let of = |side: LegSide| {
            let above_emf_v = battery_v - Self::back_emf_v(gait, side, time_s);
            let share = self.duty(side, row) / FULL_DUTY;
            (share * battery_v * above_emf_v / CONSTANTS.motor_resistance_ohm).abs()
        };
        LegSide::BOTH.into_iter().map(of).sum()
    }
}

/// Mean power of both motors, W, to some percent. It sets the robot's speed, but is no reference value.
pub(super) fn usual_power_w(stride_hz: f64) -> f64 {
    let battery_v = 3.76;
    let emf_v = BACK_EMF_V_S * std::f64::consts::TAU * stride_hz;
    // Negative duty counts as power too, and is limited: a mean of 1,550 counts becomes 1,560.
    2.0 * 1560.0 / FULL_DUTY * battery_v * (battery_v - emf_v).abs()
        / CONSTANTS.motor_resistance_ohm
}
