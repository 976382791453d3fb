//! Means and integrals over a window of signals known at the times of rows.
//!
//! By time, a signal runs straight between rows (the trapezoid rule), so rows may be missing or
//! uneven, and a window may begin and end between them. By row, each row in the window is a sample.

use std::ops::Range;

use forces::RowRule;

/// A window over rows.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Span {
    /// By time.
    Time(TrapezoidWeights),
    /// By row.
    Rows(Range<usize>),
}

impl Span {
    /// The window from `from_s` to `to_s` over rows at ascending `times`; `None` if it is not within
    /// them, has no length, or, by row, holds no row.
    pub(super) fn new(rule: RowRule, times: &[f64], from_s: f64, to_s: f64) -> Option<Self> {
        let weights = TrapezoidWeights::new(times, from_s, to_s)?;
        match rule {
            RowRule::Time => Some(Self::Time(weights)),
            RowRule::Rows => {
                let rows = rows_within(times, from_s, to_s);
                (!rows.is_empty()).then_some(Self::Rows(rows))
            }
        }
    }

    /// The mean of a signal that has a value for every row.
    pub(super) fn mean(&self, signal: &[f64]) -> f64 {
        self.shares().map(|(row, share)| share * signal[row]).sum()
    }

    /// The integral of a signal over time, in its unit times s. By row: the sum of each row's value
    /// times the time since the row before, from the second row on.
    pub(super) fn integral(&self, times: &[f64], signal: &[f64]) -> f64 {
        match self {
            Self::Time(weights) => weights.integral(signal),
            Self::Rows(rows) => {
                let step = |row: usize| signal[row] * (times[row] - times[row - 1]);
                (rows.start + 1..rows.end).map(step).sum()
            }
        }
    }

    /// Each row that counts, and its share of the mean.
    pub(super) fn shares(&self) -> Box<dyn Iterator<Item = (usize, f64)> + '_> {
        match self {
            Self::Time(weights) => Box::new(weights.shares()),
            Self::Rows(rows) => {
                let share = 1.0 / rows.len() as f64;
                Box::new(rows.clone().map(move |row| (row, share)))
            }
        }
    }
}

/// The rows at `times` from one time to another, both included.
pub(super) fn rows_within(times: &[f64], from_s: f64, to_s: f64) -> Range<usize> {
    times.partition_point(|&t| t < from_s)..times.partition_point(|&t| t <= to_s)
}

/// What the value of each row counts for in the integral over a window: `∫f dt = Σ weight·f`.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct TrapezoidWeights {
    /// The rows that count.
    pub(super) rows: Range<usize>,
    /// Their weights, s.
    weights: Vec<f64>,
    duration_s: f64,
}

impl TrapezoidWeights {
    /// Those of the window from `from_s` to `to_s` over rows at ascending `times`, which it lies
    /// within; `None` if it does not, or has no length.
    pub(super) fn new(times: &[f64], from_s: f64, to_s: f64) -> Option<Self> {
        if from_s >= to_s || !(*times.first()? <= from_s && to_s <= *times.last()?) {
            return None;
        }
        // From the last row not after the start to the first not before the end.
        let start = times.partition_point(|&t| t <= from_s) - 1;
        let end = times.partition_point(|&t| t < to_s);
        let mut weights = vec![0.0; end - start + 1];
        for (i, pair) in times[start..=end].windows(2).enumerate() {
            let (a, b) = (pair[0].max(from_s), pair[1].min(to_s));
            let (length, step) = (b - a, pair[1] - pair[0]);
            if length > 0.0 {
                // The line between the two, at the middle of what lies in the window.
                let share = (0.5 * (a + b) - pair[0]) / step;
                weights[i] += length * (1.0 - share);
                weights[i + 1] += length * share;
            }
        }
        Some(Self { rows: start..end + 1, weights, duration_s: to_s - from_s })
    }

    /// The integral of a signal, in its unit times s. `signal` has a value for every row.
    pub(super) fn integral(&self, signal: &[f64]) -> f64 {
        let values = &signal[self.rows.clone()];
        values.iter().zip(&self.weights).map(|(value, weight)| value * weight).sum()
    }

    /// Each row that counts, and its share of the mean.
    fn shares(&self) -> impl Iterator<Item = (usize, f64)> {
        let share = |weight| weight / self.duration_s;
        self.rows.clone().zip(self.weights.iter().map(share))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn straight_signals_are_integrated_exactly_over_any_window_and_rows() {
        let times = [0.0, 0.5, 0.5, 2.0, 2.25, 4.0];
        let line: Vec<f64> = times.iter().map(|t| 3.0 * t - 1.0).collect();
        for (from, to) in [(0.0, 4.0), (0.25, 0.5), (0.5, 3.0), (2.0, 2.25), (2.1, 2.2), (3.9, 4.0)]
        {
            let weights = TrapezoidWeights::new(&times, from, to).unwrap();
            let exact = 1.5 * (to * to - from * from) - (to - from);
            // Rounding of a few terms of size up to 20.
            assert!((weights.integral(&line) - exact).abs() < 1e-14, "{from} {to}");
            let shares: f64 = weights.shares().map(|(_, share)| share).sum();
            assert!((shares - 1.0).abs() < 1e-15);
        }
    }

    #[test]
    fn by_row_every_row_counts_the_same() {
        let times = [0.0, 0.5, 0.6, 2.0, 2.5];
        let signal = [9.0, 1.0, 2.0, 6.0, 9.0];
        let span = Span::new(RowRule::Rows, &times, 0.5, 2.25).unwrap();
        assert!((span.mean(&signal) - 3.0).abs() < 1e-15);
        assert!((span.integral(&times, &signal) - (2.0 * 0.1 + 6.0 * 1.4)).abs() < 1e-15);
        assert_eq!(Span::new(RowRule::Rows, &times, 0.7, 0.8), None);
    }

    #[test]
    fn windows_beyond_the_rows_or_without_length_have_no_integral() {
        let times = [1.0, 2.0, 3.0];
        for (from, to) in [(0.9, 2.0), (2.0, 3.1), (2.0, 2.0), (3.0, 2.0), (f64::NAN, 2.0)] {
            assert_eq!(TrapezoidWeights::new(&times, from, to), None, "{from} {to}");
        }
        assert_eq!(TrapezoidWeights::new(&[], 0.0, 1.0), None);
    }
}
