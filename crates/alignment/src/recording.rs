//! Prepared recordings: rows in order of time, without repeats, with saturated rows marked.

use super::error::{AlignError, LEAST_OVERLAP_S, RecordingSide};
use super::optics::ReadingReach;
use shell_data::statistics::{extremes, upper_median};

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    pub time_s: Vec<f64>,
    /// Columns: for the reference the six axes in N and N·m, for the board its readings in counts.
    pub columns: Vec<Vec<f64>>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct LeftOut {
    pub not_finite: usize,
    pub not_later: usize,
    /// Rows with the same values as the previous row: the sensor had no new value.
    pub repeated: usize,
    /// Rows at an end of the range: kept, but not matched.
    pub saturated: usize,
}

/// A logger that runs faster than its sensor repeats a row for at most this time, s.
const LONGEST_REPEAT_S: f64 = 0.02;
/// A change by this number of its smallest steps means that a column moves.
const MOVE: f64 = 3.0;
/// Lower limit of the smallest step, as a fraction of the range, for columns without a fixed resolution.
const LEAST_STEP: f64 = 1e-4;
/// This number of consecutive equal values at the extreme of a column marks the end of the range.
const SATURATED_RUN: usize = 5;
/// Largest share of rows out of order that counts as transmission errors.
const OUT_OF_ORDER: f64 = 0.01;

#[derive(Clone, Debug)]
pub(super) struct Clean {
    /// Time since `start_s`, strictly increasing.
    pub(super) time_s: Vec<f64>,
    pub(super) columns: Vec<Vec<f64>>,
    pub(super) in_range: Vec<bool>,
    pub(super) start_s: f64,
    pub(super) period_s: f64,
    pub(super) left_out: LeftOut,
}

impl Clean {
    pub(super) fn new(
        recording: Recording,
        side: RecordingSide,
        all_repeats: bool,
    ) -> Result<Self, AlignError> {
        let Recording { mut time_s, mut columns } = recording;
        let expected = time_s.len();
        if let Some(found) = match columns.is_empty() {
            true => Some(0),
            false => columns.iter().map(Vec::len).find(|&len| len != expected),
        } {
            return Err(AlignError::Shape { side, expected, found });
        }
        let (keep, mut left_out) = rows_to_keep(&time_s, &columns, all_repeats);
        if left_out.not_later as f64 > OUT_OF_ORDER * expected as f64 {
            return Err(AlignError::TimeGoesBack { side, rows: left_out.not_later, of: expected });
        }
        for column in columns.iter_mut().chain([&mut time_s]) {
            let mut flags = keep.iter();
            column.retain(|_| *flags.next().expect("a flag per row"));
        }
        let rows = time_s.len();
        let span_s = time_s.last().zip(time_s.first()).map_or(0.0, |(last, first)| last - first);
        // Written so that a NaN span is refused.
        if rows < 100 || span_s.is_nan() || span_s < LEAST_OVERLAP_S {
            return Err(AlignError::TooShort { side, rows, span_s });
        }
        if columns.iter().all(|column| column.iter().all(|&x| x == column[0])) {
            return Err(AlignError::Constant(side));
        }
        let start_s = time_s[0];
        time_s.iter_mut().for_each(|t| *t -= start_s);
        let mut steps: Vec<f64> = time_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let period_s = upper_median(&mut steps).expect("a recording has two rows at least");
        let in_range = in_range(&columns);
        left_out.saturated = in_range.iter().filter(|&&inside| !inside).count();
        Ok(Self { time_s, columns, in_range, start_s, period_s, left_out })
    }

    pub(super) fn span_s(&self) -> f64 {
        self.time_s.last().copied().unwrap_or(0.0)
    }
}

/// The board's rows to match, averaged to the rate of the matched band.
#[derive(Debug)]
pub(super) struct BoardFrames {
    pub(super) time_s: Vec<f64>,
    readings: Vec<f64>,
    pub(super) channels: usize,
    pub(super) ranges: Vec<ReadingReach>,
}

