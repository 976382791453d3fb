//! Rows for the search: some rows of the data set, in order, each with its history.
//!
//! A reading `s` and its memory terms `s − EMA_τ(s)` can combine to a filter. If loads move slowly, a filter
//! that averages noise lowers the errors although the sensor has no memory, and its delay looks like a lag.
//! Interpolation between rows also averages noise of the loads. The part of noise is therefore computed
//! separately. With the gradient `g` of a wrench with respect to a reading, the coefficients `d_k` of its
//! memory terms, and white noise of variance σ², it is
//!
//! ```text
//! σ²·(g² + 2·g·Σ d_k + Σ d_k·d_l·(1 + α_k·α_l/(1 − (1−α_k)·(1−α_l)))),   α = 1 − exp(−period/τ)
//! ```

use std::ops::Range;

use faer::Mat;

use super::prepared::{BetweenRows, RowClock, segments};
use crate::memory::TimeBase;
use least_squares::features::Features;
use least_squares::model::{Basis, Model};
use least_squares::scaling::Scaling;
use shell_data::block::Block;
use shell_data::dataset::{Dataset, LogRows};
use shell_data::statistics::upper_median;
use shell_data::wrench::{Axis, PerAxis};

const MOST_ROWS: usize = 200_000;

const MOST_USED: usize = 8_000;

const ROWS_PER_FEATURE: usize = 10;

/// Largest number of folds, and approximate number of parts into which a few logs are divided.
const FOLDS: usize = 10;

const ENOUGH_LOGS: usize = 4;

const MOST_FEATURES: usize = 150;

struct LogPart<'a> {
    /// Blocks with the readings; the last block may have more rows than the part.
    blocks: Vec<&'a Block>,
    times: Vec<f64>,
    segments: Vec<Range<usize>>,
    wrench: PerAxis<Vec<f64>>,
    used: Vec<usize>,
    /// Ends of runs of rows with the same label, counted in used rows; empty for rows without labels.
    group_ends: Vec<usize>,
}

pub(super) struct SearchRows<'a> {
    logs: Vec<LogPart<'a>>,
    pub(super) clock: RowClock,
    pub(super) channels: usize,
    pub(super) folds: Vec<Range<usize>>,
    /// Features of the used rows; the last is constant if there is an intercept.
    pub(super) features: Mat<f64>,
    pub(super) noise: ReadingNoise,
    /// Variance of white noise on the loads, N² and (N·m)².
    load_noise: PerAxis<f64>,
    pub(super) has_intercept: bool,
}

impl<'a> LogPart<'a> {
    fn new(log: &'a LogRows, clock: &RowClock, most: usize, every: usize) -> Self {
        let (mut blocks, mut times, mut rows) = (Vec::new(), Vec::new(), 0);
        let mut wrench = PerAxis::<Vec<f64>>::default();
        for block in log.blocks.iter().map(|block| &*block.rows) {
            let some = block.rows.min(most - rows);
            if some == 0 {
                continue;
            }
            blocks.push(block);
            times.extend(block.time_s.iter().take(some));
            for (column, more) in wrench.iter_mut().zip(&block.wrench) {
                column.extend_from_slice(&more[..some]);
            }
            rows += some;
        }
        if clock.time_base == TimeBase::Rows {
            times = (0..rows).map(|row| row as f64).collect();
        }
        let segments = segments(&times, clock.gap());
        let used = (0..rows).step_by(every).collect();
        let group_ends = if log.has_groups { group_ends(log, rows, every) } else { Vec::new() };
        Self { blocks, times, segments, wrench, used, group_ends }
    }

    /// End of a group that is nearest to a used row; the row itself without groups.
    fn cut_near(&self, row: usize) -> usize {
        let nearest = self.group_ends.iter().min_by_key(|end| end.abs_diff(row));
        nearest.copied().unwrap_or(row)
    }

    fn readings(&self, channel: usize) -> impl Iterator<Item = f64> {
        let readings = self.blocks.iter().flat_map(move |block| &block.channels()[channel]);
        readings.take(self.times.len()).copied()
    }
}

