//! The reference at any time, through a low-pass.
//!
//! ```text
//! w(t) = Σ h(t − t_k) v_k x_k / Σ h(t − t_k) v_k      v_k = (t_{k+1} − t_{k−1}) / 2
//! ```
//!
//! which is the convolution with the [kernel](super::Kernel) by the trapezoidal rule over the times
//! at which the reference was really sampled. Where the kernel would reach over a gap, over rows
//! out of range, or past an end there is no value.

use super::inner_products::dots;
use super::kernel::Kernel;
use super::recording::Clean;

/// A gap is bridged up to this many periods of the sampling …
const GAP_PERIODS: f64 = 2.5;
/// … or this fraction of a period at the cut-off, whichever is longer.
const GAP_OF_OUTPUT_PERIOD: f64 = 0.5;

/// A recording that can be asked for its values at any time.
#[derive(Debug)]
pub(super) struct Resampler<'a> {
    source: &'a Clean,
    kernel: &'a Kernel,
    /// v_k, s.
    spacing_s: Vec<f64>,
    /// First row of the stretch without gaps that a row is in, and the row after its last.
    stretch: Vec<(u32, u32)>,
    weights: Vec<f64>,
}

impl<'a> Resampler<'a> {
    /// For outputs `rate_hz` times per second, which `kernel` was made for.
    pub(super) fn new(source: &'a Clean, kernel: &'a Kernel, rate_hz: f64) -> Self {
        let time = &source.time_s;
        let gap_s = (GAP_PERIODS * source.period_s).max(GAP_OF_OUTPUT_PERIOD / rate_hz);
        let rows = time.len();
        let mut spacing_s = vec![0.0; rows];
        let mut stretch = vec![(0, 0); rows];
        let joined = |k: usize| {
            source.in_range[k] && source.in_range[k + 1] && time[k + 1] - time[k] <= gap_s
        };
        let mut first = 0;
        while first < rows {
            let end = (first..rows - 1).find(|&k| !joined(k)).map_or(rows, |k| k + 1);
            for k in first..end {
                let before = time[k] - time[k.saturating_sub(1).max(first)];
                let after = time[(k + 1).min(end - 1)] - time[k];
                spacing_s[k] = 0.5 * (before + after);
                stretch[k] = (first as u32, end as u32);
            }
            first = end;
        }
        Self { source, kernel, spacing_s, stretch, weights: Vec::new() }
    }

