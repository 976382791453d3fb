//! What noise of the readings makes of the wrench.
//!
//! `s` and `s − EMA_τ(s)` of a few time constants add up to a filter. Where loads move slowly, one that averages noise
//! lowers errors though the sensor remembers nothing, and its delay looks like a lag; between rows, noise of the loads is
//! averaged. So the part of noise is known apart: with `g` the gradient of a wrench by a reading, `d_k` the coefficients of its memory terms, and white noise of
//! variance σ²,
//!
//! ```text
//! σ²·(g² + 2·g·Σ d_k + Σ d_k·d_l·(1 + α_k·α_l/(1 − (1−α_k)·(1−α_l)))),   α = 1 − exp(−period/τ)
//! ```

use faer::{Mat, MatRef};

use crate::features::Features;
use shell_data::statistics::upper_median;
use shell_data::wrench::PerAxis;

/// Rows whose gradients stand for all, about.
const GRADIENT_ROWS: usize = 400;

/// `Σ c²` of the fourth difference, `c` = 1, −4, 6, −4, 1: it takes away whatever is smooth over five rows.
const DIFFERENCE_GAIN: f64 = 70.0;

/// Differences beyond so many times their median are jumps.
const JUMP: f64 = 8.0;

/// A row that comes later than so many periods follows one that is missing.
const MISSING_PERIODS: f64 = 1.5;

/// Noise of the readings, and gradients of the features by them.
pub(super) struct ReadingNoise {
    period: f64,
    channels: Vec<ChannelNoise>,
}

struct ChannelNoise {
    variance: f64,
    /// Of each feature, rows × features.
    gradients: Mat<f64>,
}

impl ReadingNoise {
    /// `variances` of the noise of each channel of `readings`.
    pub(super) fn new(
        features: &Features,
        readings: &[Vec<f64>],
        variances: &[f64],
        period: f64,
    ) -> Self {
        let rows = readings.first().map_or(0, Vec::len);
        let every = rows.div_ceil(GRADIENT_ROWS).max(1);
        let mut some: Vec<Vec<f64>> =
            readings.iter().map(|column| column.iter().step_by(every).copied().collect()).collect();
        let count = some.first().map_or(0, Vec::len);
        let channels = (variances.iter().enumerate()).map(|(channel, &variance)| {
            let step = variance.sqrt().max(f64::MIN_POSITIVE);
            let middle = some[channel].clone();
            let mut at = |by: f64| {
                some[channel] = middle.iter().map(|reading| reading + by).collect();
                let mut columns = vec![0.0; count * features.len()];
                features.fill(&some, 0..count, &mut columns, count);
                columns
            };
            let (above, below) = (at(step), at(-step));
            some[channel] = middle;
            let slope =
                |i: usize, j: usize| (above[j * count + i] - below[j * count + i]) / (2.0 * step);
            let gradients = match variance > 0.0 {
                true => Mat::from_fn(count, features.len(), slope),
                false => Mat::zeros(count, features.len()),
            };
            ChannelNoise { variance, gradients }
        });
        Self { period, channels: channels.collect() }
    }

    /// The variance of each axis from it, N² and (N·m)². `coefficients` are those of the features, then of the memory
    /// terms, channel by channel for each time constant.
    pub(super) fn of_wrench(
        &self,
        coefficients: MatRef<'_, f64>,
        time_constants: &[f64],
    ) -> PerAxis<f64> {
        let shares: Vec<f64> =
            time_constants.iter().map(|tau| -(-self.period / tau).exp_m1()).collect();
        let both = |a: f64, b: f64| 1.0 + a * b / (1.0 - (1.0 - a) * (1.0 - b));
        let mut variances = [0.0; 6];
        for (position, channel) in self.channels.iter().enumerate() {
            let features = channel.gradients.ncols();
            let gradients = &channel.gradients * coefficients.subrows(0, features);
            let rows = gradients.nrows().max(1) as f64;
            for (axis, sum) in variances.iter_mut().enumerate() {
                let own = gradients.col(axis);
                let memory = |term: usize| {
                    coefficients[(features + term * self.channels.len() + position, axis)]
                };
                let mut power = own.squared_norm_l2() / rows;
                for (k, a) in shares.iter().enumerate() {
                    power += 2.0 * own.sum() / rows * memory(k);
                    let pairs = shares.iter().enumerate();
                    power += pairs.map(|(l, b)| memory(k) * memory(l) * both(*a, *b)).sum::<f64>();
                }
                *sum += channel.variance * power;
            }
        }
        variances
    }
}

/// The variance of white noise on the columns of several logs, each with its times: from fourth differences over rows
/// at equal distances. 0 where there are none.
pub(super) fn variance<'a>(
    logs: impl Iterator<Item = (&'a [f64], impl AsRef<[f64]>)>,
    period: f64,
) -> f64 {
    let mut differences = Vec::new();
    for (times, column) in logs {
        for (times, s) in times.windows(5).zip(column.as_ref().windows(5)) {
            let is_even =
                |pair: &[f64]| pair[1] > pair[0] && pair[1] - pair[0] < MISSING_PERIODS * period;
            if times.windows(2).all(is_even) {
                differences.push((s[0] - 4.0 * s[1] + 6.0 * s[2] - 4.0 * s[3] + s[4]).abs());
            }
        }
    }
    let Some(median) = upper_median(&mut differences) else { return 0.0 };
    let ordinary = differences.iter().filter(|of| median == 0.0 || **of <= JUMP * median);
    let (count, squares) =
        ordinary.fold((0.0, 0.0), |(count, squares), of| (count + 1.0, squares + of * of));
    squares / count / DIFFERENCE_GAIN
}

#[cfg(test)]
mod tests {
    use super::*;
    use system_tests::random::Random;

    #[test]
    fn noise_of_a_moving_reading_is_found_past_jumps_and_missing_rows() {
        let mut random = Random(4);
        let rows = (0..8000).filter(|row| row % 7 != 3);
        let (times, column): (Vec<f64>, Vec<f64>) = rows
            .map(|row| {
                let jump = if row % 500 == 0 { 300.0 } else { 0.0 };
                let t = f64::from(row);
                (t, 400.0 * (0.02 * t).sin() + 1.5 * random.normal() + jump)
            })
            .unzip();
        let found = variance([(&times[..], &column[..])].into_iter(), 1.0);
        // Of 4600 overlapping differences.
        assert!((found / 2.25 - 1.0).abs() < 0.1, "{found}");
        assert_eq!(variance([(&times[..3], &column[..3])].into_iter(), 1.0), 0.0);
    }
}
