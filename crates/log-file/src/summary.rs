//! Statistics of a scan through a log: its timing, and the ranges and suspicious values of its columns.
//!
//! Blocks are added in file order; memory does not grow with their number. No statistic depends on the meaning of the
//! readings.

use shell_data::Converter;
use shell_data::block::Block;
use shell_data::statistics::RunningVariance;

/// The summary of the rows read so far.
#[derive(Clone, Debug, Default)]
pub struct LogSummary {
    pub rows: u64,
    /// Number of rows whose readings equal those of the previous row.
    pub repeated_rows: u64,
    pub timing: LogTiming,
    /// Readings in counts.
    pub readings: Vec<ColumnSummary>,
    /// Wrench in N and N·m.
    pub wrench: Vec<ColumnSummary>,
}

impl LogSummary {
    pub fn add(&mut self, block: &Block) {
        self.repeated_rows += block.repeated_rows() as u64;
        self.timing.add(&block.time_s, self.rows);
        for (summaries, columns) in
            [(&mut self.readings, &block.readings), (&mut self.wrench, &block.wrench)]
        {
            summaries.resize_with(columns.len(), ColumnSummary::default);
            summaries.iter_mut().zip(columns).for_each(|(summary, column)| summary.add(column));
        }
        self.rows += block.rows as u64;
    }

    /// Returns frames per second that are not repeats, over the whole log; `None` without time.
    pub fn fresh_rate_hz(&self) -> Option<f64> {
        let duration_s = self.timing.duration_s().filter(|&duration| duration > 0.0)?;
        let fresh = self.rows - self.repeated_rows;
        Some(fresh.saturating_sub(1) as f64 / duration_s)
    }
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct ColumnSummary {
    /// Number of values, at least one.
    pub rows: u64,
    pub min: f64,
    pub max: f64,
    pub rows_at_max: u64,
    pub rows_below_max: u64,
    rows_at_min: u64,
    below_max: f64,
    /// Number of rises to the largest value from below the second largest: flicker between both does not count.
    rises_to_max: u64,
    last: f64,
    /// Distinct values in order of appearance, up to one more than a quiet column has.
    values: Vec<f64>,
    variance: RunningVariance,
}

impl ColumnSummary {
    fn add(&mut self, values: &[f64]) {
        let Some(&first) = values.first() else { return };
        if self.rows == 0 {
            (self.min, self.max, self.below_max) = (first, f64::NEG_INFINITY, f64::NEG_INFINITY);
            self.last = f64::NAN;
        }
        for &value in values {
            if self.values.len() <= QUIET_VALUES && !self.values.contains(&value) {
                self.values.push(value);
            }
            if value < self.min {
                (self.min, self.rows_at_min) = (value, 0);
            }
            self.rows_at_min += u64::from(value == self.min);
            if value > self.max {
                (self.below_max, self.rows_below_max) = (self.max, self.rows_at_max);
                (self.max, self.rows_at_max) = (value, 1);
                self.rises_to_max = u64::from(self.last < self.below_max);
            } else if value == self.max {
                self.rows_at_max += 1;
                self.rises_to_max += u64::from(self.last < self.below_max);
            } else if value > self.below_max {
                (self.below_max, self.rows_below_max) = (value, 1);
            } else if value == self.below_max {
                self.rows_below_max += 1;
            }
            self.last = value;
        }
        self.variance.merge(&RunningVariance::new(values));
        self.rows += values.len() as u64;
    }

    /// Returns the mean, 0 without values.
    pub fn mean(&self) -> f64 {
        self.variance.mean
    }

    /// Returns the standard deviation (n − 1 in the denominator), 0 for a single value.
    pub fn sd(&self) -> f64 {
        match self.rows {
            0 | 1 => 0.0,
            rows => (self.variance.squares / (rows - 1) as f64).sqrt(),
        }
    }

    /// Returns true if there are several values and all are equal.
    pub fn is_constant(&self) -> bool {
        self.rows > 1 && self.min == self.max
    }

