//! Forces of beams and legs on the shell.

use std::f64::consts::TAU;

use super::gait::smooth_step;
use shell_data::random::RandomStream;
use shell_data::wrench::{PerAxis, cross};

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct ChannelForces {
    /// Name in manifests: the largest deflection of the beams.
    pub name: &'static str,
    /// Mean drag in the channel, N.
    pub drag_n: f64,
    /// Mean lift, N; negative presses the robot down.
    pub lift_n: f64,
    /// Determines the robot's speed at its motors' power.
    pub specific_resistance: f64,
}

impl ChannelForces {
    /// The five channels of the paper, with its mean specific resistances and, for 1, 2 and 3 cm,
    /// its mean drag (§V-B). At 0 cm the energies per stride, −0.52 against −9.12 mJ, put the drag
    /// at 0.52/9.12 · 0.13 N. The paper plots the lift without numbers: negative, growing with the
    /// drag; here it is 1.2 times as large.
    pub const PAPER: [Self; 5] = {
        const fn of(name: &'static str, drag_n: f64, specific_resistance: f64) -> ChannelForces {
            ChannelForces { name, drag_n, lift_n: -1.2 * drag_n, specific_resistance }
        }
        [
            of("free", 0.0, 45.2),
            of("0 cm", 0.0074, 48.0),
            of("1 cm", 0.03, 41.1),
            of("2 cm", 0.08, 42.9),
            of("3 cm", 0.13, 49.5),
        ]
    };

    pub fn named(name: &str) -> Option<Self> {
        Self::PAPER.into_iter().find(|condition| condition.name == name)
    }
}

#[derive(Clone, Debug)]
pub(super) struct BeamContact {
    condition: ChannelForces,
    window_s: [f64; 2],
    entering: f64,
    beams: [Wave; 4],
    legs: [[Wave; 2]; 3],
}

/// A sine of time, relative to the channel's mean force, or of the leg angle, in N.
#[derive(Clone, Copy, Debug)]
struct Wave {
    size: f64,
    rate: f64,
    phase_rad: f64,
}

impl Wave {
    fn at(&self, argument: f64) -> f64 {
        self.size * libm::sin(self.rate * argument + self.phase_rad)
    }
}

/// Distance between beams along the channel, m (paper, §IV-A).
const BEAM_PITCH_M: f64 = 0.025;
/// Amplitudes of the legs' shaking per axis, N, at the stride frequency and twice that, as in reality.
const SHAKING_N: [[f64; 2]; 3] = [[0.10, 0.05], [0.12, 0.06], [0.15, 0.08]];
/// Point of pressure relative to the sensor's origin: ahead and above, m.
const CONTACT_M: [f64; 3] = [0.02, 0.0, 0.02];

impl BeamContact {
    /// Creates a contact over `window_s`; entry and exit each take a share `entering` of it.
    pub(super) fn new(
        condition: ChannelForces,
        window_s: [f64; 2],
        entering: f64,
        velocity_m_s: f64,
        random: &mut RandomStream,
    ) -> Self {
        let mut wave = |size: f64, rate: f64| Wave {
            size: size * random.between(0.8, 1.2),
            rate,
            phase_rad: random.between(0.0, TAU),
        };
        // Five or six beams touch the shell at a time; and it sways.
        let beams = [
            wave(0.1, TAU * velocity_m_s / BEAM_PITCH_M),
            wave(0.12, TAU * 0.7),
            wave(0.10, TAU * 1.1),
            wave(0.08, TAU * 2.9),
        ];
        // The robot shakes its shell in nearly the same way every time.
        let mut shaking = |size: f64, rate: f64, axis: usize| Wave {
            size: size * random.between(0.8, 1.2),
            rate,
            phase_rad: rate + 2.0 * axis as f64 + random.between(-0.3, 0.3),
        };
        let legs = std::array::from_fn(|axis| {
            let [once, twice] = SHAKING_N[axis];
            [shaking(once, 1.0, axis), shaking(twice, 2.0, axis)]
        });
        Self { condition, window_s, entering, beams, legs }
    }

    /// Returns the wrench, N and N·m; `running` is the share of full speed.
    pub(super) fn wrench_at(&self, time_s: f64, leg_rad: f64, running: f64) -> PerAxis<f64> {
        let sway: f64 = self.beams.iter().map(|wave| wave.at(time_s)).sum();
        let level = self.profile(time_s) * (1.0 + sway);
        let beams = [-self.condition.drag_n * level, 0.0, self.condition.lift_n * level];
        let shaking =
            self.legs.map(|[once, twice]| running * (once.at(leg_rad) + twice.at(leg_rad)));
        let force: [f64; 3] = std::array::from_fn(|axis| beams[axis] + shaking[axis]);
        let moment = cross(CONTACT_M, beams);
        std::array::from_fn(|axis| if axis < 3 { force[axis] } else { moment[axis - 3] })
    }

    /// Rises, stays and falls: 0 outside the window, and 1 in it on average.
    fn profile(&self, time_s: f64) -> f64 {
        let [enter_s, exit_s] = self.window_s;
        let ramp_s = self.entering * (exit_s - enter_s);
        let share =
            smooth_step((time_s - enter_s) / ramp_s) * smooth_step((exit_s - time_s) / ramp_s);
        // A ramp is half on average.
        share / (1.0 - self.entering)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shell_data::random::Purpose;

    #[test]
    fn the_mean_drag_and_lift_equal_those_of_the_condition() {
        let condition = ChannelForces::named("3 cm").unwrap();
        for seed in 0..20 {
            let mut random = RandomStream::new(seed, Purpose::Trial, 0);
            let contact = BeamContact::new(condition, [1.0, 7.0], 0.39, 0.047, &mut random);
            let mean = |axis: usize| {
                (0..6000)
                    .map(|i| contact.wrench_at(1.0005 + 1e-3 * f64::from(i), 0.0, 0.0)[axis])
                    .sum::<f64>()
                    / 6000.0
            };
            // The sway goes through at least four cycles, except at the ends: within a tenth or so.
            assert!((mean(0) / -0.13 - 1.0).abs() < 0.15, "{}", mean(0));
            assert!((mean(2) / (-0.13 * 1.2) - 1.0).abs() < 0.15);
            assert_eq!(contact.wrench_at(0.9, 0.0, 0.0), [-0.0, 0.0, -0.0, 0.0, 0.0, 0.0]);
        }
    }
}
