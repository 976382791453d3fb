//! How late the clock of a motion is against that of a wrench.
//!
//! Forces and gravity, under the same running mean, at the lag that leaves least of the forces. The mean
//! takes off what shakes faster than it is long: vibrations that repeat would fit at several lags.

use serde::Serialize;

use super::motion::running_mean;
use super::vector::{Vector, scaled, subtract};
use super::{Motion, Payload};

/// Length of the running mean, s.
const MEAN_S: f64 = 0.03;
/// The largest lag that is looked for, either way, s.
const LARGEST_S: f64 = 0.1;
/// Between lags that are tried, s.
const STEP_S: f64 = 0.001;
/// What is left of the forces at the best lag, against the median over all lags: above this none is best.
const CLEAR: f64 = 0.8;
/// The rows that are looked at, s apart: closer ones share their mean.
const ROW_S: f64 = 0.005;
/// The most rows that are looked at.
const MOST_ROWS: usize = 20_000;

/// How late a motion is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Lag {
    /// What its clock shows more than that of the wrench at the same moment, s.
    pub lag_s: f64,
    /// The standard error of that, s.
    pub standard_error_s: f64,
}

/// Finds how late a motion is against the forces, N, of a sensor that carries `payload`. `None` where no
/// lag is clearly best: in a run without motion, or where other forces prevail.
pub fn find_lag(
    payload: &Payload,
    motion: &Motion,
    times_s: &[f64],
    forces: &[Vec<f64>; 3],
) -> Option<Lag> {
    let half_s = MEAN_S / 2.0;
    let smooth: Vec<Vec<f64>> =
        forces.iter().map(|column| running_mean(times_s, column, half_s)).collect();
    let motion = motion.smoothed(half_s);
    let (start_s, end_s) = motion.span_s();
    // Every lag is judged on the same rows.
    let within = |time: f64| start_s + LARGEST_S <= time && time <= end_s - LARGEST_S;
    let mut rows: Vec<(f64, Vector)> = Vec::new();
    for (row, &time) in times_s.iter().enumerate() {
        let is_next = rows.last().is_none_or(|(last, _)| time >= last + ROW_S);
        if is_next && within(time) && rows.len() < MOST_ROWS {
            rows.push((time, std::array::from_fn(|axis| smooth[axis][row])));
        }
    }
    if rows.len() < 10 {
        return None;
    }
    let left = |lag_s: f64| remaining(payload, &motion, &rows, lag_s);
    let steps = (LARGEST_S / STEP_S).round() as i32;
    let lags: Vec<f64> = (-steps..=steps).map(|step| f64::from(step) * STEP_S).collect();
    let tried: Vec<f64> = lags.iter().map(|lag| left(*lag)).collect();
    let best = (0..lags.len()).min_by(|a, b| tried[*a].total_cmp(&tried[*b]))?;
    let mut sorted = tried.clone();
    sorted.sort_unstable_by(f64::total_cmp);
    let is_clear = tried[best] < CLEAR * sorted[sorted.len() / 2];
    if !is_clear || best == 0 || best == lags.len() - 1 {
        return None;
    }
    let [before, at, after] = [tried[best - 1], tried[best], tried[best + 1]];
    let curvature = (before - 2.0 * at + after) / (STEP_S * STEP_S);
    if curvature.is_nan() || curvature <= 0.0 {
        return None;
    }
    let lag_s = lags[best] - (after - before) / (2.0 * STEP_S) / curvature;
    // What is left is independent no closer than the mean is long.
    let (first, last) = (rows[0].0, rows[rows.len() - 1].0);
    let independent = ((last - first) / MEAN_S).max(1.0).min(rows.len() as f64);
    Some(Lag { lag_s, standard_error_s: (2.0 * at / (independent * curvature)).sqrt() })
}

/// The variance of what is left of the forces at a lag, summed over the axes.
fn remaining(payload: &Payload, motion: &Motion, rows: &[(f64, Vector)], lag_s: f64) -> f64 {
    let count = rows.len() as f64;
    let left = |(time, force): &(f64, Vector)| {
        subtract(*force, scaled(motion.at(time + lag_s), payload.mass_kg))
    };
    let origin = left(&rows[0]);
    let (mut sum, mut squares) = ([0.0; 3], [0.0; 3]);
    for row in rows {
        for (axis, value) in subtract(left(row), origin).into_iter().enumerate() {
            sum[axis] += value;
            squares[axis] += value * value;
        }
    }
    (0..3).map(|axis| squares[axis] / count - (sum[axis] / count).powi(2)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use shell_data::random::{Purpose, RandomStream};

    const PAYLOAD: Payload = Payload {
        mass_kg: 0.5,
        centre_m: [0.0; 3],
        force_bias_n: [0.0; 3],
        moment_bias_nm: [0.0; 3],
    };

    fn gravity(time_s: f64) -> Vector {
        let swing = (2.0 * time_s).sin() + 0.4 * (7.3 * time_s).sin();
        [swing, 0.3 * (3.1 * time_s).cos(), 9.8 - 0.2 * swing * swing]
    }

    fn run(lag_s: f64, seed: u64) -> Option<Lag> {
        let mut noise = RandomStream::new(seed, Purpose::Reference, 0);
        let samples: Vec<f64> = (0..2500).map(|i| f64::from(i) * 0.004).collect();
        let measured: Vec<Vector> = samples.iter().map(|t| gravity(t - lag_s)).collect();
        let motion = Motion::new(&samples, &measured).unwrap();
        let times: Vec<f64> = (0..7000).map(|i| f64::from(i) / 700.0).collect();
        let forces = [0, 1, 2].map(|axis| {
            times.iter().map(|t| 0.5 * gravity(*t)[axis] + 0.05 * noise.normal()).collect()
        });
        find_lag(&PAYLOAD, &motion, &times, &forces)
    }

    #[test]
    fn a_lag_is_found_within_its_standard_error() {
        for (seed, lag_s) in [(1, 0.0), (2, 0.0063), (3, -0.0418), (4, 0.0771)] {
            let found = run(lag_s, seed).unwrap();
            // One in 16,000 is beyond four standard errors.
            assert!((found.lag_s - lag_s).abs() < 4.0 * found.standard_error_s, "{found:?}");
            assert!(found.standard_error_s < 0.002, "{found:?}");
        }
        assert_eq!(run(0.3, 5), None, "beyond what is looked for");
    }

    #[test]
    fn a_run_at_rest_tells_no_lag() {
        let mut noise = RandomStream::new(9, Purpose::Reference, 0);
        let times: Vec<f64> = (0..5000).map(|i| f64::from(i) / 500.0).collect();
        let mut rest = || times.iter().map(|_| 0.05 * noise.normal()).collect::<Vec<f64>>();
        let forces = [rest(), rest(), rest()];
        let gravity: Vec<Vector> = rest().iter().map(|noise| [0.1 * noise, 0.0, 9.8]).collect();
        let motion = Motion::new(&times, &gravity).unwrap();
        assert_eq!(find_lag(&PAYLOAD, &motion, &times, &forces), None);
    }
}