    /// Returns true if the column is clipped at its largest value, at any level: at least one row in a hundred and at
    /// least twenty rows have that value, three times as many as the second largest, and the column reaches it at least
    /// three times. A signal that turns around or rests once at its largest value is not clipped, nor is a quiet column
    /// with [few values](Self::quiet_values).
    pub fn is_pinned_at_max(&self) -> bool {
        let often = self.rows_at_max >= 20 && self.rows_at_max >= self.rows / 100;
        let returns = self.rises_to_max >= RISES && self.rows_at_max >= 3 * self.rows_below_max;
        self.values.len() > QUIET_VALUES && often && returns
    }

    /// Returns the number of distinct values of a column that only flickers: two to four in at least twenty rows.
    pub fn quiet_values(&self) -> Option<usize> {
        let is_quiet = self.rows >= 20 && (2..=QUIET_VALUES).contains(&self.values.len());
        is_quiet.then_some(self.values.len())
    }

    /// Returns the ends of the converter's range that were reached, with the number of rows at each.
    pub fn rows_at_ends(&self) -> Vec<(f64, u64)> {
        let Some(converter) = Converter::of_extremes(self.min, self.max) else { return Vec::new() };
        let mut ends = vec![(self.min, self.rows_at_min), (self.max, self.rows_at_max)];
        ends.dedup_by_key(|(end, _)| *end);
        ends.retain(|(end, _)| converter.is_at_end(*end));
        ends
    }

    pub fn saturated_rows(&self) -> u64 {
        self.rows_at_ends().iter().map(|(_, rows)| rows).sum()
    }
}

/// A clipped signal reaches its limit repeatedly; the highest of several poses is reached once.
const RISES: u64 = 3;

/// The most distinct values of a column whose last digit flickers.
const QUIET_VALUES: usize = 4;

#[derive(Clone, Debug, Default)]
pub struct LogTiming {
    pub start_s: Option<f64>,
    pub end_s: Option<f64>,
    pub backward_steps: u64,
    /// The first row (from 0) whose time is before that of the previous row.
    pub first_backward_row: Option<u64>,
    /// Number of times that two consecutive rows have the same time.
    pub equal_times: u64,
    pub longest: Option<SampleInterval>,
    intervals: IntervalHistogram,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampleInterval {
    pub length_s: f64,
    pub start_s: f64,
    /// The row (from 0) at the end of the interval.
    pub row: u64,
}

/// Gaps with missing rows: intervals of more than 1.5 times the median.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Gaps {
    pub count: u64,
    /// Number of rows that would fill the gaps at the median interval.
    pub missing_rows: u64,
}

impl LogTiming {
    fn add(&mut self, time_s: &[f64], first_row: u64) {
        for (row, &time) in (first_row..).zip(time_s) {
            if let Some(before) = self.end_s {
                self.step(before, time, row);
            }
            self.start_s.get_or_insert(time);
            self.end_s = Some(time);
        }
    }

    fn step(&mut self, before: f64, time: f64, row: u64) {
        let length_s = time - before;
        if length_s < 0.0 {
            self.backward_steps += 1;
            self.first_backward_row.get_or_insert(row);
            return;
        }
        self.equal_times += u64::from(length_s == 0.0);
        self.intervals.add((length_s * 1e6).round() as u64);
        if self.longest.is_none_or(|longest| length_s > longest.length_s) {
            self.longest = Some(SampleInterval { length_s, start_s: before, row });
        }
    }

    /// Returns the last time minus the first time, in s.
    pub fn duration_s(&self) -> Option<f64> {
        Some(self.end_s? - self.start_s?)
    }

    /// Returns the median interval in s, at most the longest. The resolution is 1 µs up to 65 ms, and a
    /// relative 3 × 10⁻⁵ above.
    pub fn median_interval_s(&self) -> Option<f64> {
        let longest = self.longest.map_or(f64::INFINITY, |longest| longest.length_s);
        Some((self.intervals.median()? * 1e-6).min(longest))
    }

    /// Returns the rate of rows in Hz, from the median interval; `None` if that is 0.
    pub fn median_rate_hz(&self) -> Option<f64> {
        self.median_interval_s().filter(|&interval| interval > 0.0).map(f64::recip)
    }

