//! The reference at any time, after a low-pass.
//!
//! ```text
//! w(t) = Σ h(t − t_k) v_k x_k / Σ h(t − t_k) v_k      v_k = (t_{k+1} − t_{k−1}) / 2
//! ```
//!
//! This is the convolution with the kernel h by the trapezoidal rule over the actual sample times. There is no value if
//! the kernel would reach over a gap, rows out of range, or an end. The kernel is a sinc under a Kaiser window,
//! optionally averaged over an exposure:
//!
//! ```text
//! h(x) = 2 f_c sinc(2 f_c x) · I₀(β √(1 − (x/L)²)) / I₀(β)      |x| ≤ L
//! ```
//!
//! β and L follow from the stopband attenuation and the width of the transition (Kaiser 1974;
//! Oppenheim & Schafer, Discrete-Time Signal Processing, 3rd ed., eqs 7.75 and 7.76). The symmetric
//! kernel has no delay.

use std::f64::consts::PI;

use super::inner_products::dots;
use super::recording::Clean;

pub(super) const STOPBAND_DB: f64 = 80.0;
/// Half of the transition, as a fraction of the output rate.
const HALF_TRANSITION: f64 = 0.1;
/// Table entries per unit of 1/(2 f_c): linear interpolation errs by (π/512)²/8 = 5e-6, −106 dB.
const PER_LOBE: f64 = 512.0;

/// Longest gap that is bridged, in sampling periods …
const GAP_PERIODS: f64 = 2.5;
/// … or as a fraction of the output period, whichever is longer.
const GAP_OF_OUTPUT_PERIOD: f64 = 0.5;

#[derive(Debug)]
pub(super) struct Resampler<'a> {
    source: &'a Clean,
    kernel: Kernel,
    spacing_s: Vec<f64>,
    /// First row of the gap-free block around a row, and the row after its last.
    gap_free: Vec<(u32, u32)>,
    weights: Vec<f64>,
}

impl<'a> Resampler<'a> {
    /// Resampler for outputs at `rate_hz`, averaged over an exposure. Faster loads are attenuated.
    pub(super) fn new(source: &'a Clean, rate_hz: f64, exposure_s: f64, stopband_db: f64) -> Self {
        let time = &source.time_s;
        let gap_s = (GAP_PERIODS * source.period_s).max(GAP_OF_OUTPUT_PERIOD / rate_hz);
        let rows = time.len();
        let mut spacing_s = vec![0.0; rows];
        let mut gap_free = vec![(0, 0); rows];
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
                gap_free[k] = (first as u32, end as u32);
            }
            first = end;
        }
        let kernel = Kernel::new(rate_hz, exposure_s, stopband_db);
        Self { source, kernel, spacing_s, gap_free, weights: Vec::new() }
    }

    /// Computes the columns at `time_s` since the reference's start; returns false if there is no value.
    pub(super) fn at(&mut self, time_s: f64, values: &mut [f64]) -> bool {
        let time = &self.source.time_s;
        let reach_s = self.kernel.half_width_s;
        let (from, to) = (time_s - reach_s, time_s + reach_s);
        if !(from >= 0.0 && to <= self.source.span_s()) {
            return false;
        }
        let first = time.partition_point(|&t| t < from);
        let (begin, end) = self.gap_free[first];
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
        let mut columns = self.source.columns.iter().map(|column| &column[rows.clone()]);
        dots(&self.weights, &mut columns, values);
        values.iter_mut().for_each(|value| *value /= total);
        total > 0.5
    }
}

/// A tabulated symmetric low-pass kernel, 1/s.
#[derive(Clone, Debug)]
struct Kernel {
    half_width_s: f64,
    per_s: f64,
    table: Vec<f64>,
}

