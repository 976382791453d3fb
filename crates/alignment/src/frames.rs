//! The board's rows, as they are matched.

use super::optics::ReadingReach;
use super::recording::Clean;

/// The board's rows that are matched, at the rate of the band that is.
#[derive(Debug)]
pub(super) struct BoardFrames {
    /// Since the start of the recording.
    pub(super) time_s: Vec<f64>,
    /// Row by row.
    readings: Vec<f64>,
    pub(super) channels: usize,
    pub(super) ranges: Vec<ReadingReach>,
}

impl BoardFrames {
    /// Averages rows that come faster than `rate_hz`.
    pub(super) fn new(board: &Clean, rate_hz: f64) -> Self {
        let moving: Vec<&Vec<f64>> =
            board.columns.iter().filter(|c| c.iter().any(|&x| x != c[0])).collect();
        let mut frames =
            Self { time_s: vec![], readings: vec![], channels: moving.len(), ranges: vec![] };
        // With a little margin, so that rows at the rate itself are not paired by rounding.
        let cell_s = if rate_hz * board.period_s > 0.75 { 0.0 } else { 1.0 / rate_hz };
        let rows: Vec<usize> = (0..board.time_s.len()).filter(|&row| board.in_range[row]).collect();
        let cell = |row: usize| match cell_s > 0.0 {
            true => (board.time_s[row] / cell_s) as usize,
            false => row,
        };
        for group in rows.chunk_by(|&a, &b| cell(a) == cell(b)) {
            let mean = |column: &[f64]| {
                group.iter().map(|&row| column[row]).sum::<f64>() / group.len() as f64
            };
            frames.time_s.push(mean(&board.time_s));
            frames.readings.extend(moving.iter().map(|column| mean(column)));
        }
        let channel = |c: usize| frames.readings.iter().skip(c).step_by(frames.channels).copied();
        frames.ranges =
            (0..frames.channels).map(|c| ReadingReach::new(channel(c).collect())).collect();
        frames
    }

    pub(super) fn row(&self, i: usize) -> (f64, &[f64]) {
        (self.time_s[i], &self.readings[i * self.channels..(i + 1) * self.channels])
    }
}
