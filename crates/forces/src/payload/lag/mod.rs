//! Lag between the clock of a motion and that of a wrench.
//!
//! A payload's forces step when its gravity steps. A step is the difference between the means of adjoining blocks of
//! time, so a lasting push affects few steps. The lag is the one with the smallest sum of absolute residuals, to which
//! rare taps contribute little. Short blocks separate fast motions from pushes; long blocks separate slow motions from
//! noise. The block length is used at which the best lag reduces the residuals most.
//!
//! Contact that follows the motion biases the lag without adding scatter. It can have any phase relative to gravity,
//! whereas a lag acts in quadrature. So the in-phase part of the residuals is added to the standard error.

use std::array::from_fn;

use serde::Serialize;

use super::motion::Integral;
use super::vector::{Vector, dot, norm, scaled, subtract};
use super::{Motion, Payload};
use shell_data::statistics::RunningVariance;

/// Lengths of the blocks, s. Vibrations faster than the shortest would fit at several lags.
const LENGTHS_S: [f64; 4] = [0.03, 0.06, 0.12, 0.24];
/// Number of steps from zero to the largest lag searched, in either direction.
const LARGEST: usize = 100;
const STEP_S: f64 = 0.001;
/// Steps between rows: closer rows share most of their samples.
const ROW: usize = 5;
const MOST_ROWS: usize = 20_000;
/// Number of parts of the recording whose scatter gives the standard error.
const PARTS: usize = 20;
/// Lags at least this number of steps from the best must be worse …
const FAR: usize = 10;
/// … by this number of standard errors of the difference, which chance alone exceeds once in 300 cases.
const CLEAR: f64 = 3.0;
/// A negligible standard error, s: such an error of the lag leaves 6 % of a load at 10 Hz.
const SMALL_S: f64 = 0.001;

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Lag {
    /// Time on the clock of the motion minus that of the wrench, s.
    pub lag_s: f64,
    pub standard_error_s: f64,
}

impl Lag {
    pub fn is_certain(&self) -> bool {
        self.standard_error_s <= SMALL_S
    }

    /// Returns the lag to apply, s: zero if it is uncertain and within two standard errors of zero.
    pub fn taken_s(&self) -> f64 {
        let is_zero = !self.is_certain() && self.lag_s.abs() < 2.0 * self.standard_error_s;
        if is_zero { 0.0 } else { self.lag_s }
    }
}

/// Estimates the lag of a motion behind the forces, N, of a sensor that carries `payload`. `None` if no lag is clearly
/// best, as without motion or under larger contact forces.
pub fn find_lag(
    payload: &Payload,
    motion: &Motion,
    times_s: &[f64],
    forces: &[Vec<f64>; 3],
) -> Option<Lag> {
    let [x, y, z] = forces;
    let forces: Vec<Vector> = x.iter().zip(y).zip(z).map(|((x, y), z)| [*x, *y, *z]).collect();
    let forces = Motion::new(times_s, &forces).ok()?;
    let scans =
        LENGTHS_S.iter().filter_map(|&length_s| LagScan::new(payload, motion, &forces, length_s));
    scans.min_by(|a, b| a.left.total_cmp(&b.left))?.lag()
}

struct LagScan<'a> {
    length_s: f64,
    mass_kg: f64,
    gravity: Integral<'a>,
    rows: Vec<(f64, Vector)>,
    sums: Vec<[f64; PARTS]>,
    best: usize,
    /// The residual at the best lag, relative to the median of all lags.
    left: f64,
}

/// A row at a lag: the step of the load, its derivative by the lag, the residual and its weight.
struct LagRow {
    load: Vector,
    slope: Vector,
    left: Vector,
    weight: f64,
}

