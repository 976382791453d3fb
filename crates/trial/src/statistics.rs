//! Statistics of a small number of trials, or of their strides.
//!
//! - Quartiles interpolate between the two nearest values at rank `(n − 1)·p` (type 7 of Hyndman &
//!   Fan, Am. Statist. 50, 1996), as in NumPy, matplotlib and R.
//! - Whiskers are Tukey's: the outermost values within 1.5 interquartile ranges of the box.
//! - Intervals of the mean are from the bias-corrected and accelerated bootstrap (BCa: Efron, J. Am. Statist. Assoc.
//!   82, 1987; Efron & Tibshirani, An Introduction to the Bootstrap, §14.3). It is too narrow for few trials: `√(n/(n
//!   − 1))·t` replaces the normal quantile (Hesterberg, Am. Statist. 69, 2015, §4.1). Fewer than eight trials have
//!   Student's interval, fewer than five none.
//! - The error of the calibration, common to all trials, does not average out: it is added in quadrature.
//! - Strides of one trial resemble each other: the bootstrap resamples whole trials (Davison & Hinkley, Bootstrap
//!   Methods, §3.8); the mean is over strides.

use serde::Serialize;
use statrs::distribution::{ContinuousCDF, Normal};

use calibration::uncertainty::student_quantile;
use shell_data::random::{Purpose, RandomStream};
use shell_data::statistics::quantile;

pub(crate) const RESAMPLES: usize = 4000;

const LEVEL: f64 = 0.95;

/// Fewest trials for an interval: the range of n values contains their distribution's median with a probability of 1
/// − 2¹⁻ⁿ, 94 % for five.
const FEWEST: usize = 5;

/// Fewest trials for the bootstrap: with five normal values it covers 91 %, and Student's interval covers 95 %.
const FEWEST_BOOTSTRAPPED: usize = 8;

/// Most trials to resample. The mean of more is normal except for a known skewness, and resampling takes minutes.
const MOST_DRAWN: usize = 5000;

