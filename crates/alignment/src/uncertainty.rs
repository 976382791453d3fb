//! Covariance and quality of a warp from its residuals, in one pass over the rows.

use faer::{Mat, MatRef};

use super::inner_products::dots;
use super::optics::Straight;
use super::response::MemoryModel;

/// Residuals correlated for longer than this are drift, which the model includes, s.
const CORRELATED_S: f64 = 0.5;
const SCORE_BIN_S: f64 = 0.01;
/// Share of the model error that is assumed to lie along the slopes, where the offset absorbs it. Residuals that are
/// similar from row to row show the model error. Found with sensors of six kinds of hysteresis (`docs/alignment.md`).
const HIDDEN_SHARE: f64 = 0.025;
/// Uncertain share of the memory's delay, because no model has the right widths, times and directions (found in the
/// same way).
const UNKNOWN_DELAY: f64 = 0.012;
/// Uncertain share of the frames' period, because frames do not show when a load jumps between them (found in the same
/// way).
const UNKNOWN_JUMP: f64 = 0.4;
/// Number of standard deviations of the noise to subtract from the sum of products of successive residuals.
const CHANCE: f64 = 2.0;

pub(super) struct MatchedRow<'a> {
    pub(super) from_pivot_s: f64,
    pub(super) features: &'a [f64],
    /// The derivative of the predicted straight readings with respect to the offset, counts/s.
    pub(super) slope: &'a [f64],
    pub(super) readings: &'a [f64],
    pub(super) straight: &'a [Straight],
    /// The weight of the row: 1, or less for an outlier.
    pub(super) weight: f64,
    /// Straight reading minus the predicted one, counts.
    pub(super) residual: &'a [f64],
}

pub(super) struct Solution<'a> {
    /// Coefficients of [slope | slope · time] on the features.
    pub(super) along: &'a Mat<f64>,
    pub(super) weights: &'a Mat<f64>,
    pub(super) map: MatRef<'a, f64>,
    pub(super) model: &'a MemoryModel,
}

#[derive(Debug, Default)]
pub(super) struct ResidualSums {
    start_s: f64,
    pub(super) rows: usize,
    /// Jᵀ W e, summed in bins of time.
    scores: Vec<[f64; 2]>,
    /// Sums for each channel: Σ e², Σ y, Σ y² of straight readings y.
    squares: Vec<[f64; 3]>,
    /// dᵀ W m and dᵀ W d, with slopes d and delayed parts m.
    late: [f64; 2],
    /// Σ eᵀ W e′ over successive rows: the squares of their common part.
    alike: f64,
    before: Vec<f64>,
    /// Σ (d − d′)ᵀ W (d − d′) over successive slopes.
    jumps: f64,
    slope_before: Vec<f64>,
    end_s: f64,
    /// The fastest change of a reading: slope, channel and time from the pivot.
    pub(super) steepest: (f64, usize, f64),
    late_features: Vec<f64>,
    late_part: Vec<f64>,
}

impl ResidualSums {
    pub(super) fn new(channels: usize, start_s: f64) -> Self {
        let [before, slope_before, late_part] = [0; 3].map(|_| vec![0.0; channels]);
        let squares = vec![[0.0; 3]; channels];
        let end_s = start_s;
        Self { start_s, end_s, squares, before, slope_before, late_part, ..Self::default() }
    }

    /// Adds a row. `of_load` holds the features that depend on the load.
    pub(super) fn add(&mut self, row: &MatchedRow<'_>, of_load: &[f64], at: &Solution<'_>) {
        self.rows += 1;
        self.late_features.resize(of_load.len(), 0.0);
        at.model.late(of_load, &mut self.late_features);
        let map = (0..at.map.ncols()).map(|c| at.map.col(c).try_as_col_major());
        let mut map = map.map(|column| column.expect("a column of a matrix").as_slice());
        dots(&self.late_features, &mut map, &mut self.late_part);
        let bin = ((row.from_pivot_s - self.start_s).max(0.0) / SCORE_BIN_S) as usize;
        if self.scores.len() <= bin {
            self.scores.resize(bin + 1, [0.0; 2]);
        }
        self.end_s = row.from_pivot_s;
        let change: Vec<f64> =
            row.slope.iter().zip(&self.slope_before).map(|(d, before)| d - before).collect();
        self.slope_before.copy_from_slice(row.slope);
        for channel in 0..self.squares.len() {
            let (slope, e) = (row.slope[channel], row.residual[channel]);
            let y = row.straight[channel].reading;
            let sums = &mut self.squares[channel];
            *sums = [sums[0] + e * e, sums[1] + y, sums[2] + y * y];
            if slope.abs() > self.steepest.0 {
                self.steepest = (slope.abs(), channel, row.from_pivot_s);
            }
            let weighted = |x: &[f64]| -> f64 {
                let column = at.weights.col_as_slice(channel);
                row.weight * column.iter().zip(x).map(|(w, x)| w * x).sum::<f64>()
            };
            let [weighted_residual, weighted_slope] = [row.residual, row.slope].map(weighted);
            self.alike += weighted_residual * self.before[channel];
            self.before[channel] = row.weight * e;
            self.late[0] += weighted_slope * self.late_part[channel];
            self.late[1] += weighted_slope * slope;
            self.jumps += weighted(&change) * change[channel];
            for (parameter, time) in [1.0, row.from_pivot_s].into_iter().enumerate() {
                let column = at.along.col_as_slice(parameter * self.squares.len() + channel);
                let fitted: f64 = column.iter().zip(row.features).map(|(c, x)| c * x).sum();
                self.scores[bin][parameter] += (slope * time - fitted) * weighted_residual;
            }
        }
    }

