//! The legs: angle over time, and the speed that follows.
//!
//! Both sides are driven at one stride frequency f, half a turn apart (alternating tripods). The
//! drive's angle starts and stops smoothly,
//!
//! ```text
//! θ(t) = 2π f [U(t − t₀) − U(t − t₁) + U(t − t₂)],  U' a smooth step, stalled from t₁ to t₂,
//! ```
//!
//! and a leg deviates from it twice a turn (its feet load it) and slowly (the controller permits
//! it): φ = θ + a sin(2θ + α) + b sin(θ/5 + β), with a and b so small that φ never runs backwards.

use std::f64::consts::{PI, TAU};

use shell_data::random::RandomStream;

/// Time from standstill to full speed.
const SPIN_UP_S: f64 = 0.06;
/// Amplitude of a leg's deviation twice a turn, rad.
const AHEAD_RAD: f64 = 0.06;
/// Amplitude of a leg's slow deviation, rad, and its period in turns.
const WANDER_RAD: f64 = 0.15;
const WANDER_TURNS: f64 = 5.0;

#[derive(Clone, Debug)]
pub struct Gait {
    stride_hz: f64,
    start_s: f64,
    stall_s: Option<[f64; 2]>,
    legs: [Leg; 2],
}

#[derive(Clone, Copy, Debug)]
struct Leg {
    offset_rad: f64,
    ahead_phase_rad: f64,
    wander_phase_rad: f64,
}

/// A side, in the order of the telemetry's columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LegSide {
    /// The leg that strides are counted on.
    Right,
    Left,
}

impl LegSide {
    pub const BOTH: [LegSide; 2] = [LegSide::Right, LegSide::Left];
}

impl Gait {
    pub(super) fn new(
        stride_hz: f64,
        start_s: f64,
        stall_s: Option<[f64; 2]>,
        random: &mut RandomStream,
    ) -> Self {
        let first_rad = random.between(0.0, TAU);
        let mut leg = |offset_rad| Leg {
            offset_rad,
            ahead_phase_rad: random.between(0.0, TAU),
            wander_phase_rad: random.between(0.0, TAU),
        };
        let legs = [leg(first_rad), leg(first_rad + PI)];
        Self { stride_hz, start_s, stall_s, legs }
    }

    pub fn angle_rad(&self, side: LegSide, time_s: f64) -> f64 {
        self.leg(side).angle_rad(self.drive_rad(time_s))
    }

    pub(crate) fn speed_rad_s(&self, side: LegSide, time_s: f64) -> f64 {
        TAU * self.stride_hz * self.share(time_s) * self.leg(side).slope(self.drive_rad(time_s))
    }

    pub(super) fn commanded_rad(&self, side: LegSide, time_s: f64) -> f64 {
        self.drive_rad(time_s) + self.leg(side).offset_rad
    }

    pub(super) fn share(&self, time_s: f64) -> f64 {
        let step = |from_s: f64| smooth_step((time_s - from_s) / SPIN_UP_S);
        step(self.start_s) - self.stall_s.map_or(0.0, |[from, to]| step(from) - step(to))
    }

    /// Returns true if the legs are stalled: held although they are driven.
    pub(super) fn is_stalled(&self, time_s: f64) -> bool {
        self.stall_s.is_some_and(|[from, to]| (from..to).contains(&time_s))
    }

    /// Returns the time between start and `end_s` at which the leg reaches `angle_rad`, to a nanosecond.
    pub(crate) fn time_of(&self, side: LegSide, angle_rad: f64, end_s: f64) -> Option<f64> {
        let (mut low, mut high) = (self.start_s, end_s);
        let reached = |time_s: f64| self.angle_rad(side, time_s) >= angle_rad;
        if reached(low) || !reached(high) {
            return None;
        }
        while high - low > 1e-9 {
            let middle = 0.5 * (low + high);
            if reached(middle) { high = middle } else { low = middle }
        }
        Some(high)
    }

    fn drive_rad(&self, time_s: f64) -> f64 {
        let ramp = |from_s: f64| SPIN_UP_S * smooth_ramp((time_s - from_s) / SPIN_UP_S);
        let lost = self.stall_s.map_or(0.0, |[from, to]| ramp(from) - ramp(to));
        TAU * self.stride_hz * (ramp(self.start_s) - lost)
    }

    fn leg(&self, side: LegSide) -> &Leg {
        &self.legs[side as usize]
    }
}

impl Leg {
    fn angle_rad(&self, drive: f64) -> f64 {
        let ahead = AHEAD_RAD * libm::sin(2.0 * drive + self.ahead_phase_rad);
        let wander = WANDER_RAD * libm::sin(drive / WANDER_TURNS + self.wander_phase_rad);
        drive + self.offset_rad + ahead + wander
    }

    /// dφ/dθ.
    fn slope(&self, drive: f64) -> f64 {
        let ahead = 2.0 * AHEAD_RAD * libm::cos(2.0 * drive + self.ahead_phase_rad);
        let wander = libm::cos(drive / WANDER_TURNS + self.wander_phase_rad);
        1.0 + ahead + WANDER_RAD / WANDER_TURNS * wander
    }
}

/// Rises from 0 at x ≤ 0 to 1 at x ≥ 1 with a continuous slope.
pub(super) fn smooth_step(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

fn smooth_ramp(x: f64) -> f64 {
    let u = x.clamp(0.0, 1.0);
    u * u * u * (1.0 - 0.5 * u) + (x - 1.0).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use shell_data::random::Purpose;

    fn gait() -> Gait {
        Gait::new(13.0, 1.0, Some([2.0, 2.4]), &mut RandomStream::new(1, Purpose::Trial, 0))
    }

    #[test]
    fn speed_is_the_slope_of_the_angle_and_never_negative() {
        let gait = gait();
        for side in LegSide::BOTH {
            for step in 0..4000 {
                let (t, h) = (0.0007 + 1e-3 * f64::from(step), 1e-5);
                let slope = (gait.angle_rad(side, t + h) - gait.angle_rad(side, t - h)) / (2.0 * h);
                let speed = gait.speed_rad_s(side, t);
                // Central difference: error h²/6 φ''', φ''' < 13² · 2π · 100³ near a step's corner.
                assert!((slope - speed).abs() < 0.1, "{t}: {slope} {speed}");
                assert!(speed >= 0.0);
            }
        }
    }

    #[test]
    fn a_stalled_leg_stands_and_goes_on_where_it_stood() {
        let gait = gait();
        let angle = |t| gait.angle_rad(LegSide::Right, t);
        assert_eq!(angle(0.0), angle(1.0));
        assert_eq!(angle(2.1), angle(2.39));
        assert!(angle(2.6) > angle(2.39) + 10.0);
        let stride_hz = (angle(9.0) - angle(4.0)) / (5.0 * TAU);
        // At most 2 (0.06 + 0.15) rad over 5 s.
        assert!((stride_hz - 13.0).abs() < 0.42 / (5.0 * TAU));
    }

    #[test]
    fn the_time_of_an_angle_is_where_the_angle_is() {
        let gait = gait();
        for turn in 1..50 {
            let angle = TAU * f64::from(turn);
            let time_s = gait.time_of(LegSide::Right, angle, 10.0).unwrap();
            // A nanosecond at 90 rad/s.
            assert!((gait.angle_rad(LegSide::Right, time_s) - angle).abs() < 2e-7);
        }
        assert_eq!(gait.time_of(LegSide::Right, 1e4, 10.0), None);
        assert_eq!(gait.time_of(LegSide::Right, 0.0, 10.0), None);
    }
}