    /// Returns the standard deviation about the median of the intervals that are not gaps, in s.
    pub fn jitter_s(&self) -> Option<f64> {
        let median = self.intervals.median()?;
        let (mut rows, mut squares) = (0, 0.0);
        for (interval, count) in self.intervals.iter().filter(|(i, _)| *i <= GAP * median) {
            rows += count;
            squares += count as f64 * (interval - median).powi(2);
        }
        (rows > 0).then(|| (squares / rows as f64).sqrt() * 1e-6)
    }

    pub fn gaps(&self) -> Gaps {
        let median = self.intervals.median().unwrap_or_default();
        let mut gaps = Gaps::default();
        if median > 0.0 {
            for (interval, count) in self.intervals.iter().filter(|(i, _)| *i > GAP * median) {
                gaps.count += count;
                gaps.missing_rows += count * ((interval / median).round() as u64 - 1);
            }
        }
        gaps
    }
}

const GAP: f64 = 1.5;

/// A histogram of integers in µs: one bin per value up to 2¹⁶, then 2¹⁵ bins per doubling.
#[derive(Clone, Debug, Default)]
struct IntervalHistogram {
    counts: Vec<u64>,
    total: u64,
}

impl IntervalHistogram {
    const BITS: u32 = 15;

    fn add(&mut self, value: u64) {
        let shift = (u64::BITS - value.leading_zeros()).saturating_sub(Self::BITS + 1);
        let bin = (u64::from(shift) << Self::BITS) + (value >> shift);
        // At most 2²¹ bins, which cover intervals of half a million years.
        let bin = bin as usize;
        if self.counts.len() <= bin {
            self.counts.resize(bin + 1, 0);
        }
        self.counts[bin] += 1;
        self.total += 1;
    }

    fn iter(&self) -> impl Iterator<Item = (f64, u64)> {
        let bins = self.counts.iter().enumerate().filter(|(_, count)| **count > 0);
        bins.map(|(bin, &count)| {
            let shift = (bin as u64 >> Self::BITS).saturating_sub(1);
            let least = (bin as u64 - (shift << Self::BITS)) << shift;
            (least as f64 + ((1_u64 << shift) - 1) as f64 / 2.0, count)
        })
    }

