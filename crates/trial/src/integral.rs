//! Means and integrals over a window, of signals known at the times of rows.
//!
//! By time, a signal is linear between rows (trapezoid rule), and rows may be missing or uneven. By row, each row is a
//! sample.

use std::ops::Range;

use forces::RowRule;

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Span {
    /// The contributing rows, with their shares of the mean.
    pub(super) shares: Vec<(usize, f64)>,
    /// The contributing rows, with their weights in the integral over time, s.
    weights: Vec<(usize, f64)>,
}

impl Span {
    /// The window from `from_s` to `to_s` over rows at ascending `times`. `None` if the times do not contain the
    /// window, if it has no length or, by row, if it has no row. By row, the integral sums values times the time since
    /// the previous row.
    pub(super) fn new(rule: RowRule, times: &[f64], from_s: f64, to_s: f64) -> Option<Self> {
        let around = rows_around(times, from_s, to_s)?;
        if rule == RowRule::Time {
            // The weight of each row: ∫f dt = Σ weight·f.
            let mut weights: Vec<(usize, f64)> = around.clone().map(|row| (row, 0.0)).collect();
            for (i, pair) in times[around].windows(2).enumerate() {
                let (a, b) = (pair[0].max(from_s), pair[1].min(to_s));
                let (length, step) = (b - a, pair[1] - pair[0]);
                if length > 0.0 {
                    // The middle of the part in the window, as a fraction of the way between the two rows.
                    let share = (0.5 * (a + b) - pair[0]) / step;
                    weights[i].1 += length * (1.0 - share);
                    weights[i + 1].1 += length * share;
                }
            }
            let share = |&(row, weight): &(usize, f64)| (row, weight / (to_s - from_s));
            return Some(Self { shares: weights.iter().map(share).collect(), weights });
        }
        let rows = rows_within(times, from_s, to_s);
        let share = 1.0 / rows.len() as f64;
        let later = rows.clone().skip(1).map(|row| (row, times[row] - times[row - 1]));
        (!rows.is_empty()).then(|| Self {
            weights: later.collect(),
            shares: rows.map(|row| (row, share)).collect(),
        })
    }

    pub(super) fn mean(&self, signal: &[f64]) -> f64 {
        self.shares.iter().map(|&(row, share)| share * signal[row]).sum()
    }

    /// The integral of a signal over time, in its unit times s.
    pub(super) fn integral(&self, signal: &[f64]) -> f64 {
        self.weights.iter().map(|&(row, weight)| signal[row] * weight).sum()
    }
}

pub(super) fn rows_within(times: &[f64], from_s: f64, to_s: f64) -> Range<usize> {
    times.partition_point(|&t| t < from_s)..times.partition_point(|&t| t <= to_s)
}

/// Rows from the last one not after `from_s` to the first not before `to_s`; `None` if these are
/// not in order within `times`.
pub(super) fn rows_around(times: &[f64], from_s: f64, to_s: f64) -> Option<Range<usize>> {
    if from_s >= to_s || !(*times.first()? <= from_s && to_s <= *times.last()?) {
        return None;
    }
    let start = times.partition_point(|&t| t <= from_s) - 1;
    Some(start..times.partition_point(|&t| t < to_s) + 1)
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
            let span = Span::new(RowRule::Time, &times, from, to).unwrap();
            let exact = 1.5 * (to * to - from * from) - (to - from);
            // Rounding of a few terms of size up to 20.
            assert!((span.integral(&line) - exact).abs() < 1e-14, "{from} {to}");
            let shares: f64 = span.shares.iter().map(|(_, share)| share).sum();
            assert!((shares - 1.0).abs() < 1e-15);
        }
    }

    #[test]
    fn integrals_by_row_weight_all_rows_equally() {
        let times = [0.0, 0.5, 0.6, 2.0, 2.5];
        let signal = [9.0, 1.0, 2.0, 6.0, 9.0];
        let span = Span::new(RowRule::Rows, &times, 0.5, 2.25).unwrap();
        assert!((span.mean(&signal) - 3.0).abs() < 1e-15);
        assert!((span.integral(&signal) - (2.0 * 0.1 + 6.0 * 1.4)).abs() < 1e-15);
        assert_eq!(Span::new(RowRule::Rows, &times, 0.7, 0.8), None);
    }

    #[test]
    fn windows_beyond_the_rows_or_without_length_have_no_integral() {
        let times = [1.0, 2.0, 3.0];
        for (from, to) in [(0.9, 2.0), (2.0, 3.1), (2.0, 2.0), (3.0, 2.0), (f64::NAN, 2.0)] {
            assert_eq!(Span::new(RowRule::Time, &times, from, to), None, "{from} {to}");
        }
        assert_eq!(Span::new(RowRule::Time, &[], 0.0, 1.0), None);
    }
}
