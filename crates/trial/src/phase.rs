//! Drag and lift against the phase of the leg, over many strides.

use std::f64::consts::TAU;

use super::trace::Trace;
use shell_data::statistics::RunningVariance;
use shell_data::wrench::Axis;

pub(crate) const PHASES: usize = 32;

/// Mean and standard deviation between strides, in N, for each of `PHASES` equal bins of the phase.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct PhaseForce {
    /// Mean over the strides of the mean in a bin.
    pub mean_n: Vec<f64>,
    /// Standard deviation between strides; 0 for a single stride.
    pub sd_n: Vec<f64>,
}

#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct PhaseProfile {
    pub strides: usize,
    pub phase_rad: Vec<f64>,
    /// Drag, −Fx.
    pub drag: PhaseForce,
    pub lift: PhaseForce,
}

impl PhaseProfile {
    /// Averages the whole strides of a trace in a window, s, except strides without a row in some
    /// bin (stalls, missing rows). `None` without forces or strides.
    pub fn new(trace: &Trace, [from_s, to_s]: [f64; 2]) -> Option<Self> {
        let spans = trace.stride_times_s.windows(2).map(|pair| [pair[0], pair[1]]);
        let spans = spans.filter(|[start, end]| *start >= from_s && *end <= to_s);
        let both = |span| {
            Some((stride(trace, span, Axis::Fx, -1.0)?, stride(trace, span, Axis::Fz, 1.0)?))
        };
        let (drags, lifts): (Vec<_>, Vec<_>) = spans.filter_map(both).unzip();
        let phase = |i: usize| TAU * (i as f64 + 0.5) / PHASES as f64;
        (!drags.is_empty()).then(|| Self {
            strides: drags.len(),
            phase_rad: (0..PHASES).map(phase).collect(),
            drag: PhaseForce::from_strides(&drags),
            lift: PhaseForce::from_strides(&lifts),
        })
    }

    pub fn merged(&self, other: &Self) -> Self {
        let strides = self.strides + other.strides;
        let force = |a: &PhaseForce, b: &PhaseForce| {
            let merged = (0..PHASES).map(|i| {
                let mut all = a.at(i, self.strides);
                all.merge(&b.at(i, other.strides));
                all
            });
            let (mean_n, squares): (Vec<f64>, Vec<f64>) =
                merged.map(|all| (all.mean, all.squares)).unzip();
            let sd = |square: f64| (square / (strides as f64 - 1.0)).sqrt();
            PhaseForce { mean_n, sd_n: squares.into_iter().map(sd).collect() }
        };
        Self {
            strides,
            phase_rad: self.phase_rad.clone(),
            drag: force(&self.drag, &other.drag),
            lift: force(&self.lift, &other.lift),
        }
    }
}

impl PhaseForce {
    /// Mean and squared deviations over `strides` in bin `i` of the phase.
    fn at(&self, i: usize, strides: usize) -> RunningVariance {
        let squares = self.sd_n[i] * self.sd_n[i] * (strides as f64 - 1.0);
        RunningVariance { count: strides as u64, mean: self.mean_n[i], squares }
    }

    fn from_strides(strides: &[[f64; PHASES]]) -> Self {
        let n = strides.len() as f64;
        let mean = |i: usize| strides.iter().map(|stride| stride[i]).sum::<f64>() / n;
        let mean_n: Vec<f64> = (0..PHASES).map(mean).collect();
        let sd = |i: usize| {
            let squares: f64 = strides.iter().map(|s| (s[i] - mean_n[i]).powi(2)).sum();
            (squares / (n - 1.0).max(1.0)).sqrt()
        };
        let sd_n = (0..PHASES).map(sd).collect();
        Self { mean_n, sd_n }
    }
}

