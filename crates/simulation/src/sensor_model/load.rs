//! Loads applied to a shell by hand, each contact a pose; and loads from a table.
//!
//! The shell is half an ellipsoid of the robot's size (18 cm × 11 cm × 4.5 cm: Table I of the paper on the shell). In a
//! pose of 2 s a contact rises, dwells and falls, and sways, band-limited below 3 Hz. In every four poses, the second is a
//! pull with a twist (the shell held), the fourth has taps, and the others are pushes. Contact points follow a
//! low-discrepancy sequence (Roberts' R₂), so that even short recordings load every axis in both directions.
//!
//! A load is a function of time alone, so sensors with separate clocks can share it.

use std::f64::consts::{PI, TAU};

use crate::SimulationError;
use shell_data::random::{Purpose, RandomStream};
use shell_data::wrench::{PerAxis, cross};

pub(crate) const POSE_S: f64 = 2.0;

/// Half-axes of the shell, m.
const SHELL_M: [f64; 3] = [0.09, 0.055, 0.045];
/// Largest moment of a contact's mean force: hands yield before the plate reaches its stop.
const MOMENT_NM: f64 = 0.1;
const RISE_S: f64 = 0.25;
const REST_S: f64 = 0.1;
const TAPS: u32 = 4;
const TAP_S: f64 = 0.08;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RecordingKind {
    Training,
    /// Loads that differ from those of every training recording.
    Test,
    Zero,
}

#[derive(Clone, Debug)]
pub struct LoadScript {
    poses: Option<(Purpose, u64)>,
    first: [f64; 2],
    current: Option<(u64, ShellContact)>,
}

impl LoadScript {
    pub fn new(kind: RecordingKind, seed: u64) -> Self {
        let purpose = match kind {
            RecordingKind::Training => Purpose::TrainingPoses,
            RecordingKind::Test => Purpose::TestPoses,
            RecordingKind::Zero => return Self { poses: None, first: [0.0; 2], current: None },
        };
        let mut stream = RandomStream::new(seed, purpose, u64::MAX);
        let first = std::array::from_fn(|_| stream.uniform());
        Self { poses: Some((purpose, seed)), first, current: None }
    }

    pub(crate) fn pose_number(time_s: f64) -> u64 {
        (time_s / POSE_S) as u64
    }

    /// Wrench at `time_s` ≥ 0 since the start: N and N·m, shell frame. The last pose is cached for
    /// ascending times.
    pub fn wrench_at(&mut self, time_s: f64) -> PerAxis<f64> {
        let Some((purpose, seed)) = self.poses else {
            return [0.0; 6];
        };
        let number = Self::pose_number(time_s);
        let pose = match self.current {
            Some((current, pose)) if current == number => pose,
            _ => {
                ShellContact::new(&mut RandomStream::new(seed, purpose, number), number, self.first)
            }
        };
        self.current = Some((number, pose));
        pose.wrench_at(time_s - number as f64 * POSE_S)
    }
}

#[derive(Clone, Copy, Debug)]
struct ShellContact {
    point_m: [f64; 3],
    force_n: [f64; 3],
    couple_nm: [f64; 3],
    sway: [Sway; 3],
    taps: bool,
}

#[derive(Clone, Copy, Debug)]
struct Sway {
    force_n: [f64; 3],
    frequency_hz: f64,
    phase_rad: f64,
}

impl ShellContact {
    fn new(stream: &mut RandomStream, number: u64, first: [f64; 2]) -> Self {
        // Roberts' R₂: multiples of 1/ρ and 1/ρ², ρ³ = ρ + 1.
        let step = |k: usize, ratio: f64| (first[k] + number as f64 * ratio) % 1.0;
        let azimuth = TAU * step(0, 0.754_877_666_246_692_7);
        let sin_elevation = step(1, 0.569_840_290_998_053_2);
        let cos_elevation = (1.0 - sin_elevation * sin_elevation).sqrt();
        let (sin, cos) = libm::sincos(azimuth);
        let on_sphere = [cos_elevation * cos, cos_elevation * sin, sin_elevation];
        let point_m = std::array::from_fn(|a| SHELL_M[a] * on_sphere[a]);
        let normal = unit(std::array::from_fn(|a| on_sphere[a] / SHELL_M[a]));

        let held = number % 4 == 1;
        let inward = if held { 1.0 } else { -1.0 };
        let along = unit(std::array::from_fn(|_| stream.normal()));
        let friction = stream.between(0.0, 0.5);
        let direction = unit(std::array::from_fn(|a| inward * normal[a] + friction * along[a]));
        let mut size_n = stream.between(0.8, 3.0);
        size_n = size_n.min(MOMENT_NM / norm(cross(point_m, direction)).max(1e-3));
        let twist_nm = if held { 0.05 } else { 0.0 };
        let couple_nm = std::array::from_fn(|_| stream.between(-twist_nm, twist_nm));
        let sway = std::array::from_fn(|_| Sway {
            force_n: std::array::from_fn(|_| 0.12 * size_n * stream.normal()),
            frequency_hz: stream.between(0.4, 3.0),
            phase_rad: stream.between(0.0, TAU),
        });
        Self {
            point_m,
            force_n: direction.map(|d| size_n * d),
            couple_nm,
            sway,
            taps: number % 4 == 3,
        }
    }