impl<'a> SearchRows<'a> {
    /// Returns `None` for too few rows or folds, or a value that is not finite.
    pub(super) fn new(data: &'a Dataset, clock: &RowClock, intercept: bool) -> Option<Self> {
        let channels = data.channels();
        let rows = usize::try_from(data.rows()).ok()?;
        let looked_at = rows.min(MOST_ROWS);
        let every = looked_at.div_ceil(MOST_USED).max(1);
        let most = |log: &LogRows| (log.rows() as usize * looked_at).div_ceil(rows.max(1));
        let logs: Vec<LogPart> =
            data.logs.iter().map(|log| LogPart::new(log, clock, most(log), every)).collect();
        let used: usize = logs.iter().map(|log| log.used.len()).sum();
        let model = [Basis::CubicProducts, Basis::Cubic, Basis::Linear]
            .map(|basis| Model { basis, intercept, channels, memory: 0 })
            .into_iter()
            .find(|model| {
                let features = model.term_count();
                features <= MOST_FEATURES && features * ROWS_PER_FEATURE <= used
            })?;
        let pick = |channel: usize| -> Vec<f64> {
            logs.iter().flat_map(|log| log.readings(channel).step_by(every)).collect()
        };
        let readings: Vec<Vec<f64>> = (0..channels).map(pick).collect();
        let of_model = Features::new(model, Scaling::from_sample(&readings, intercept));
        let mut columns = vec![0.0; used * of_model.len()];
        of_model.fill(&readings, 0..used, &mut columns, used);
        let features = Mat::from_fn(used, of_model.len(), |i, j| columns[j * used + i]);
        let variances: Vec<f64> = (0..channels)
            .map(|channel| {
                let column = |log: &LogPart<'_>| log.readings(channel).collect::<Vec<_>>();
                variance(logs.iter().map(|log| (&log.times[..], column(log))), clock.period)
            })
            .collect();
        let load_noise = std::array::from_fn(|axis| {
            variance(logs.iter().map(|log| (&log.times[..], &log.wrench[axis])), clock.period)
        });
        let noise = ReadingNoise::new(&of_model, &readings, &variances, clock.period);
        let folds = folds(&logs);
        let is_finite = features.is_all_finite()
            && logs.iter().flat_map(|log| &log.wrench).flatten().all(|load| load.is_finite());
        (folds.len() > 2 && is_finite).then(|| Self {
            logs,
            clock: *clock,
            channels,
            folds,
            features,
            noise,
            load_noise,
            has_intercept: intercept,
        })
    }

    pub(super) fn are_labelled(&self) -> bool {
        self.logs.iter().all(|log| !log.group_ends.is_empty())
    }

    pub(super) fn rows(&self) -> usize {
        self.features.nrows()
    }

    pub(super) fn longest(&self) -> f64 {
        let spans = self.logs.iter().flat_map(|log| {
            log.segments.iter().map(|rows| log.times[rows.end - 1] - log.times[rows.start])
        });
        spans.fold(0.0, f64::max)
    }

    /// Loads of the used rows (rows × 6), at times that are later by `by`.
    pub(super) fn loads(&self, by: f64) -> Mat<f64> {
        let mut loads = Mat::zeros(self.rows(), Axis::ALL.len());
        let mut start = 0;
        for log in &self.logs {
            let used = log.used.iter().copied();
            let then = BetweenRows::later(&log.times, &log.segments, by, used);
            for (axis, column) in log.wrench.iter().enumerate() {
                for (row, then) in then.iter().enumerate() {
                    loads[(start + row, axis)] = then.value(column);
                }
            }
            start += then.len();
        }
        loads
    }

    /// Variance of the noise of [these loads](Self::loads): interpolation averages the noise of two rows.
    pub(super) fn noise_of_loads(&self, by: f64) -> PerAxis<f64> {
        let share = (by / self.clock.period).rem_euclid(1.0);
        self.load_noise.map(|variance| variance * (share * share + (1.0 - share) * (1.0 - share)))
    }

