//! Jumps of the readings within a pose: rows of another pose under the same label.

use shell_data::block::Block;
use shell_data::statistics::RunningVariance;

/// Largest variation of a constant load, as a share of its range over the log.
const CONSTANT_LOAD: f64 = 0.01;

/// Minimum jump, as a share of the channel's range over the log and as a multiple of its noise.
/// Creep under a constant load is smaller and gradual.
const JUMP: f64 = 0.05;
const NOISE: f64 = 10.0;

/// Least number of rows on either side of a jump; with fewer, the change is a spike.
const LEAST_ROWS: usize = 5;

/// Number of rows above which a log is skipped, because it does not consist of poses.
const MOST_ROWS: usize = 1_000_000;

#[derive(Debug, Default)]
pub(crate) struct LabelledRows {
    runs: Vec<(String, Block)>,
    rows: usize,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct PoseJump {
    pub(crate) pose: String,
    pub(crate) rows_before: usize,
    /// Channel with the largest jump relative to its range, from 0.
    pub(crate) channel: usize,
    /// Mean before and after the jump.
    pub(crate) means: [f64; 2],
}

impl LabelledRows {
    pub(crate) fn add(&mut self, block: &Block) {
        self.rows += block.rows;
        if self.rows > MOST_ROWS {
            self.runs.clear();
            return;
        }
        let mut start = 0;
        for (label, rows) in &block.groups {
            let range = start..start + rows;
            start = range.end;
            if self.runs.last().is_none_or(|(last, _)| last != label) {
                self.runs.push((label.clone(), Block::default()));
            }
            if let Some((_, rows)) = self.runs.last_mut() {
                rows.append(block, range);
            }
        }
    }

    /// Returns at most one jump for each run of a label.
    pub(crate) fn jumps(&self) -> Vec<PoseJump> {
        let loads = ranges(self.runs.iter().map(|(_, rows)| &rows.wrench));
        let readings = ranges(self.runs.iter().map(|(_, rows)| &rows.readings));
        let is_held = |wrench: &Vec<Vec<f64>>| {
            let within = ranges(std::iter::once(wrench));
            let is_constant = |(within, all): (&f64, &f64)| *within <= CONSTANT_LOAD * all;
            !wrench.is_empty() && std::iter::zip(&within, &loads).all(is_constant)
        };
        let held = self.runs.iter().filter(|(_, rows)| is_held(&rows.wrench));
        held.filter_map(|(label, rows)| jump(label, &rows.readings, &readings)).collect()
    }
}

fn ranges<'a>(runs: impl Iterator<Item = &'a Vec<Vec<f64>>>) -> Vec<f64> {
    let mut ranges: Vec<[f64; 2]> = Vec::new();
    for columns in runs {
        ranges.resize(columns.len(), [f64::INFINITY, f64::NEG_INFINITY]);
        for ([low, high], column) in ranges.iter_mut().zip(columns) {
            *low = column.iter().copied().fold(*low, f64::min);
            *high = column.iter().copied().fold(*high, f64::max);
        }
    }
    ranges.iter().map(|[low, high]| high - low).collect()
}

/// Returns the split into two means that explains the most variance, if they are far apart and the
/// change is sudden.
fn jump(pose: &str, columns: &[Vec<f64>], ranges: &[f64]) -> Option<PoseJump> {
    let mut best: Option<(f64, PoseJump)> = None;
    for (channel, (column, &range)) in columns.iter().zip(ranges).enumerate() {
        let Some((at, means)) = split(column) else { continue };
        let size = (means[1] - means[0]).abs();
        let mean = |values: &[f64]| RunningVariance::new(values).mean;
        let sudden =
            (mean(&column[at..at + LEAST_ROWS]) - mean(&column[at - LEAST_ROWS..at])).abs();
        let is_jump = size > JUMP * range && size > NOISE * noise(column) && sudden > size / 2.0;
        if is_jump && best.as_ref().is_none_or(|(share, _)| size / range > *share) {
            let jump = PoseJump { pose: pose.to_owned(), rows_before: at, channel, means };
            best = Some((size / range, jump));
        }
    }
    best.map(|(_, jump)| jump)
}

/// Returns the split whose two means explain the most variance, with these means.
fn split(column: &[f64]) -> Option<(usize, [f64; 2])> {
    let rows = column.len();
    // Subtract the mean first, so that rounding loses nothing.
    let mean = RunningVariance::new(column).mean;
    let (mut sum, mut best) = (0.0, None);
    for (at, value) in column.iter().enumerate() {
        if (LEAST_ROWS..=rows.saturating_sub(LEAST_ROWS)).contains(&at) {
            let explained = sum * sum * (1.0 / at as f64 + 1.0 / (rows - at) as f64);
            if best.is_none_or(|(most, _, _)| explained > most) {
                best = Some((explained, at, sum));
            }
        }
        sum += value - mean;
    }
    let (_, at, sum) = best?;
    Some((at, [mean + sum / at as f64, mean - sum / (rows - at) as f64]))
}

/// Standard deviation from differences of neighbouring rows, without the largest one, which may be a jump.
fn noise(column: &[f64]) -> f64 {
    let squares = column.windows(2).map(|pair| (pair[1] - pair[0]).powi(2));
    let (sum, largest) =
        squares.fold((0.0, 0.0_f64), |(sum, largest), square| (sum + square, largest.max(square)));
    ((sum - largest).max(0.0) / (2 * (column.len() - 1)) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Poses of 100 rows: two channels with own means and noise of one count, loads 0, 1, 2, ….
    fn poses(change: impl Fn(usize, usize, usize) -> f64) -> Vec<PoseJump> {
        let mut rows = LabelledRows::default();
        for pose in 0..6 {
            let column = |channel: usize| {
                let value = |row: usize| {
                    let level = (500 + 40 * ((pose * (channel + 2)) % 5)) as f64;
                    level + (row * 7 % 3) as f64 - 1.0 + change(pose, channel, row)
                };
                (0..100).map(value).collect::<Vec<f64>>()
            };
            let block = Block {
                rows: 100,
                readings: vec![column(0), column(1)],
                wrench: vec![vec![pose as f64; 100]],
                groups: vec![(pose.to_string(), 100)],
                ..Block::default()
            };
            rows.add(&block);
        }
        rows.jumps()
    }

    #[test]
    fn rows_of_another_pose_are_found_where_they_end() {
        let found = poses(|pose, channel, row| match (pose, channel, row) {
            (3, 1, ..20) => 60.0,
            _ => 0.0,
        });
        assert_eq!(found.len(), 1);
        let PoseJump { pose, rows_before, channel, means: [before, after] } = &found[0];
        assert_eq!((pose.as_str(), *rows_before, *channel), ("3", 20, 1));
        // Twenty rows with noise of ±1.
        assert!((before - after - 60.0).abs() < 1.0);
    }

    #[test]
    fn creep_noise_and_poses_that_differ_are_no_jumps() {
        assert_eq!(poses(|_, _, _| 0.0), []);
        assert_eq!(poses(|_, _, row| 30.0 * row as f64 / 100.0), [], "creep");
        assert_eq!(poses(|_, _, row| if row == 50 { 90.0 } else { 0.0 }), [], "a spike");
    }
}