    /// Covariance of offset (s) and skew. `white` is H⁻¹, and `spread` has the variances over the plausible models. The
    /// common part of successive residuals sums to eᵀWe′. If a share `HIDDEN_SHARE` of it lies along the slopes, the
    /// squared error is `HIDDEN_SHARE² eᵀWe′ H⁻¹`.
    pub(super) fn covariance(&self, white: [[f64; 2]; 2], spread: [f64; 2]) -> [[f64; 2]; 2] {
        let longest = (CORRELATED_S / SCORE_BIN_S) as usize;
        let mut covariance = sandwich(white, long_run_covariance(&self.scores, longest));
        let chance = CHANCE * ((self.rows * self.squares.len()) as f64).sqrt();
        let hidden = HIDDEN_SHARE * HIDDEN_SHARE * (self.alike - chance).max(0.0);
        // Long-run covariances are biased downward, more so for shorter recordings.
        for (i, row) in covariance.iter_mut().enumerate() {
            row[i] = row[i].max(white[i][i]) + spread[i];
        }
        covariance[0][0] += hidden * white[0][0]
            + (UNKNOWN_DELAY * self.delay_s()).powi(2)
            + (UNKNOWN_JUMP * self.jump_s()).powi(2);
        covariance
    }

    /// The period of the frames if the load jumps between them; nearly zero for a gradual load.
    fn jump_s(&self) -> f64 {
        let period_s = (self.end_s - self.start_s) / self.rows.max(1) as f64;
        let roughness = if self.late[1] > 0.0 { self.jumps / self.late[1] } else { 0.0 };
        // 2 for slopes unrelated to the previous ones, below 0.5 for taps.
        period_s * (0.5 * roughness).powi(4).min(1.0)
    }

    pub(super) fn delay_s(&self) -> f64 {
        match self.late {
            [late, along] if along > 0.0 => -late / along,
            _ => 0.0,
        }
    }

    pub(super) fn residual(&self) -> Vec<f64> {
        self.squares.iter().map(|[squares, ..]| (squares / self.rows as f64).sqrt()).collect()
    }

    /// Share of the readings' variance that is explained, averaged over the channels that change.
    pub(super) fn explained(&self) -> f64 {
        let left = self.squares.iter().filter_map(|[squares, sum, sum_of_squares]| {
            let spread = sum_of_squares - sum * sum / self.rows as f64;
            (spread > 0.0).then_some(squares / spread)
        });
        let (count, sum) = left.fold((0.0, 0.0), |(count, sum), left| (count + 1.0, sum + left));
        if count > 0.0 { 1.0 - sum / count } else { 0.0 }
    }
}

/// Σ over lags of the scores' covariances, with Bartlett's weights, which keep it positive.
fn long_run_covariance(scores: &[[f64; 2]], longest: usize) -> [[f64; 2]; 2] {
    let mut sum = [[0.0; 2]; 2];
    for lag in 0..=longest.min(scores.len().saturating_sub(1)) {
        let taper = 1.0 - lag as f64 / (longest + 1) as f64;
        for (a, b) in scores.iter().zip(&scores[lag..]) {
            for i in 0..2 {
                for j in 0..2 {
                    let product = a[i] * b[j] + if lag > 0 { a[j] * b[i] } else { 0.0 };
                    sum[i][j] += taper * product;
                }
            }
        }
    }
    sum
}

fn sandwich(bread: [[f64; 2]; 2], filling: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
    let product = |a: [[f64; 2]; 2], b: [[f64; 2]; 2]| {
        [0, 1].map(|i| [0, 1].map(|j| a[i][0] * b[0][j] + a[i][1] * b[1][j]))
    };
    product(product(bread, filling), bread)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_long_run_variance_of_an_alternating_series_vanishes() {
        let scores: Vec<_> =
            (0..1000).map(|i| [if i % 2 == 0 { 1.0 } else { -1.0 }, 0.5]).collect();
        let sum = long_run_covariance(&scores, 49);
        // Bartlett's window over ±1 leaves 1/50 of the variance, except at the ends.
        assert!(sum[0][0] > 0.0 && sum[0][0] < 0.03 * 1000.0, "{sum:?}");
        // A constant adds up over all lags: 50 times the variance, except at the ends.
        assert!((sum[1][1] / (0.25 * 50.0 * 1000.0) - 1.0).abs() < 0.02, "{sum:?}");
        assert_eq!(sum[0][1], sum[1][0]);
    }

    #[test]
    fn a_sandwich_of_the_inverse_is_the_inverse() {
        let bread = [[2.0, 0.5], [0.5, 1.0]];
        let inverse = super::super::normal::inverse(bread).unwrap();
        let back = sandwich(inverse, bread);
        for i in 0..2 {
            for j in 0..2 {
                assert!((back[i][j] - inverse[i][j]).abs() < 1e-15);
            }
        }
    }
}