    fn wrench_at(&self, time_s: f64) -> PerAxis<f64> {
        let share = if self.taps { taps(time_s) } else { contact(time_s) };
        let mut force = self.force_n;
        for sway in &self.sway {
            let swing = libm::sin(TAU * sway.frequency_hz * time_s + sway.phase_rad);
            for (force, part) in force.iter_mut().zip(sway.force_n) {
                *force += swing * part;
            }
        }
        let moment = cross(self.point_m, force);
        std::array::from_fn(|axis| match axis {
            0..3 => share * force[axis],
            _ => share * (moment[axis - 3] + self.couple_nm[axis - 3]),
        })
    }
}

/// Rise, dwell, fall, pause: between 0 and 1, with two continuous derivatives.
fn contact(time_s: f64) -> f64 {
    smooth_step(time_s / RISE_S) * smooth_step((POSE_S - REST_S - time_s) / RISE_S)
}

fn taps(time_s: f64) -> f64 {
    let period_s = POSE_S / f64::from(TAPS);
    let phase = (time_s % period_s - 0.5 * (period_s - TAP_S)) / TAP_S;
    if !(0.0..1.0).contains(&phase) {
        return 0.0;
    }
    let sin = libm::sin(PI * phase);
    sin * sin
}

/// Rises from 0 at x ≤ 0 to 1 at x ≥ 1, with two continuous derivatives.
fn smooth_step(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * x * (10.0 + x * (6.0 * x - 15.0))
}