impl Kernel {
    /// Passes frequencies up to 0.3 times `rate_hz`, halves 0.4 times the rate, and attenuates
    /// those above half of the rate by `stopband_db`, at least 50, with the corresponding passband
    /// ripple. Averages over `exposure_s`, if above 0.
    fn new(rate_hz: f64, exposure_s: f64, stopband_db: f64) -> Self {
        let cutoff_hz = (0.5 - HALF_TRANSITION) * rate_hz;
        let transition_hz = 2.0 * HALF_TRANSITION * rate_hz;
        let beta = 0.1102 * (stopband_db - 8.7);
        let width_s = (stopband_db - 7.95) / (2.285 * 2.0 * PI * transition_hz);
        let half_s = 0.5 * width_s;
        let sinc = |x_s: f64| {
            let within = 1.0 - (x_s / half_s) * (x_s / half_s);
            if within < 0.0 {
                return 0.0;
            }
            let phase = 2.0 * PI * cutoff_hz * x_s;
            let sinc = if phase.abs() < 1e-8 { 1.0 } else { phase.sin() / phase };
            2.0 * cutoff_hz * sinc * bessel_i0(beta * within.sqrt()) / bessel_i0(beta)
        };
        let half_width_s = half_s + 0.5 * exposure_s;
        let per_s = PER_LOBE * 2.0 * cutoff_hz;
        let entries = (half_width_s * per_s).ceil() as usize + 2;
        // Midpoint rule, with steps much finer than the lobes of the kernel.
        let parts = (exposure_s * 2.0 * cutoff_hz * 64.0).ceil().clamp(1.0, 4096.0) as usize;
        let value = |x_s: f64| {
            let part = |i: usize| x_s + exposure_s * ((i as f64 + 0.5) / parts as f64 - 0.5);
            (0..parts).map(|i| sinc(part(i))).sum::<f64>() / parts as f64
        };
        let table = (0..entries).map(|i| value(i as f64 / per_s)).collect();
        Self { half_width_s, per_s, table }
    }

    /// The kernel at a distance of at most `half_width_s` in either direction, 1/s.
    #[inline]
    fn at(&self, distance_s: f64) -> f64 {
        let position = distance_s.abs() * self.per_s;
        let index = (position as usize).min(self.table.len() - 2);
        let (a, b) = (self.table[index], self.table[index + 1]);
        a + (b - a) * (position - index as f64)
    }
}

