//! Mean and variance, block by block, and the median.
//!
//! Blocks are merged with the formula of Chan, Golub and LeVeque (Amer. Statist. 37, 1983), which
//! avoids cancellation: a mean much larger than the spread costs no digits.
//!
//! ```
//! use shell_data::statistics::RunningVariance;
//!
//! let mut all = RunningVariance::new(&[1.0, 2.0]);
//! all.merge(&RunningVariance::new(&[3.0, 6.0]));
//! assert_eq!((all.count, all.mean, all.squares), (4, 3.0, 14.0));
//! ```

use crate::vectorised;

/// Number, mean and sum of squared deviations of values. The default (no values) is the identity of
/// [`merge`](Self::merge), which is commutative and associative up to rounding.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RunningVariance {
    pub count: u64,
    pub mean: f64,
    /// Sum of squared deviations from the mean.
    pub squares: f64,
}

/// Returns the median, or the upper of the two middle values; `None` without values. Reorders the values.
pub fn upper_median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Returns the quantile of ascending values, at least one, at rank `(n − 1)·share`, interpolated
/// linearly between the two nearest values (type 7 of Hyndman & Fan, Am. Statist. 50, 1996).
pub fn quantile(sorted: &[f64], share: f64) -> f64 {
    let rank = (sorted.len() - 1) as f64 * share;
    let below = rank as usize;
    let above = (below + 1).min(sorted.len() - 1);
    sorted[below] + (sorted[above] - sorted[below]) * (rank - below as f64)
}

/// Returns the smallest and the largest value; `(∞, −∞)` without values.
pub fn extremes(values: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let none = (f64::INFINITY, f64::NEG_INFINITY);
    values.into_iter().fold(none, |(least, greatest), x| (least.min(x), greatest.max(x)))
}

/// Weights of the differences between the means of two sets when their means and sums of products are merged:
/// `mean += (b − a)·weights.mean`, `Σ(x − x̄)(y − ȳ) += (b_x − a_x)·(b_y − a_y)·weights.product`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MergeWeights {
    /// `m / (n + m)`.
    pub mean: f64,
    /// `n·m / (n + m)`.
    pub product: f64,
}

impl MergeWeights {
    /// Computes the weights for merging `m` values into `n` values; not both zero.
    #[inline]
    pub fn new(n: u64, m: u64) -> Self {
        let (n, m) = (n as f64, m as f64);
        Self { mean: m / (n + m), product: n * m / (n + m) }
    }
}

impl RunningVariance {
    /// Computes the statistics in two passes.
    pub fn new(column: &[f64]) -> Self {
        variance(column)
    }

    /// Like [`Self::new`], for inlining into vectorised code of the caller.
    #[inline(always)]
    pub fn from_inlined(column: &[f64]) -> Self {
        if column.is_empty() {
            return Self::default();
        }
        let n = column.len() as f64;
        // Differences from one value of the column do not lose digits to a large offset.
        let (origin, sum) = (column[0], sums_about(column, column[0]).0);
        let mean = origin + sum / n;
        let (sum, squares) = sums_about(column, mean);
        let rest = sum / n;
        Self {
            count: column.len() as u64,
            mean: mean + rest,
            squares: (squares - n * rest * rest).max(0.0),
        }
    }

    pub fn merge(&mut self, other: &RunningVariance) {
        if other.count == 0 {
            return;
        }
        let weights = MergeWeights::new(self.count, other.count);
        let difference = other.mean - self.mean;
        self.mean += difference * weights.mean;
        self.squares += other.squares + difference * difference * weights.product;
        self.count += other.count;
    }

    /// Returns the root mean square deviation from the mean; NaN for zero values.
    pub fn rms_about_mean(&self) -> f64 {
        (self.squares / self.count as f64).sqrt()
    }

    /// Returns the root mean square; NaN for zero values.
    pub fn rms(&self) -> f64 {
        (self.squares / self.count as f64 + self.mean * self.mean).sqrt()
    }
}

vectorised! {
    fn variance(column: &[f64]) -> RunningVariance {
        RunningVariance::from_inlined(column)
    }
}

const LANES: usize = 16;

#[inline(always)]
fn sums_about(column: &[f64], origin: f64) -> (f64, f64) {
    let (mut sums, mut squares) = ([0.0; LANES], [0.0; LANES]);
    let (chunks, rest) = column.as_chunks::<LANES>();
    for chunk in chunks {
        for i in 0..LANES {
            let x = chunk[i] - origin;
            sums[i] += x;
            squares[i] += x * x;
        }
    }
    for (i, x) in rest.iter().enumerate() {
        let x = x - origin;
        sums[i] += x;
        squares[i] += x * x;
    }
    (sums.iter().sum(), squares.iter().sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_the_upper_one_of_two() {
        assert_eq!(upper_median(&mut []), None);
        assert_eq!(upper_median(&mut [3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(upper_median(&mut [4.0, 1.0, 3.0, 2.0]), Some(3.0));
    }

    #[test]
    fn quantiles_lie_between_the_values() {
        let values = [1.0, 2.0, 4.0];
        assert_eq!([0.0, 0.75, 1.0].map(|share| quantile(&values, share)), [1.0, 3.0, 4.0]);
        assert_eq!(extremes([2.0, -1.0, 4.0]), (-1.0, 4.0));
    }

    #[test]
    fn a_large_offset_costs_no_digits() {
        // ±1 about 10¹²: the variance is exactly 1.
        let column: Vec<f64> = (0..1000).map(|i| 1e12 + f64::from(1 - 2 * (i % 2))).collect();
        let mut merged = RunningVariance::default();
        column.chunks(7).for_each(|part| merged.merge(&RunningVariance::new(part)));
        assert_eq!(RunningVariance::new(&column).rms_about_mean(), 1.0);
        // The means of the parts are rounded at 10¹² · 2⁻⁵³ = 1e-4; a sum of squares would have an
        // error of 10²⁴ · 2⁻⁵³ = 1e8.
        assert!((merged.rms_about_mean() - 1.0).abs() < 1e-4);
    }

    #[test]
    fn parts_merge_to_the_whole() {
        let column: Vec<f64> = (0..100).map(|i| f64::from(i * i % 37)).collect();
        let whole = RunningVariance::new(&column);
        let mut merged = RunningVariance::default();
        column.chunks(13).for_each(|part| merged.merge(&RunningVariance::new(part)));
        assert_eq!(merged.count, 100);
        // Rounding of sums of a hundred terms: 100 · 2⁻⁵³ relative.
        assert!((merged.mean - whole.mean).abs() < 1e-14 * whole.mean);
        assert!((merged.squares - whole.squares).abs() < 1e-13 * whole.squares);
    }
}