    /// The columns at `time_s` (on the reference's clock, since its start); false if there is no
    /// value.
    pub(super) fn at(&mut self, time_s: f64, values: &mut [f64]) -> bool {
        let time = &self.source.time_s;
        let reach_s = self.kernel.half_width_s;
        let (from, to) = (time_s - reach_s, time_s + reach_s);
        if !(from >= 0.0 && to <= self.source.span_s()) {
            return false;
        }
        let first = time.partition_point(|&t| t < from);
        let (begin, end) = self.stretch[first];
        let begins_inside = (begin as usize) < first || time[first] == from;
        if !begins_inside || time[end as usize - 1] < to {
            return false;
        }
        let last = first + time[first..end as usize].partition_point(|&t| t <= to);
        let rows = first..last;
        self.weights.clear();
        let spacing = &self.spacing_s[rows.clone()];
        let weight = |(&t, &v): (&f64, &f64)| self.kernel.at(t - time_s) * v;
        self.weights.extend(time[rows.clone()].iter().zip(spacing).map(weight));
        let total: f64 = self.weights.iter().sum();
        let columns = self.source.columns.iter().map(|column| &column[rows.clone()]);
        dots(&self.weights, columns, values);
        values.iter_mut().for_each(|value| *value /= total);
        total > 0.5
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::super::kernel::STOPBAND_DB;
    use super::super::{Recording, RecordingSide};
    use super::*;

    fn clean(time_s: Vec<f64>, value: impl Fn(f64) -> f64) -> Clean {
        let columns = vec![time_s.iter().map(|&t| value(t)).collect()];
        Clean::new(Recording { time_s, columns }, RecordingSide::Reference, 0.1, false).unwrap()
    }

    fn even(rate_hz: f64) -> Vec<f64> {
        (0..=(2.0 * rate_hz) as usize).map(|k| k as f64 / rate_hz).collect()
    }

    /// Largest error against `expected` at uneven times.
    fn worst(source: &Clean, expected: impl Fn(f64) -> f64) -> f64 {
        let kernel = Kernel::new(100.0, 0.0, STOPBAND_DB);
        let mut resampler = Resampler::new(source, &kernel, 100.0);
        let mut value = [0.0];
        let times = (0..500).map(|i| 0.3 + 0.0027 * f64::from(i));
        times.fold(0.0, |worst, t| {
            assert!(resampler.at(t, &mut value), "{t}");
            f64::max(worst, (value[0] - expected(t)).abs())
        })
    }

    #[test]
    fn sines_below_the_cutoff_come_out_as_they_are_and_without_delay() {
        for frequency_hz in [0.7, 8.3, 21.0, 29.0] {
            let sine = |t: f64| (TAU * frequency_hz * t).sin();
            for rate_hz in [500.0, 1000.0, 10_000.0] {
                // The ripple of 80 dB.
                assert!(worst(&clean(even(rate_hz), sine), sine) < 2e-4, "{frequency_hz}");
            }
        }
    }

    #[test]
    fn sines_above_the_boards_nyquist_frequency_are_stopped() {
        for frequency_hz in [51.0, 63.0, 99.0, 180.0] {
            let source = clean(even(1000.0), |t| (TAU * frequency_hz * t).sin());
            assert!(worst(&source, |_| 0.0) < 2e-4, "{frequency_hz}");
        }
    }

    #[test]
    fn uneven_sampling_neither_delays_nor_scales() {
        // Every third to seventh sample of an even clock is missing.
        let time_s: Vec<f64> = even(1000.0)
            .into_iter()
            .enumerate()
            .filter(|(k, _)| k % 7 % 3 != 2)
            .map(|p| p.1)
            .collect();
        let slope = |t: f64| 3.0 * t - 1.0;
        // The trapezoidal rule over steps of 1 and 2 ms against a lobe of 12.5 ms.
        assert!(worst(&clean(time_s, slope), slope) < 2e-3);
    }

    #[test]
    fn nothing_comes_from_gaps_ends_or_rows_out_of_range() {
        let time_s = even(1000.0).into_iter().filter(|t| !(1.0..1.01).contains(t)).collect();
        let mut source = clean(time_s, |t| t);
        let clipped = source.time_s.partition_point(|&t| t < 1.5);
        source.in_range[clipped] = false;
        let kernel = Kernel::new(100.0, 0.0, STOPBAND_DB);
        let reach_s = kernel.half_width_s;
        let mut resampler = Resampler::new(&source, &kernel, 100.0);
        let mut covered = |t: f64| resampler.at(t, &mut [0.0]);
        for t in [-1.0, 0.0, 0.9 * reach_s, 1.005, 1.0 - 0.9 * reach_s, 1.5, 1.95, 2.5, f64::NAN] {
            assert!(!covered(t), "{t}");
        }
        for t in [1.01 * reach_s, 0.6, 1.25, 1.74] {
            assert!(covered(t), "{t}");
        }
    }

    #[test]
    fn going_back_in_time_gives_the_same_values() {
        let source = clean(even(1000.0), |t| (20.0 * t).sin());
        let kernel = Kernel::new(100.0, 0.0, STOPBAND_DB);
        let mut resampler = Resampler::new(&source, &kernel, 100.0);
        let times: Vec<f64> = (0..100).map(|i| 0.3 + 0.013 * f64::from(i)).collect();
        let mut value = [0.0];
        let mut at = |&t: &f64| {
            assert!(resampler.at(t, &mut value));
            value[0]
        };
        let forward: Vec<f64> = times.iter().map(&mut at).collect();
        let backward: Vec<f64> = times.iter().rev().map(&mut at).collect();
        assert!(forward.iter().eq(backward.iter().rev()));
    }
}