impl BoardFrames {
    pub(super) fn new(board: &Clean, rate_hz: f64) -> Self {
        let moving: Vec<&Vec<f64>> =
            board.columns.iter().filter(|c| c.iter().any(|&x| x != c[0])).collect();
        let mut frames =
            Self { time_s: vec![], readings: vec![], channels: moving.len(), ranges: vec![] };
        // Rows at about the rate of the band are not averaged, because rounding would pair some of them.
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

/// Selects finite rows in order of time with new values.
///
/// A constant load leaves equal rows, and so does a logger that runs faster than its sensor, but
/// with a jump before and after. Only the latter are dropped, unless all repeats are known to be
/// the logger's: dropping rows of a constant load would remove one side of each tap.
fn rows_to_keep(time_s: &[f64], columns: &[Vec<f64>], all_repeats: bool) -> (Vec<bool>, LeftOut) {
    let mut left_out = LeftOut::default();
    let mut keep = vec![true; time_s.len()];
    let mut latest = f64::NEG_INFINITY;
    for (row, keep) in keep.iter_mut().enumerate() {
        let finite = time_s[row].is_finite() && columns.iter().all(|c| c[row].is_finite());
        let later = time_s[row] > latest;
        *keep = finite && later;
        left_out.not_finite += usize::from(!finite);
        left_out.not_later += usize::from(finite && !later);
        if *keep {
            latest = time_s[row];
        }
    }
    let steps: Vec<f64> = columns.iter().map(|column| smallest_step(column)).collect();
    let moves = |a: usize, b: usize| {
        let change =
            |(column, step): (&Vec<f64>, &f64)| (column[a] - column[b]).abs() >= MOVE * step;
        columns.iter().zip(&steps).any(change)
    };
    let rows: Vec<usize> = (0..time_s.len()).filter(|&row| keep[row]).collect();
    let equal = |&a: &usize, &b: &usize| columns.iter().all(|c| c[a] == c[b]);
    let runs: Vec<&[usize]> = rows.chunk_by(equal).collect();
    for (i, run) in runs.iter().enumerate().filter(|(_, run)| run.len() > 1) {
        let jumps = |next: Option<&&[usize]>| next.is_none_or(|next| moves(run[0], next[0]));
        let held_s = time_s[run[run.len() - 1]] - time_s[run[0]];
        let is_short = held_s <= LONGEST_REPEAT_S;
        if all_repeats
            || (is_short && jumps(i.checked_sub(1).map(|i| &runs[i])) && jumps(runs.get(i + 1)))
        {
            run[1..].iter().for_each(|&row| keep[row] = false);
            left_out.repeated += run.len() - 1;
        }
    }
    (keep, left_out)
}

/// Selects rows in which no column stays at its own extreme. A load that truly stays there has no
/// slope, and no information about time.
fn in_range(columns: &[Vec<f64>]) -> Vec<bool> {
    let mut inside = vec![true; columns.first().map_or(0, Vec::len)];
    for column in columns {
        let (low, high) = extremes(column.iter().copied());
        if low == high {
            continue;
        }
        let least = MOVE * smallest_step(column).max(LEAST_STEP * (high - low));
        let mut row = 0_usize;
        for run in column.chunk_by(|a, b| a == b) {
            let moves = |other: Option<&f64>| other.is_none_or(|x| (x - run[0]).abs() >= least);
            let is_extreme = run[0] == low || run[0] == high;
            if run.len() >= SATURATED_RUN
                && is_extreme
                && moves(row.checked_sub(1).map(|before| &column[before]))
                && moves(column.get(row + run.len()))
            {
                inside[row..row + run.len()].fill(false);
            }
            row += run.len();
        }
    }
    inside
}

fn smallest_step(column: &[f64]) -> f64 {
    let steps = column.windows(2).map(|pair| (pair[1] - pair[0]).abs()).filter(|&step| step > 0.0);
    steps.fold(f64::INFINITY, f64::min)
}