#[derive(Clone, Debug, Default, PartialEq)]
pub struct ValueSample {
    values: Vec<f64>,
    clusters: Vec<(f64, usize)>,
    /// Common errors along common directions, summed over the values.
    shared: Vec<f64>,
    degrees_of_freedom: Option<f64>,
    is_unknown: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Interval {
    pub low: f64,
    pub high: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Statistics {
    pub n: usize,
    pub trials: usize,
    pub mean: f64,
    /// Standard deviation, with divisor `n − 1`; `None` for a single value.
    pub sd: Option<f64>,
    /// `None` with fewer than five trials.
    pub mean_95: Option<Interval>,
    pub q1: f64,
    pub median: f64,
    pub q3: f64,
    /// The smallest value within 1.5 interquartile ranges below the first quartile.
    pub whisker_low: f64,
    /// The largest value within 1.5 interquartile ranges above the third quartile.
    pub whisker_high: f64,
    /// Outliers in ascending order.
    pub outliers: Vec<f64>,
    /// Values in ascending order.
    #[serde(skip)]
    pub values: Vec<f64>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MeanDifference {
    pub reference: String,
    pub mean: f64,
    /// `None` if either condition has fewer than five trials.
    pub mean_95: Option<Interval>,
}

impl ValueSample {
    /// Adds the values of one trial's strides. Values that are not finite are skipped.
    pub fn add_cluster(&mut self, values: impl IntoIterator<Item = f64>) {
        let before = self.values.len();
        self.values.extend(values.into_iter().filter(|value| value.is_finite()));
        let new = &self.values[before..];
        if !new.is_empty() {
            self.clusters.push((new.iter().sum(), new.len()));
        }
    }

    /// Adds common errors of the trial added last: components along common directions, each one standard deviation.
    pub fn add_shared_error(&mut self, parts: &[f64], degrees_of_freedom: f64) {
        let count = self.clusters.last().map_or(0, |(_, count)| *count) as f64;
        self.shared.resize(self.shared.len().max(parts.len()), 0.0);
        self.shared.iter_mut().zip(parts).for_each(|(sum, part)| *sum += count * part);
        let least = self.degrees_of_freedom.unwrap_or(f64::INFINITY).min(degrees_of_freedom);
        self.degrees_of_freedom = Some(least);
    }

    /// Records that the errors of some trial are unknown, which rules out intervals.
    pub fn add_unknown_error(&mut self) {
        self.is_unknown = true;
    }

    fn mean_shared(&self) -> impl Iterator<Item = f64> + '_ {
        let count = self.values.len().max(1) as f64;
        self.shared.iter().map(move |sum| sum / count)
    }

    /// Widens the interval `scatter` about `mean` by the common error; `parts` as in [`Self::add_shared_error`].
    fn widened(&self, mean: f64, scatter: Interval, parts: impl Iterator<Item = f64>) -> Interval {
        let error = parts.map(|part| part * part).sum::<f64>().sqrt();
        let degrees = self.degrees_of_freedom.unwrap_or(f64::INFINITY);
        let shared = if error > 0.0 { student_quantile(LEVEL, degrees) * error } else { 0.0 };
        Interval {
            low: mean - (mean - scatter.low).hypot(shared),
            high: mean + (scatter.high - mean).hypot(shared),
        }
    }

    /// The statistics; `None` without values. Equal `seed`s give equal intervals.
    pub fn statistics(&self, seed: u64) -> Option<Statistics> {
        let n = self.values.len();
        let mut sorted = self.values.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        let (&first, &last) = (sorted.first()?, sorted.last()?);
        let mean = mean(&self.clusters);
        let squares: f64 = self.values.iter().map(|x| (x - mean) * (x - mean)).sum();
        let [q1, median, q3] = [0.25, 0.5, 0.75].map(|p| quantile(&sorted, p));
        let reach = 1.5 * (q3 - q1);
        let within = |x: &&f64| (q1 - reach..=q3 + reach).contains(*x);
        // If no value lies between the box and its fence, the whisker ends at the box.
        let whisker_low = sorted.iter().find(within).unwrap_or(&first).min(q1);
        let whisker_high = sorted.iter().rev().find(within).unwrap_or(&last).max(q3);
        let beyond = |x: &f64| *x < whisker_low || *x > whisker_high;
        Some(Statistics {
            n,
            trials: self.clusters.len(),
            mean,
            sd: (n > 1).then(|| (squares / (n - 1) as f64).sqrt()),
            mean_95: interval(&[(1.0, &self.clusters)], seed)
                .filter(|_| !self.is_unknown)
                .map(|scatter| self.widened(mean, scatter, self.mean_shared())),
            q1,
            median,
            q3,
            whisker_low,
            whisker_high,
            outliers: sorted.iter().copied().filter(beyond).collect(),
            values: sorted,
        })
    }

    /// Difference of the mean from that of `reference`; `None` if either has no values.
    pub fn difference(&self, reference: &Self, name: &str, seed: u64) -> Option<MeanDifference> {
        if self.values.is_empty() || reference.values.is_empty() {
            return None;
        }
        let difference = mean(&self.clusters) - mean(&reference.clusters);
        let scatter = interval(&[(1.0, &self.clusters), (-1.0, &reference.clusters)], seed);
        let mean_95 =
            scatter.filter(|_| !self.is_unknown && !reference.is_unknown).map(|scatter| {
                let (mut own, mut other) = (self.mean_shared(), reference.mean_shared());
                let count = self.shared.len().max(reference.shared.len());
                // Along common directions, errors cancel as far as both have them.
                let parts = (0..count)
                    .map(move |_| own.next().unwrap_or(0.0) - other.next().unwrap_or(0.0));
                self.widened(difference, scatter, parts)
            });
        Some(MeanDifference { reference: name.to_owned(), mean: difference, mean_95 })
    }
}

fn mean(clusters: &[(f64, usize)]) -> f64 {
    let (sum, n) = clusters.iter().fold((0.0, 0), |(s, n), &(sum, count)| (s + sum, n + count));
    sum / n as f64
}

type Signed<'a> = (f64, &'a [(f64, usize)]);

/// Interval of the signed sum of means; `None` if some sample has too few clusters.
fn interval(samples: &[Signed<'_>], seed: u64) -> Option<Interval> {
    let fewest = samples.iter().map(|(_, clusters)| clusters.len()).min()?;
    match fewest {
        ..FEWEST => None,
        FEWEST..FEWEST_BOOTSTRAPPED => Some(student(samples)),
        FEWEST_BOOTSTRAPPED.. => Some(bootstrap(samples, fewest, seed)),
    }
}

/// Student's interval; for several samples with Welch's degrees of freedom (Biometrika 34, 1947). A trial with
/// several strides counts by its influence on the mean, `(s − c·m)·k/n`, with the sum s of its c strides, the mean m
/// of all n strides, and k trials. (Hall's transformation removes skewness and covers one percent more of skewed
/// values. But five values hardly determine the skewness, and a large estimate moves one end by many standard
/// errors.)
fn student(samples: &[Signed<'_>]) -> Interval {
    let (mut estimate, mut variance, mut welch) = (0.0, 0.0, 0.0);
    for &(sign, clusters) in samples {
        let (m, k) = (mean(clusters), clusters.len() as f64);
        let n = clusters.iter().map(|&(_, count)| count).sum::<usize>() as f64;
        let influence = clusters.iter().map(|&(sum, count)| (sum - count as f64 * m) * k / n);
        let own = influence.map(|u| u * u).sum::<f64>() / (k * (k - 1.0));
        estimate += sign * m;
        variance += own;
        welch += own * own / (k - 1.0);
    }
    let degrees = if welch > 0.0 { variance * variance / welch } else { 1.0 };
    let half = student_quantile(LEVEL, degrees) * variance.sqrt();
    Interval { low: estimate - half, high: estimate + half }
}

fn signed_sum(samples: &[Signed<'_>], means: &[f64]) -> f64 {
    samples.iter().zip(means).map(|((sign, _), mean)| sign * mean).sum()
}

/// BCa interval; `fewest` is the number of clusters of the smallest sample.
fn bootstrap(samples: &[Signed<'_>], fewest: usize, seed: u64) -> Interval {
    let means: Vec<f64> = samples.iter().map(|(_, clusters)| mean(clusters)).collect();
    let estimate = signed_sum(samples, &means);
    let n = fewest as f64;
    let z = (n / (n - 1.0)).sqrt() * student_quantile(LEVEL, n - 1.0);
    let (variance, acceleration) = influence(samples, &means);
    // In the limit for a mean, bias equals acceleration (Efron & Tibshirani, §14.3). Quantiles by Cornish and Fisher.
    if samples.iter().any(|(_, clusters)| clusters.len() > MOST_DRAWN) {
        let end = |z: f64| {
            let shifted = acceleration + z;
            let w = acceleration + shifted / (1.0 - acceleration * shifted);
            estimate + variance.sqrt() * (w + acceleration * (w * w - 1.0))
        };
        return Interval { low: end(-z), high: end(z) };
    }
    let mut stream = RandomStream::new(seed, Purpose::Bootstrap, 0);
    let mut again = |(_, clusters): &Signed<'_>| {
        let (mut sum, mut n) = (0.0, 0);
        for _ in 0..clusters.len() {
            let (s, count) = clusters[(stream.uniform() * clusters.len() as f64) as usize];
            sum += s;
            n += count;
        }
        sum / n as f64
    };
    let mut drawn: Vec<f64> = (0..RESAMPLES)
        .map(|_| signed_sum(samples, &samples.iter().map(&mut again).collect::<Vec<_>>()))
        .collect();
    drawn.sort_unstable_by(f64::total_cmp);

    let normal = Normal::standard();
    // Ties, which occur with few clusters, count half.
    let below = drawn.iter().filter(|&&x| x < estimate).count();
    let ties = drawn.iter().filter(|&&x| x == estimate).count();
    let share = (below as f64 + ties as f64 / 2.0) / RESAMPLES as f64;
    let half = 0.5 / RESAMPLES as f64;
    let bias = normal.inverse_cdf(share.clamp(half, 1.0 - half));
    let end = |z: f64| {
        let shifted = bias + z;
        let level = normal.cdf(bias + shifted / (1.0 - acceleration * shifted));
        quantile(&drawn, level.clamp(0.0, 1.0))
    };
    Interval { low: end(-z), high: end(z) }
}

/// Variance of the bootstrap and acceleration (a sixth of its skewness), from leaving out each cluster in turn.
fn influence(samples: &[Signed<'_>], means: &[f64]) -> (f64, f64) {
    let (mut squares, mut cubes) = (0.0, 0.0);
    for (i, (_, clusters)) in samples.iter().enumerate() {
        let (sum, n) = clusters.iter().fold((0.0, 0), |(s, n), &(a, b)| (s + a, n + b));
        let left: Vec<f64> = clusters
            .iter()
            .map(|&(s, count)| {
                let mut means = means.to_vec();
                means[i] = (sum - s) / (n - count) as f64;
                signed_sum(samples, &means)
            })
            .collect();
        let centre = left.iter().sum::<f64>() / left.len() as f64;
        // With several samples, each is weighted by the influence of one of its clusters.
        for value in left {
            let influence = (clusters.len() - 1) as f64 * (centre - value) / clusters.len() as f64;
            squares += influence * influence;
            cubes += influence * influence * influence;
        }
    }
    let acceleration = if squares > 0.0 { cubes / (6.0 * squares.powf(1.5)) } else { 0.0 };
    (squares, acceleration)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn independent(values: impl IntoIterator<Item = f64>) -> ValueSample {
        let mut sample = ValueSample::default();
        values.into_iter().for_each(|value| sample.add_cluster([value]));
        sample
    }

    fn of(values: &[f64]) -> Statistics {
        independent(values.iter().copied()).statistics(1).unwrap()
    }

    /// Expected values come from `numpy.percentile` and `matplotlib.cbook.boxplot_stats`.
    #[test]
    fn box_plots_equal_those_of_matplotlib() {
        let s = of(&[7.0, 1.0, 2.0, 100.0, 3.0, 4.0]);
        assert_eq!((s.q1, s.median, s.q3), (2.25, 3.5, 6.25));
        assert_eq!((s.whisker_low, s.whisker_high), (1.0, 7.0));
        assert_eq!(s.outliers, [100.0]);
        let s = of(&[1.0, 1.0, 1.0, 8.0]);
        assert_eq!((s.q3, s.whisker_high), (2.75, 2.75));
        assert_eq!(s.outliers, [8.0]);
    }

    /// Both methods on one skewed sample: the bootstrap's interval scatters by a few percent of its width.
    #[test]
    fn intervals_of_many_values_equal_those_of_the_bootstrap() {
        let value = |i: usize| (-(i as f64 + 0.5).ln() + (MOST_DRAWN as f64).ln()).powi(2);
        let drawn: Vec<f64> = (0..MOST_DRAWN).map(value).collect();
        let drawn = of(&drawn).mean_95.unwrap();
        let more: Vec<f64> = (0..MOST_DRAWN).chain([MOST_DRAWN / 2]).map(value).collect();
        let found = of(&more).mean_95.unwrap();
        let width = drawn.high - drawn.low;
        assert!((found.low - drawn.low).abs() < 0.05 * width, "{found:?} {drawn:?}");
        assert!((found.high - drawn.high).abs() < 0.05 * width, "{found:?} {drawn:?}");
    }

    #[test]
    fn one_value_has_no_spread_and_none_has_no_statistics() {
        let s = of(&[5.0]);
        assert_eq!((s.n, s.mean, s.sd, s.mean_95), (1, 5.0, None, None));
        assert_eq!((s.q1, s.whisker_high), (5.0, 5.0));
        assert_eq!(independent([f64::NAN]).statistics(1), None);
        assert_eq!(of(&[1.0, 2.0, 3.0, 4.0]).mean_95, None);
        let s = of(&[2.0; 5]);
        assert_eq!((s.sd, s.mean_95), (Some(0.0), Some(Interval { low: 2.0, high: 2.0 })));
    }

    #[test]
    fn the_interval_of_many_values_equals_that_of_the_normal_distribution() {
        let mut stream = RandomStream::new(9, Purpose::Readings, 0);
        let values: Vec<f64> = (0..2000).map(|_| 3.0 + stream.normal()).collect();
        let s = of(&values);
        let Interval { low, high } = s.mean_95.unwrap();
        let se = s.sd.unwrap() / f64::sqrt(2000.0);
        // Quantiles of 4000 draws scatter by √(0.025·0.975/4000)/φ(1.96) = 0.042 standard errors;
        // the limit is five times that.
        assert!((low - (s.mean - 1.96 * se)).abs() < 0.21 * se);
        assert!((high - (s.mean + 1.96 * se)).abs() < 0.21 * se);
    }

    fn coverage(trials: usize, mean: f64, mut value: impl FnMut(&mut RandomStream) -> f64) -> f64 {
        let mut stream = RandomStream::new(8, Purpose::Readings, 0);
        let held = (0..10_000).filter(|_| {
            let values = (0..trials).map(|_| value(&mut stream));
            let s = independent(values.collect::<Vec<_>>());
            interval(&[(1.0, &s.clusters)], 1).is_some_and(|i| i.low < mean && mean < i.high)
        });
        held.count() as f64 / 10_000.0
    }

    /// Five values, as many as the paper has trials, and more.
    #[test]
    fn intervals_hold_the_mean_of_few_values() {
        for trials in [5, 6, 7] {
            // Four binomial standard deviations of 0.22 % about 95 % for normal values, where the
            // interval is exact; 93 % for skewed values (Erlang's of order 4, skewness 1).
            let normal = coverage(trials, 0.0, RandomStream::normal);
            assert!((0.94..0.96).contains(&normal), "{trials}: {normal}");
            let erlang =
                |stream: &mut RandomStream| -(0..4).map(|_| stream.uniform().ln()).sum::<f64>();
            let skew = coverage(trials, 4.0, erlang);
            assert!((0.92..0.95).contains(&skew), "{trials}: {skew}");
        }
    }

    /// `t₄ = 2.7764`, `s/√5 = √0.5`.
    #[test]
    fn the_interval_of_five_values_is_students() {
        let Interval { low, high } = of(&[-2.0, -1.0, 0.0, 1.0, 2.0]).mean_95.unwrap();
        assert!((high - 2.776_445 * 0.5_f64.sqrt()).abs() < 1e-5 && (low + high).abs() < 1e-12);
    }

    /// Exponential values: the skewness of the mean of 40 must show.
    #[test]
    fn intervals_hold_the_mean_of_a_skew_distribution() {
        let mut stream = RandomStream::new(2, Purpose::Readings, 0);
        let held = (0..400).filter(|_| {
            let s = of(&(0..40).map(|_| -stream.uniform().ln()).collect::<Vec<_>>());
            s.mean_95.is_some_and(|i| i.low < 1.0 && 1.0 < i.high)
        });
        // BCa covers about 93.5 % here (Davison & Hinkley, §5.4); four binomial standard deviations.
        let share = held.count() as f64 / 400.0;
        assert!((0.885..0.985).contains(&share), "{share}");
    }

    #[test]
    fn strides_of_one_trial_are_drawn_together() {
        let mut stream = RandomStream::new(3, Purpose::Readings, 0);
        let (mut clustered, mut alone) = (ValueSample::default(), ValueSample::default());
        for _ in 0..20 {
            let level = stream.normal();
            clustered.add_cluster([level; 10]);
            alone.add_cluster([level]);
        }
        let (a, b) = (clustered.statistics(7).unwrap(), alone.statistics(7).unwrap());
        let width = |s: &Statistics| s.mean_95.map(|i| i.high - i.low).unwrap();
        assert_eq!((a.n, a.trials), (200, 20));
        // Both draw the same trials, but round sums differently.
        assert!((width(&a) / width(&b) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn errors_that_trials_share_widen_a_mean_and_cancel_in_a_difference() {
        let sample = |shift: f64, shared: [f64; 2]| {
            let mut sample = ValueSample::default();
            for value in [-2.0, -1.0, 0.0, 1.0, 2.0] {
                sample.add_cluster([value + shift]);
                sample.add_shared_error(&shared, f64::INFINITY);
            }
            sample
        };
        let (first, second) = (sample(0.0, [3.0, 4.0]), sample(10.0, [3.0, 0.0]));
        let Interval { low, high } = first.statistics(1).unwrap().mean_95.unwrap();
        // `t₄·√0.5` of the scatter and 1.96 of the common 5 add in quadrature.
        let expected = (2.776_445 * 0.5_f64.sqrt()).hypot(1.959_964 * 5.0);
        assert!((high - expected).abs() < 1e-4 && (low + high).abs() < 1e-12, "{high} {expected}");
        let difference = second.difference(&first, "first", 1).unwrap();
        let Interval { low, high } = difference.mean_95.unwrap();
        // Welch: eight degrees of freedom, `t₈ = 2.306`, variance 1; 4 remains of the common error.
        let expected = 2.306_004_f64.hypot(1.959_964 * 4.0);
        assert!(
            (high - 10.0 - expected).abs() < 1e-4 && (low + high - 20.0).abs() < 1e-9,
            "{high}"
        );
        let mut unknown = sample(0.0, [0.0; 2]);
        unknown.add_unknown_error();
        assert_eq!(unknown.statistics(1).unwrap().mean_95, None);
        assert_eq!(unknown.difference(&first, "first", 1).unwrap().mean_95, None);
    }

    #[test]
    fn the_difference_of_a_sample_shifted_is_the_shift() {
        let mut stream = RandomStream::new(4, Purpose::Readings, 0);
        let a: Vec<f64> = (0..30).map(|_| stream.normal()).collect();
        let b: Vec<f64> = (0..50).map(|_| 2.0 + 3.0 * stream.normal()).collect();
        let se = (1.0 / 30.0_f64 + 9.0 / 50.0).sqrt();
        let [a, b] = [a, b].map(independent);
        let d = b.difference(&a, "a", 1).unwrap();
        let Interval { low, high } = d.mean_95.unwrap();
        assert!(low < 2.0 && 2.0 < high && d.reference == "a");
        // Sample standard deviations of 30 and 50 values scatter by some 13 %; three times that.
        assert!(((high - low) / (2.0 * 1.96 * se) - 1.0).abs() < 0.4);
        assert_eq!(a.difference(&ValueSample::default(), "b", 1), None);
    }
}