    /// Memory terms of a time constant (rows × channels).
    pub(super) fn memory_terms(&self, time_constant: f64) -> Mat<f64> {
        let memory = self.clock.memory(&[time_constant]).expect("a positive time constant");
        let (mut columns, mut start) = (Mat::zeros(self.rows(), self.channels), 0);
        for log in &self.logs {
            let (mut state, mut first) = (memory.start(), 0);
            let mut used = log.used.iter().copied().zip(start..).peekable();
            for block in &log.blocks {
                let terms = state.terms(&block.time_s, block.channels());
                let terms = terms.expect("a time for every row");
                while let Some((row, to)) = used.next_if(|(row, _)| *row < first + block.rows) {
                    for (channel, terms) in terms.iter().enumerate() {
                        columns[(to, channel)] = terms[row - first];
                    }
                }
                first += block.rows;
            }
            start += log.used.len();
        }
        columns
    }
}

/// Ends of runs of rows with the same label in the first `rows` of a log, counted in used rows.
fn group_ends(log: &LogRows, rows: usize, every: usize) -> Vec<usize> {
    let runs = log.blocks.iter().flat_map(|block| &*block.labels);
    let mut ends: Vec<(&str, usize)> = Vec::new();
    for (label, run) in runs {
        let end = ends.last().map_or(0, |(_, end)| *end) + run;
        match ends.last_mut().filter(|(last, _)| last == label) {
            Some((_, last)) => *last = end,
            None => ends.push((label, end)),
        }
    }
    ends.iter().map(|(_, end)| (*end.min(&rows)).div_ceil(every)).collect()
}

