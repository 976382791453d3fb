//! Noise about the curves: noise of the readings and play of the displacement.
//!
//! A reading is noisy itself, and the reflector does not stop at the same place twice (play,
//! creep), which counts only where the curve is steep.
//!
//! ```text
//! var(y − f) = σ² + τ²·(df/dq)²
//! ```
//!
//! Both variances are maximum-likelihood estimates for normal errors. Fixed-point steps multiply
//! each by the ratio of the two sides of its likelihood equation, which keeps it positive. Fitted
//! parameters absorb a part of each residual: its expected square is `r² + gᵀCg`, with their
//! covariance `C` (Dempster, Laird & Rubin, J. R. Stat. Soc. B 39, 1977).

use std::ops::{Add, Mul};

use super::lanes::MOST_LANES;
use shell_data::vectorised;

/// Lower limit of the variances: for a reading, the square of about one count of ten bits.
const LEAST: f64 = 1e-6;

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Noise {
    /// `σ²`, in squared ranges of a channel.
    pub reading: f64,
    /// `τ²`, in squared units of q.
    pub displacement: f64,
}

/// Residuals of a sensor, one per row.
#[derive(Clone, Debug, Default)]
pub(super) struct Residuals {
    pub(super) squares: Vec<f64>,
    /// `(df/dq)²` at each row.
    pub(super) slope_squares: Vec<f64>,
}

impl Noise {
    /// Readings repeat to a fiftieth of their range, displacements to 0.15 units of q (of some 6).
    pub(super) const START: Self = Self { reading: 4e-4, displacement: 0.0225 };

    #[inline(always)]
    pub fn variance(&self, slope: f64) -> f64 {
        self.variance_at(slope * slope)
    }

    /// Variance from the square of the slope: one number, or one for each lane.
    #[inline(always)]
    pub(super) fn variance_at<T: Add<f64, Output = T> + Mul<f64, Output = T>>(
        &self,
        slope_square: T,
    ) -> T {
        slope_square * self.displacement + self.reading
    }

    pub(super) fn refine(self, residuals: &[Residuals], steps: usize) -> Self {
        (0..steps).fold(self, |noise, _| {
            let mut sums = [[0.0; MOST_LANES]; 5];
            for residuals in residuals {
                add(&mut sums, noise, residuals);
            }
            let [a, b, c, d, e] = sums.map(|lanes| lanes.iter().sum::<f64>());
            let Self { reading, displacement } = noise;
            let next = |old: f64, found: f64, expected: f64| {
                if expected > 0.0 { (old * found / expected).max(LEAST) } else { old }
            };
            Self {
                reading: next(reading, d, a * reading + b * displacement),
                displacement: next(displacement, e, b * reading + c * displacement),
            }
        })
    }
}

/// Sums of `1`, `g`, `g²`, `r²` and `g·r²` over `v²`, with `g = (df/dq)²`, in interleaved lanes.
type LikelihoodSums = [[f64; MOST_LANES]; 5];

vectorised! {
    fn add(sums: &mut LikelihoodSums, noise: Noise, residuals: &Residuals) {
        let (squares, last_squares) = residuals.squares.as_chunks::<MOST_LANES>();
        let (slopes, last_slopes) = residuals.slope_squares.as_chunks::<MOST_LANES>();
        for (squares, slopes) in squares.iter().zip(slopes) {
            for lane in 0..MOST_LANES {
                add_row(sums, lane, noise, (squares[lane], slopes[lane]));
            }
        }
        for (lane, (&square, &slope)) in last_squares.iter().zip(last_slopes).enumerate() {
            add_row(sums, lane, noise, (square, slope));
        }
    }
}

#[inline(always)]
fn add_row(sums: &mut LikelihoodSums, lane: usize, noise: Noise, (square, g): (f64, f64)) {
    let variance = noise.variance_at(g);
    let weight = 1.0 / (variance * variance);
    let by_g = weight * g;
    let products = [weight, by_g, by_g * g, weight * square, by_g * square];
    for (sum, product) in sums.iter_mut().zip(products) {
        sum[lane] += product;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn variances_that_made_the_residuals_are_found() {
        let truth = Noise { reading: 3e-4, displacement: 0.01 };
        // The squares equal their expectations, so the likelihood is greatest at the truth.
        let slopes = (0..100).map(|i| f64::from(i) / 300.0);
        let residuals = Residuals {
            squares: slopes.clone().map(|slope| truth.variance(slope)).collect(),
            slope_squares: slopes.map(|slope| slope * slope).collect(),
        };
        let found = Noise::START.refine(&[residuals], 500);
        assert!((found.reading / truth.reading - 1.0).abs() < 1e-6, "{found:?}");
        assert!((found.displacement / truth.displacement - 1.0).abs() < 1e-6);
    }
}