/// The modified Bessel function of order 0, by its power series (all terms positive).
fn bessel_i0(x: f64) -> f64 {
    let quarter = 0.25 * x * x;
    let (mut term, mut sum) = (1.0, 1.0);
    for k in 1..200 {
        term *= quarter / f64::from(k * k);
        sum += term;
        if term < 1e-17 * sum {
            break;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::super::{Recording, RecordingSide};
    use super::*;

    fn clean(time_s: Vec<f64>, value: impl Fn(f64) -> f64) -> Clean {
        let columns = vec![time_s.iter().map(|&t| value(t)).collect()];
        Clean::new(Recording { time_s, columns }, RecordingSide::Reference, false).unwrap()
    }

    fn even(rate_hz: f64) -> Vec<f64> {
        (0..=(6.0 * rate_hz) as usize).map(|k| k as f64 / rate_hz).collect()
    }

    fn worst(source: &Clean, expected: impl Fn(f64) -> f64) -> f64 {
        let mut resampler = Resampler::new(source, 100.0, 0.0, STOPBAND_DB);
        let mut value = [0.0];
        let times = (0..500).map(|i| 0.3 + 0.0027 * f64::from(i));
        times.fold(0.0, |worst, t| {
            assert!(resampler.at(t, &mut value), "{t}");
            f64::max(worst, (value[0] - expected(t)).abs())
        })
    }

    #[test]
    fn sines_below_the_cutoff_pass_unchanged_without_delay() {
        for frequency_hz in [0.7, 8.3, 21.0, 29.0] {
            let sine = |t: f64| (TAU * frequency_hz * t).sin();
            for rate_hz in [500.0, 1000.0, 10_000.0] {
                // The ripple at 80 dB.
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
        // The error of the trapezoidal rule with steps of 1 and 2 ms and a lobe of 12.5 ms.
        assert!(worst(&clean(time_s, slope), slope) < 2e-3);
    }

    #[test]
    fn gaps_ends_and_rows_out_of_range_give_no_value() {
        let time_s = even(1000.0).into_iter().filter(|t| !(1.0..1.01).contains(t)).collect();
        let mut source = clean(time_s, |t| t);
        let clipped = source.time_s.partition_point(|&t| t < 1.5);
        source.in_range[clipped] = false;
        let mut resampler = Resampler::new(&source, 100.0, 0.0, STOPBAND_DB);
        let reach_s = resampler.kernel.half_width_s;
        let mut covered = |t: f64| resampler.at(t, &mut [0.0]);
        for t in [-1.0, 0.0, 0.9 * reach_s, 1.005, 1.0 - 0.9 * reach_s, 1.5, 5.95, 6.5, f64::NAN] {
            assert!(!covered(t), "{t}");
        }
        for t in [1.01 * reach_s, 0.6, 1.25, 1.74] {
            assert!(covered(t), "{t}");
        }
    }

    #[test]
    fn going_back_in_time_gives_the_same_values() {
        let source = clean(even(1000.0), |t| (20.0 * t).sin());
        let mut resampler = Resampler::new(&source, 100.0, 0.0, STOPBAND_DB);
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

    fn gain(kernel: &Kernel, frequency_hz: f64) -> f64 {
        let steps = 200_000;
        let step_s = 2.0 * kernel.half_width_s / f64::from(steps);
        let x = |i: i32| f64::from(i) * step_s - kernel.half_width_s;
        let term = |i| kernel.at(x(i)) * (2.0 * PI * frequency_hz * x(i)).cos() * step_s;
        (0..=steps).map(term).sum()
    }

    #[test]
    fn bessel_function_has_its_tabulated_values() {
        // Abramowitz & Stegun, table 9.8: e⁻ˣ I₀(x) at 1, 5 and 10.
        for (x, scaled) in [(1.0, 0.465_759_6), (5.0, 0.183_540_8), (10.0, 0.127_833_3_f64)] {
            assert!((bessel_i0(x) * (-x).exp() - scaled).abs() < 1e-7, "{x}");
        }
    }

    #[test]
    fn a_kernel_passes_the_band_halves_the_cutoff_and_stops_the_rest() {
        for db in [50.0, 80.0] {
            let kernel = Kernel::new(100.0, 0.0, db);
            // The interpolation error of the table is 5e-6.
            let ripple = 1.3 * 10.0_f64.powf(-db / 20.0) + 5e-6;
            for frequency_hz in [0.0, 3.0, 11.0, 20.0, 29.9] {
                assert!((gain(&kernel, frequency_hz) - 1.0).abs() < ripple, "{frequency_hz}");
            }
            assert!((gain(&kernel, 40.0) - 0.5).abs() < 1e-3);
            for frequency_hz in [50.1, 55.0, 73.0, 120.0, 400.0] {
                assert!(gain(&kernel, frequency_hz).abs() < ripple, "{frequency_hz}");
            }
        }
    }

    #[test]
    fn an_exposure_adds_its_own_average() {
        let (plain, averaged) = (Kernel::new(100.0, 0.0, 80.0), Kernel::new(100.0, 8e-3, 80.0));
        for frequency_hz in [0.0, 10.0, 25.0] {
            let phase = PI * frequency_hz * 8e-3;
            let sinc = if phase == 0.0 { 1.0 } else { phase.sin() / phase };
            let expected = gain(&plain, frequency_hz) * sinc;
            assert!((gain(&averaged, frequency_hz) - expected).abs() < 2e-4, "{frequency_hz}");
        }
    }
}
