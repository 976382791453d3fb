//! Drift of an unloaded sensor's zero: its trend against time and temperature, and its wander.
//!
//! Each [stationary interval](crate::stationary) contributes its mean. The standard error of a
//! slope is the least-squares one, times `√((1 + ρ)/(1 − ρ))`, where ρ is the correlation of
//! neighbouring residuals plus `(2 + 4ρ)/n` to compensate for the fit of the line. For independent
//! intervals the slope is within two standard errors in 95 % of cases. For a random walk over 60
//! intervals it is within three standard errors of zero in three of four cases; with the plain
//! least-squares error, in one of four.

use crate::stationary::{ZeroChange, ZeroEstimate};
use shell_data::statistics::RunningVariance;

pub const FEWEST_STATIONARY: usize = 3;

/// The upper limit of the neighbour correlation ρ.
const MOST_CORRELATED: f64 = 0.95;

/// A line through the zeros, in units of the quantity and of the regressor.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Trend {
    pub slope: f64,
    pub standard_error: f64,
    pub residual_rms: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Drift {
    #[serde(flatten)]
    pub change: ZeroChange,
    /// Standard deviation of the zeros, without the noise within intervals.
    pub wander: f64,
    pub per_s: Trend,
    /// Trend against temperature, per unit of its column; `None` if the temperature is unknown or constant.
    pub per_degree: Option<Trend>,
}

impl Trend {
    /// Fits a line to values `y` at `x`, in order of time. `None` for fewer than [`FEWEST_STATIONARY`] or a constant
    /// `x`.
    pub fn fit(x: &[f64], y: &[f64]) -> Option<Self> {
        let (xs, ys) = (RunningVariance::new(x), RunningVariance::new(y));
        if x.len() < FEWEST_STATIONARY || xs.squares <= 0.0 || !xs.squares.is_finite() {
            return None;
        }
        let pairs = || x.iter().zip(y).map(|(x, y)| (x - xs.mean, y - ys.mean));
        let slope = pairs().map(|(x, y)| x * y).sum::<f64>() / xs.squares;
        let residuals: Vec<f64> = pairs().map(|(x, y)| y - slope * x).collect();
        let squares: f64 = residuals.iter().map(|r| r * r).sum();
        let neighbours: f64 = residuals.windows(2).map(|pair| pair[0] * pair[1]).sum();
        let correlation = if squares > 0.0 { neighbours / squares } else { 0.0 };
        let n = x.len() as f64;
        let correlation = (correlation + (2.0 + 4.0 * correlation) / n).clamp(0.0, MOST_CORRELATED);
        let independent = squares / (n - 2.0) / xs.squares;
        Some(Self {
            slope,
            standard_error: (independent * (1.0 + correlation) / (1.0 - correlation)).sqrt(),
            residual_rms: (squares / n).sqrt(),
        })
    }
}

impl Drift {
    /// Fits the drift of one of `quantities` from its zero in each interval, the interval's middle, s, and its
    /// temperature, if known. `None` for fewer than [`FEWEST_STATIONARY`] intervals.
    pub fn fit(
        estimates: &[ZeroEstimate],
        times_s: &[f64],
        temperatures: &[Option<f64>],
        quantities: usize,
    ) -> Option<Self> {
        let zeros: Vec<f64> = estimates.iter().map(|estimate| estimate.mean).collect();
        let per_s = Trend::fit(times_s, &zeros)?;
        let known = temperatures.iter().zip(&zeros).filter_map(|(at, &zero)| Some(((*at)?, zero)));
        let (degrees, zeros_there): (Vec<f64>, Vec<f64>) = known.unzip();
        let all = RunningVariance::new(&zeros);
        let squares = |estimate: &ZeroEstimate| estimate.standard_error * estimate.standard_error;
        let by_noise = estimates.iter().map(squares).sum::<f64>() / estimates.len() as f64;
        let (first, last) = (estimates.first()?, estimates.last()?);
        Some(Self {
            change: ZeroChange::new(first, last, quantities),
            wander: (all.squares / (all.count - 1) as f64 - by_noise).max(0.0).sqrt(),
            per_s,
            per_degree: Trend::fit(&degrees, &zeros_there),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_equals_that_of_least_squares() {
        // Slope 1.0135135 and standard error 0.0468122 are numpy's, as printed. The residuals
        // alternate (ρ = −0.774), so ρ adds nothing.
        let found = Trend::fit(&[0.0, 1.0, 2.0, 3.0, 5.0], &[1.0, 1.9, 3.2, 3.8, 6.1]).unwrap();
        assert!((found.slope - 1.013_513_5).abs() < 1e-7, "{found:?}");
        assert!((found.standard_error - 0.046_812_2).abs() < 1e-7, "{found:?}");
        assert_eq!(Trend::fit(&[1.0, 2.0], &[1.0, 2.0]), None);
        assert_eq!(Trend::fit(&[2.0; 4], &[1.0, 2.0, 3.0, 4.0]), None);
    }

    #[test]
    fn a_random_walk_has_no_significant_trend() {
        // 400 walks of 60 steps of ±1. In 3000 walks, numpy finds 77 % of slopes within three standard errors, but 25 %
        // with the plain least-squares error. A share of 400 has a standard deviation of 2 %.
        let mut state = 1_u64;
        let mut sign = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            if state >> 63 == 0 { 1.0 } else { -1.0 }
        };
        let times: Vec<f64> = (0..60).map(f64::from).collect();
        let within = (0..400).filter(|_| {
            let mut at = 0.0;
            let mut step = |_: &f64| {
                at += sign();
                at
            };
            let walk: Vec<f64> = times.iter().map(&mut step).collect();
            let Trend { slope, standard_error, .. } = Trend::fit(&times, &walk).unwrap();
            slope.abs() < 3.0 * standard_error
        });
        let share = within.count() as f64 / 400.0;
        assert!(share > 0.7, "{share}");
    }
}