fn stride(trace: &Trace, [from, to]: [f64; 2], axis: Axis, sign: f64) -> Option<[f64; PHASES]> {
    let rows = trace.t_s.partition_point(|&t| t < from)..trace.t_s.partition_point(|&t| t < to);
    let force = trace.wrench[axis.index()].get(rows.clone())?;
    let angle = trace.right_leg_rad.get(rows)?;
    let forward = if angle.last()? >= angle.first()? { 1.0 } else { -1.0 };
    let (mut sums, mut counts) = ([0.0; PHASES], [0_u32; PHASES]);
    for (force, angle) in force.iter().zip(angle) {
        // A stride goes from phase 0 to phase 2π.
        let turn = (forward * angle / TAU).rem_euclid(1.0);
        let bin = ((turn * PHASES as f64) as usize).min(PHASES - 1);
        sums[bin] += sign * force;
        counts[bin] += 1;
    }
    let mean = |i: usize| sums[i] / f64::from(counts[i]);
    counts.iter().all(|&count| count > 0).then(|| std::array::from_fn(mean))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 20 strides of 0.1 s with 96 rows each: drag cos φ ± 0.1 with alternating sign, lift sin 2φ.
    fn trace(backwards: bool) -> Trace {
        let t_s: Vec<f64> = (0..1920).map(|i| 0.1 / 96.0 * (f64::from(i) + 0.5)).collect();
        let angle: Vec<f64> = t_s.iter().map(|t| TAU * t / 0.1).collect();
        let mut trace = Trace {
            stride_times_s: (0..=20).map(|i| 0.1 * f64::from(i) - 1e-9).collect(),
            ..Trace::default()
        };
        trace.wrench[0] = angle
            .iter()
            .zip(&t_s)
            .map(|(angle, t)| {
                -angle.cos() - if ((t / 0.1 + 1e-6) as u32).is_multiple_of(2) { 0.1 } else { -0.1 }
            })
            .collect();
        trace.wrench[2] = angle.iter().map(|angle| (2.0 * angle).sin()).collect();
        trace.right_leg_rad =
            angle.iter().map(|angle| if backwards { -angle } else { *angle }).collect();
        trace.t_s = t_s;
        trace
    }

    #[test]
    fn mean_and_spread_equal_those_of_the_forces_at_a_phase() {
        for backwards in [false, true] {
            let trace = trace(backwards);
            let profile = PhaseProfile::new(&trace, [0.05, 1.95]).unwrap();
            // The first stride starts before the window, the last ends after it.
            assert_eq!(profile.strides, 18);
            for (i, phase) in profile.phase_rad.iter().enumerate() {
                // Three rows in a bin of width w = 0.2 rad, w/3 apart: their mean is the value at
                // the middle less (2/3)(kw/3)²/2 of it, 0.6 % for k = 2.
                assert!((profile.drag.mean_n[i] - phase.cos()).abs() < 0.0015);
                assert!((profile.lift.mean_n[i] - (2.0 * phase).sin()).abs() < 0.006);
                // ±0.1 alternating, 18 strides: sd 0.1 · √(18/17).
                assert!((profile.drag.sd_n[i] - 0.1 * (18.0_f64 / 17.0).sqrt()).abs() < 1e-9);
                assert!(profile.lift.sd_n[i] < 1e-9);
            }
        }
    }

    #[test]
    fn parts_merge_to_the_whole() {
        let trace = trace(false);
        let of = |from, to| PhaseProfile::new(&trace, [from, to]).unwrap();
        let (whole, merged) = (of(0.05, 1.95), of(0.05, 0.75).merged(&of(0.65, 1.95)));
        assert_eq!(whole.strides, merged.strides);
        for (a, b) in [(&whole.drag, &merged.drag), (&whole.lift, &merged.lift)] {
            let pairs = a.mean_n.iter().chain(&a.sd_n).zip(b.mean_n.iter().chain(&b.sd_n));
            // The eighteen values have another order; a deviation of zero becomes the root of rounding errors.
            assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-7));
        }
    }

    #[test]
    fn a_trace_without_forces_or_strides_has_no_profile() {
        let whole = [f64::NEG_INFINITY, f64::INFINITY];
        assert_eq!(PhaseProfile::new(&Trace::default(), whole), None);
        let without_forces = Trace { wrench: Default::default(), ..trace(false) };
        assert_eq!(PhaseProfile::new(&without_forces, whole), None);
        let without_strides = Trace { stride_times_s: vec![], ..trace(false) };
        assert_eq!(PhaseProfile::new(&without_strides, whole), None);
    }
}
