//! The reference at any time, through a low-pass.
//!
//! ```text
//! w(t) = Σ h(t − t_k) v_k x_k / Σ h(t − t_k) v_k      v_k = (t_{k+1} − t_{k−1}) / 2
//! ```
//!
//! which is the convolution with the [kernel](super::Kernel) by the trapezoidal rule over the times
//! at which the reference was really sampled. Where the kernel would reach over a gap, over rows out
//! of range, or past an end there is no value.

use super::kernel::Kernel;
use super::recording::Clean;

/// A gap is bridged up to this many periods of the sampling …
const GAP_PERIODS: f64 = 2.5;
/// … or this fraction of a period at the cut-off, whichever is longer.
const GAP_OF_OUTPUT_PERIOD: f64 = 0.25;

/// A recording that can be asked for its values at any time.
#[derive(Debug)]
pub(super) struct Resampler<'a> {
    source: &'a Clean,
    kernel: &'a Kernel,
    /// v_k, s.
    spacing_s: Vec<f64>,
    /// First row of the stretch without gaps that a row is in, and the row after its last.
    stretch: Vec<(u32, u32)>,
    /// Where the kernel began at the last call: calls mostly go forward in time.
    cursor: usize,
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
        Self { source, kernel, spacing_s, stretch, cursor: 0 }
    }

    /// The columns at `time_s` (on the reference's clock, since its start); false if there is no
    /// value.
    pub(super) fn at(&mut self, time_s: f64, values: &mut [f64]) -> bool {
        let time = &self.source.time_s;
        let reach_s = self.kernel.half_width_s();
        let (from, to) = (time_s - reach_s, time_s + reach_s);
        if !(from >= 0.0 && to <= self.source.span_s()) {
            return false;
        }
        if time[self.cursor] > from {
            self.cursor = 0;
        }
        // Forward by doubling steps, then by halves.
        let mut step = 1;
        while self.cursor + step < time.len() && time[self.cursor + step] < from {
            self.cursor += step;
            step *= 2;
        }
        let window = &time[self.cursor..(self.cursor + step).min(time.len())];
        self.cursor += window.partition_point(|&t| t < from);
        let first = self.cursor;
        self.cursor = first.saturating_sub(1);
        if first >= time.len() {
            return false;
        }
        let (begin, end) = self.stretch[first];
        let begins_inside = (begin as usize) < first || time[first] == from;
        if !begins_inside || time[end as usize - 1] < to {
            return false;
        }
        let last = first + time[first..end as usize].partition_point(|&t| t <= to);
        let columns = &self.source.columns;
        values.fill(0.0);
        let mut total = 0.0;
        for k in first..last {
            let weight = self.kernel.at(time[k] - time_s) * self.spacing_s[k];
            total += weight;
            for (value, column) in values.iter_mut().zip(columns) {
                *value += weight * column[k];
            }
        }
        values.iter_mut().for_each(|value| *value /= total);
        total > 0.5
    }
}