    /// Returns the lower median.
    fn median(&self) -> Option<f64> {
        let mut before = 0;
        self.iter()
            .find(|&(_, count)| {
                before += count;
                2 * before >= self.total
            })
            .map(|(value, _)| value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn timing(time_s: &[f64]) -> LogTiming {
        let mut timing = LogTiming::default();
        timing.add(time_s, 0);
        timing
    }

    fn column(values: &[f64]) -> ColumnSummary {
        let mut summary = ColumnSummary::default();
        summary.add(values);
        summary
    }

    #[test]
    fn rate_gaps_and_jitter_of_a_log_with_lost_rows() {
        // 1 kHz; two rows are missing after the third, and one interval is 20 µs longer, one shorter.
        let timing = timing(&[0.0, 0.001, 0.002, 0.005, 0.006, 0.00702, 0.008]);
        assert_eq!(timing.median_rate_hz(), Some(1000.0));
        assert_eq!(timing.gaps(), Gaps { count: 1, missing_rows: 2 });
        assert_eq!(timing.longest.unwrap().row, 3);
        // Two of five intervals are off by 20 µs: the square root of 2·20²/5, about 12.65 µs.
        assert!((timing.jitter_s().unwrap() - 160_f64.sqrt() * 1e-6).abs() < 1e-15);
    }

    #[test]
    fn time_that_runs_backwards_is_counted_and_makes_no_interval() {
        let backward = timing(&[5.0, 6.0, 2.0, 3.0, 3.0]);
        assert_eq!((backward.backward_steps, backward.first_backward_row), (1, Some(2)));
        assert_eq!(backward.equal_times, 1);
        assert_eq!(backward.median_interval_s(), Some(1.0), "no longer than the longest");
        let longer = timing(&[5.0, 6.0, 7.0, 9.0]);
        assert_eq!(longer.median_interval_s(), Some(1.0 + 7.5e-6), "the middle of a bin of 16 µs");
    }

    #[test]
    fn bins_hold_the_values_that_they_say_and_are_narrow() {
        for value in [0, 1, 65_535, 65_536, 65_537, 1_000_000, 86_400_000_000, u64::MAX >> 20] {
            let mut histogram = IntervalHistogram::default();
            histogram.add(value);
            let median = histogram.median().unwrap();
            let value = value as f64;
            assert!((median - value).abs() <= value / 65_536.0, "{value} {median}");
            assert!(value >= 65_536.0 || median == value);
        }
    }

    #[test]
    fn a_column_in_parts_is_as_the_column_as_a_whole() {
        let values: Vec<f64> = (0..1000).map(|i| f64::from(i * 7919 % 1000) + 1e6).collect();
        let mut parts = ColumnSummary::default();
        for part in values.chunks(7) {
            parts.add(part);
        }
        // The exact statistics of 0 … 999: mean 499.5, variance n(n + 1)/12.
        let sd = (1000.0 * 1001.0 / 12.0_f64).sqrt();
        assert!((parts.mean() - 1_000_499.5).abs() < 1e-9);
        // Rounding: a thousand additions to a sum with a relative error of 1e-16.
        assert!((parts.sd() - sd).abs() < 1e-12 * sd);
        assert_eq!((parts.min, parts.max), (1e6, 1e6 + 999.0));
    }

    #[test]
    fn a_column_that_is_cut_off_is_told_from_one_that_turns_around() {
        let wave = (0..1000).map(|i| (2000.0 + 500.0 * (f64::from(i) * 0.1).sin()).round());
        assert!(!column(&wave.clone().collect::<Vec<_>>()).is_pinned_at_max());
        let cut = column(&wave.map(|v| v.min(2300.0)).collect::<Vec<_>>());
        assert!(cut.is_pinned_at_max());
        assert_eq!(cut.max, 2300.0);
    }

    #[test]
    fn the_highest_of_several_poses_is_no_limit() {
        // Five poses of 200 rows; in the highest pose, one row in ten is one count lower.
        let reading = |i: u32| match i / 200 {
            1 => {
                if i.is_multiple_of(10) {
                    899.0
                } else {
                    900.0
                }
            }
            pose => 700.0 + 40.0 * f64::from(pose) + f64::from(i % 7),
        };
        let poses = column(&(0..1000).map(reading).collect::<Vec<_>>());
        assert_eq!((poses.max, poses.rows_at_max, poses.rows_below_max), (900.0, 180, 20));
        assert!(!poses.is_pinned_at_max());
    }

    #[test]
    fn only_counts_can_be_at_an_end_of_the_converter() {
        assert_eq!(column(&[0.02, 0.0, -0.01, 0.0]).saturated_rows(), 0, "volts");
        assert_eq!(column(&[0.02, 0.0, 1.0, 0.5]).saturated_rows(), 0, "fractions");
        assert_eq!(column(&[20.0, 0.0, 1.0, 5.0]).saturated_rows(), 1, "counts");
        assert_eq!(column(&[20.25, 4095.0, 1.0625]).saturated_rows(), 1, "means of counts");
    }

    #[test]
    fn a_quiet_column_is_not_pinned() {
        let quiet = column(&(0..1000).map(|i| 8.0 + f64::from(i % 5).min(1.0)).collect::<Vec<_>>());
        assert!(!quiet.is_pinned_at_max());
        assert_eq!(quiet.quiet_values(), Some(2));
        assert_eq!(column(&(0..10).map(f64::from).collect::<Vec<_>>()).quiet_values(), None);
        assert_eq!(column(&[3.0, 3.0]).quiet_values(), None);
    }

    #[test]
    fn saturated_and_constant_columns_are_found() {
        let saturated = column(&[0.0, 5.0, 4095.0, 4095.0, 65535.0]);
        assert_eq!(saturated.saturated_rows(), 2, "4095 is no end of 16 bits");
        assert_eq!(saturated.rows_at_ends(), [(0.0, 1), (65_535.0, 1)]);
        let signed = column(&[-32_768.0, 5.0, -7.0, 32_767.0, 32_767.0]);
        assert_eq!(signed.rows_at_ends(), [(-32_768.0, 1), (32_767.0, 2)]);
        assert_eq!(
            column(&[-5.0, 0.0, -3.0, 4.0]).saturated_rows(),
            0,
            "signed readings are alive"
        );
        assert!(column(&[3.0, 3.0]).is_constant());
        assert!(!column(&[3.0]).is_constant());
        assert_eq!(column(&[3.0]).sd(), 0.0);
    }
}