fn norm(v: [f64; 3]) -> f64 {
    (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt()
}

fn unit(v: [f64; 3]) -> [f64; 3] {
    let norm = norm(v);
    v.map(|x| x / norm)
}

#[derive(Clone, Debug, PartialEq)]
pub struct LoadTable {
    times_s: Vec<f64>,
    wrenches: Vec<PerAxis<f64>>,
}

impl LoadTable {
    /// Creates a table; its first time is the start.
    ///
    /// # Errors
    /// [`SimulationError`] without rows, if times do not ascend, or numbers are not finite.
    pub fn new(
        rows: impl IntoIterator<Item = (f64, PerAxis<f64>)>,
    ) -> Result<Self, SimulationError> {
        let (mut times_s, mut wrenches) = (Vec::<f64>::new(), Vec::new());
        for (row, (time_s, wrench)) in (1..).zip(rows) {
            let is_later = time_s.is_finite() && times_s.last().is_none_or(|&last| time_s > last);
            ensure!(
                is_later,
                "data row {row}: time {time_s} s does not come after the time of the row before"
            );
            let is_finite = wrench.iter().all(|value| value.is_finite());
            ensure!(is_finite, "data row {row}: a load that is not finite");
            times_s.push(time_s);
            wrenches.push(wrench);
        }
        ensure!(!times_s.is_empty(), "no rows");
        Ok(Self { times_s, wrenches })
    }

    /// Returns the wrench (N and N·m) at `time_s` ≥ 0; the table repeats, its first row directly after its last.
    pub fn wrench_at(&self, time_s: f64) -> PerAxis<f64> {
        let (first, last) = (self.times_s[0], self.times_s[self.times_s.len() - 1]);
        if last == first {
            return self.wrenches[0];
        }
        let time_s = first + time_s % (last - first);
        let after = self.times_s.partition_point(|&at| at <= time_s);
        let Some(&right_s) = self.times_s.get(after) else {
            return self.wrenches[after - 1];
        };
        let left_s = self.times_s[after - 1];
        let share = (time_s - left_s) / (right_s - left_s);
        let (left, right) = (self.wrenches[after - 1], self.wrenches[after]);
        std::array::from_fn(|axis| left[axis] + share * (right[axis] - left[axis]))
    }
}

#[cfg(test)]
mod tests {
    use super::RecordingKind::{Test, Training};
    use super::*;

    #[test]
    fn thirty_poses_load_every_axis_both_ways() {
        for mut script in
            [LoadScript::new(Training, 1), LoadScript::new(Training, 9), LoadScript::new(Test, 1)]
        {
            let mut extremes = [[0.0_f64; 2]; 6];
            for step in 0..6000 {
                for (extreme, w) in extremes.iter_mut().zip(script.wrench_at(0.01 * step as f64)) {
                    *extreme = [extreme[0].min(w), extreme[1].max(w)];
                }
            }
            for (axis, [low, high]) in extremes.into_iter().enumerate() {
                let least = if axis < 3 { 0.7 } else { 0.02 };
                assert!(low < -least && high > least, "axis {axis}: {low} to {high}");
            }
        }
    }

    #[test]
    fn load_is_a_function_of_time_alone() {
        let mut forward = LoadScript::new(Training, 5);
        let times: Vec<f64> = (0..500).map(|i| 0.037 * f64::from(i)).collect();
        let along: Vec<_> = times.iter().map(|&t| forward.wrench_at(t)).collect();
        let mut backward = LoadScript::new(Training, 5);
        let back: Vec<_> = times.iter().rev().map(|&t| backward.wrench_at(t)).collect();
        assert!(along.iter().eq(back.iter().rev()));
    }

    #[test]
    fn load_is_smooth_also_from_pose_to_pose() {
        let mut script = LoadScript::new(Training, 2);
        let mut before = script.wrench_at(0.0);
        for step in 1..200_000 {
            let wrench = script.wrench_at(1e-4 * f64::from(step));
            for axis in 0..3 {
                // A tap of 4 N in 0.08 s rises by 4 N · π/0.08 s = 160 N/s at most.
                assert!((wrench[axis] - before[axis]).abs() < 0.03);
            }
            before = wrench;
        }
    }

    #[test]
    fn test_poses_are_not_those_of_the_training() {
        assert_ne!(
            LoadScript::new(Training, 1).wrench_at(1.0),
            LoadScript::new(Test, 1).wrench_at(1.0)
        );
        assert_ne!(
            LoadScript::new(Training, 1).wrench_at(1.0),
            LoadScript::new(Training, 2).wrench_at(1.0)
        );
        assert_eq!(LoadScript::new(RecordingKind::Zero, 1).wrench_at(1.0), [0.0; 6]);
    }

    fn along_x(newton: f64) -> PerAxis<f64> {
        [newton, 0.0, 0.0, 0.0, 0.0, 0.0]
    }

    #[test]
    fn loads_lie_on_straight_lines_and_repeat() {
        let table =
            LoadTable::new([(5.0, along_x(0.0)), (6.0, along_x(2.0)), (9.0, along_x(-1.0))]);
        let table = table.unwrap();
        for (time_s, newton) in
            [(0.0, 0.0), (0.5, 1.0), (1.0, 2.0), (2.5, 0.5), (4.0, 0.0), (4.25, 0.5)]
        {
            assert_eq!(table.wrench_at(time_s), along_x(newton), "{time_s}");
        }
    }

    #[test]
    fn a_single_row_is_a_constant_load() {
        let table = LoadTable::new([(3.0, along_x(1.5))]).unwrap();
        assert_eq!(table.wrench_at(1e6), along_x(1.5));
    }

    #[test]
    fn invalid_load_tables_are_refused() {
        let refused = |rows: &[(f64, PerAxis<f64>)]| {
            LoadTable::new(rows.iter().copied()).unwrap_err().to_string()
        };
        assert_eq!(refused(&[]), "no rows");
        let twice = refused(&[(1.0, along_x(0.0)), (1.0, along_x(1.0))]);
        assert!(twice.starts_with("data row 2: time 1 s does not come after"), "{twice}");
        let infinite = refused(&[(0.0, along_x(f64::INFINITY))]);
        assert_eq!(infinite, "data row 1: a load that is not finite");
        assert!(LoadTable::new([(f64::NAN, along_x(0.0))]).is_err());
    }
}