impl<'a> LagScan<'a> {
    /// Returns `None` for a recording that is too short for this length.
    fn new(payload: &Payload, motion: &'a Motion, forces: &Motion, length_s: f64) -> Option<Self> {
        let mass_kg = payload.mass_kg;
        let gravity = Integral::new(motion);
        let largest_s = LARGEST as f64 * STEP_S;
        let ((start, end), (first, last)) = (motion.span_s(), forces.span_s());
        let (start, end) = ((start + largest_s).max(first), (end - largest_s).min(last));
        let row_s = ROW as f64 * STEP_S;
        let count = ((end - start - 2.0 * length_s) / row_s).clamp(0.0, MOST_ROWS as f64) as usize;
        if (count as f64) * row_s < PARTS as f64 * length_s {
            return None;
        }
        let time = |step: usize| start + length_s + STEP_S * step as f64;
        let integral = Integral::new(forces);
        let row = |row: usize| (time(ROW * row), integral.step(time(ROW * row), length_s));
        let rows: Vec<(f64, Vector)> = (0..count).map(row).collect();
        let load = |step| scaled(gravity.step(time(step) - largest_s, length_s), mass_kg);
        let loads: Vec<Vector> = (0..ROW * count + 2 * LARGEST).map(load).collect();
        let sums_at = |lag: usize| {
            let mut sums = [0.0; PARTS];
            for (row, (_, force)) in rows.iter().enumerate() {
                sums[row * PARTS / count] += norm(subtract(*force, loads[ROW * row + lag]));
            }
            sums
        };
        let sums: Vec<[f64; PARTS]> = (0..=2 * LARGEST).map(sums_at).collect();
        let totals: Vec<f64> = sums.iter().map(|parts| parts.iter().sum()).collect();
        let best = (0..totals.len()).min_by(|a, b| totals[*a].total_cmp(&totals[*b]))?;
        let mut sorted = totals.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        let left = totals[best] / sorted[LARGEST];
        Some(Self { length_s, mass_kg, gravity, rows, sums, best, left })
    }

    fn lag(&self) -> Option<Lag> {
        let others = (0..self.sums.len()).filter(|lag| lag.abs_diff(self.best) >= FAR);
        let at_edge = self.best == 0 || self.best == 2 * LARGEST;
        if at_edge || !others.into_iter().all(|lag| self.is_worse(lag)) {
            return None;
        }
        // Least absolute values by iteratively reweighted least squares.
        let mut lag_s = (self.best as f64 - LARGEST as f64) * STEP_S;
        for _ in 0..20 {
            let (mut slope, mut square) = (0.0, 0.0);
            for row in self.rows_at(lag_s) {
                slope += row.weight * dot(row.slope, row.left);
                square += row.weight * dot(row.slope, row.slope);
            }
            lag_s += (slope / square).clamp(-STEP_S, STEP_S);
        }
        let rows = self.rows_at(lag_s);
        let mut parts = [0.0; PARTS];
        let (mut curvature, mut slopes) = (0.0, 0.0);
        let (mut in_phase, mut loads) = ([[0.0; 3]; 3], [0.0; 3]);
        for (i, LagRow { load, slope, left, weight }) in rows.iter().enumerate() {
            let pull = weight * dot(*slope, *left);
            parts[i * PARTS / rows.len()] += pull;
            slopes += weight * dot(*slope, *slope);
            curvature += weight * (dot(*slope, *slope) - pull * pull);
            for axis in 0..3 {
                loads[axis] += weight * load[axis] * load[axis];
                (0..3).for_each(|of| in_phase[axis][of] += weight * load[axis] * left[of]);
            }
        }
        let scatter = PARTS as f64 * standard_error(&parts) / curvature;
        let following: f64 = (0..3)
            .filter(|&axis| loads[axis] > 0.0)
            .map(|axis| dot(in_phase[axis], in_phase[axis]) / loads[axis])
            .sum();
        let standard_error_s = scatter.hypot((following / slopes).sqrt());
        (curvature > 0.0 && standard_error_s.is_finite()).then_some(Lag { lag_s, standard_error_s })
    }

    /// Returns true if a lag's residuals significantly exceed those of the best, by their scatter over the parts.
    fn is_worse(&self, lag: usize) -> bool {
        let more: [f64; PARTS] = from_fn(|part| self.sums[lag][part] - self.sums[self.best][part]);
        more.iter().sum::<f64>() / PARTS as f64 > CLEAR * standard_error(&more)
    }

    fn rows_at(&self, lag_s: f64) -> Vec<LagRow> {
        let load = |time: f64| scaled(self.gravity.step(time + lag_s, self.length_s), self.mass_kg);
        let row = |&(time, force): &(f64, Vector)| {
            let slope = subtract(load(time + STEP_S), load(time - STEP_S));
            let load = load(time);
            let slope = scaled(slope, 0.5 / STEP_S);
            LagRow { load, slope, left: subtract(force, load), weight: 0.0 }
        };
        let mut rows: Vec<LagRow> = self.rows.iter().map(row).collect();
        let mean = rows.iter().map(|row| norm(row.left)).sum::<f64>() / rows.len() as f64;
        // A residual that is small by chance must not dominate the weights.
        let least = 1e-3 * mean + f64::EPSILON;
        rows.iter_mut().for_each(|row| row.weight = 1.0 / norm(row.left).max(least));
        rows
    }
}

fn standard_error(parts: &[f64; PARTS]) -> f64 {
    RunningVariance::new(parts).rms_about_mean() / (PARTS as f64 - 1.0).sqrt()
}

#[cfg(test)]
mod tests;