/// Divides the used rows into folds. A few logs are cut into parts of about equal length and of whole groups;
/// many logs or parts are combined with their neighbours.
fn folds(logs: &[LogPart<'_>]) -> Vec<Range<usize>> {
    let parts = match logs.len() {
        ENOUGH_LOGS.. => 1,
        few => FOLDS.div_ceil(few.max(1)),
    };
    let (mut ends, mut start) = (vec![0], 0);
    for log in logs {
        let rows = log.used.len();
        let cut = |part: usize| if part < parts { log.cut_near(rows * part / parts) } else { rows };
        ends.extend((1..=parts).map(|part| start + cut(part)));
        start += rows;
    }
    ends.dedup();
    let count = ends.len() - 1;
    let folds = count.min(FOLDS);
    let end = |fold: usize| ends[fold * count / folds];
    (0..folds).map(|fold| end(fold)..end(fold + 1)).collect()
}

const GRADIENT_ROWS: usize = 400;

/// `Σ c²` of the fourth difference, `c` = 1, −4, 6, −4, 1, which removes all that is smooth over
/// five rows.
const DIFFERENCE_GAIN: f64 = 70.0;

const JUMP: f64 = 8.0;

/// A row that comes more than this many periods after the previous one follows a missing row.
const MISSING_PERIODS: f64 = 1.5;

pub(super) struct ReadingNoise {
    period: f64,
    channels: Vec<ChannelNoise>,
}

struct ChannelNoise {
    variance: f64,
    features: Vec<usize>,
    products: Mat<f64>,
    means: Vec<f64>,
}

impl ReadingNoise {
    pub(super) fn new(
        features: &Features,
        readings: &[Vec<f64>],
        variances: &[f64],
        period: f64,
    ) -> Self {
        let rows = readings.first().map_or(0, Vec::len);
        let every = rows.div_ceil(GRADIENT_ROWS).max(1);
        let mut some: Vec<Vec<f64>> =
            readings.iter().map(|column| column.iter().step_by(every).copied().collect()).collect();
        let count = some.first().map_or(0, Vec::len);
        let channels = (variances.iter().enumerate()).map(|(channel, &variance)| {
            let step = variance.sqrt().max(f64::MIN_POSITIVE);
            let middle = some[channel].clone();
            let mut at = |by: f64| {
                some[channel] = middle.iter().map(|reading| reading + by).collect();
                let mut columns = vec![0.0; count * features.len()];
                features.fill(&some, 0..count, &mut columns, count);
                columns
            };
            let (above, below) = (at(step), at(-step));
            some[channel] = middle;
            let slope =
                |i: usize, j: usize| (above[j * count + i] - below[j * count + i]) / (2.0 * step);
            let has_gradient = |j: &usize| (0..count).any(|i| slope(i, *j) != 0.0);
            let own: Vec<usize> = match variance > 0.0 {
                true => (0..features.len()).filter(has_gradient).collect(),
                false => Vec::new(),
            };
            let gradients = Mat::from_fn(count, own.len(), |i, j| slope(i, own[j]));
            let share = 1.0 / count.max(1) as f64;
            ChannelNoise {
                variance,
                products: gradients.transpose() * &gradients * faer::Scale(share),
                means: gradients.col_iter().map(|column| share * column.sum()).collect(),
                features: own,
            }
        });
        Self { period, channels: channels.collect() }
    }

    /// Variance that this noise causes on each axis, N² and (N·m)², from the coefficients of features and memory
    /// terms. The rows of `terms` are the channels, for each time constant in turn.
    pub(super) fn of_wrench(
        &self,
        features: &Mat<f64>,
        terms: &Mat<f64>,
        time_constants: &[f64],
    ) -> PerAxis<f64> {
        let shares: Vec<f64> =
            time_constants.iter().map(|tau| -(-self.period / tau).exp_m1()).collect();
        let both = |a: f64, b: f64| 1.0 + a * b / (1.0 - (1.0 - a) * (1.0 - b));
        let mut variances = [0.0; 6];
        for (position, channel) in self.channels.iter().enumerate() {
            let own = Mat::from_fn(channel.features.len(), Axis::ALL.len(), |row, axis| {
                features[(channel.features[row], axis)]
            });
            let products = &channel.products * &own;
            for (axis, sum) in variances.iter_mut().enumerate() {
                let own = own.col(axis);
                let mean: f64 = own.iter().zip(&channel.means).map(|(c, mean)| c * mean).sum();
                let memory = |term: usize| terms[(term * self.channels.len() + position, axis)];
                let mut power = own.transpose() * products.col(axis);
                for (k, a) in shares.iter().enumerate() {
                    power += 2.0 * mean * memory(k);
                    let pairs = shares.iter().enumerate();
                    power += pairs.map(|(l, b)| memory(k) * memory(l) * both(*a, *b)).sum::<f64>();
                }
                *sum += channel.variance * power;
            }
        }
        variances
    }
}

/// Estimates the variance of white noise on the same column of several logs, each given with its times,
/// from fourth differences over rows at equal intervals. Returns 0 if there are none.
pub(super) fn variance<'a>(
    logs: impl Iterator<Item = (&'a [f64], impl AsRef<[f64]>)>,
    period: f64,
) -> f64 {
    let mut differences = Vec::new();
    for (times, column) in logs {
        for (times, s) in times.windows(5).zip(column.as_ref().windows(5)) {
            let is_even =
                |pair: &[f64]| pair[1] > pair[0] && pair[1] - pair[0] < MISSING_PERIODS * period;
            if times.windows(2).all(is_even) {
                differences.push((s[0] - 4.0 * s[1] + 6.0 * s[2] - 4.0 * s[3] + s[4]).abs());
            }
        }
    }
    let Some(median) = upper_median(&mut differences) else { return 0.0 };
    let ordinary = differences.iter().filter(|of| median == 0.0 || **of <= JUMP * median);
    let (count, squares) =
        ordinary.fold((0.0, 0.0), |(count, squares), of| (count + 1.0, squares + of * of));
    squares / count / DIFFERENCE_GAIN
}

#[cfg(test)]
mod tests {
    use super::*;
    use system_tests::random::Random;

    #[test]
    fn noise_of_a_moving_reading_is_found_past_jumps_and_missing_rows() {
        let mut random = Random(4);
        let rows = (0..8000).filter(|row| row % 7 != 3);
        let (times, column): (Vec<f64>, Vec<f64>) = rows
            .map(|row| {
                let jump = if row % 500 == 0 { 300.0 } else { 0.0 };
                let t = f64::from(row);
                (t, 400.0 * (0.02 * t).sin() + 1.5 * random.normal() + jump)
            })
            .unzip();
        let found = variance([(&times[..], &column[..])].into_iter(), 1.0);
        // The estimate uses 4600 overlapping differences.
        assert!((found / 2.25 - 1.0).abs() < 0.1, "{found}");
        assert_eq!(variance([(&times[..3], &column[..3])].into_iter(), 1.0), 0.0);
    }
}
