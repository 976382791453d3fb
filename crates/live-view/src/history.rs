//! The last minute of a signal, and its extremes per screen column.

use std::collections::VecDeque;

use shared_proto::CHANNELS;
use shell_data::wrench::PerAxis;

pub(crate) const LONGEST_S: f64 = 60.0;

/// A minute at 1 kHz, the highest rate of a board.
const MOST_ROWS: usize = 65_536;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LiveRow {
    /// On the clock of the board or log.
    pub time_s: f64,
    pub index: i64,
    /// Steps of the converter.
    pub readings: Option<[f64; CHANNELS]>,
    pub wrench: Option<PerAxis<f64>>,
    /// Bit i is set if channel i was at an end of the converter's range.
    pub saturated: u8,
    /// Bit i is set if channel i was outside the calibrated range.
    pub out_of_range: u8,
}

#[derive(Clone, Debug, Default)]
pub struct History {
    rows: VecDeque<LiveRow>,
}

impl History {
    /// Adds a row. A row far before the newest clears the history: the clock or the log has started again.
    pub fn push(&mut self, row: LiveRow) {
        if self.rows.back().is_some_and(|newest| row.time_s < newest.time_s - LONGEST_S) {
            self.rows.clear();
        }
        let after = self.rows.iter().rev().take_while(|other| other.time_s > row.time_s).count();
        match after {
            0 => self.rows.push_back(row),
            _ => self.rows.insert(self.rows.len() - after, row),
        }
        let newest = self.newest().map_or(0.0, |row| row.time_s);
        while self.rows.len() > MOST_ROWS
            || self.rows.front().is_some_and(|oldest| oldest.time_s < newest - LONGEST_S)
        {
            self.rows.pop_front();
        }
    }

    pub fn newest(&self) -> Option<&LiveRow> {
        self.rows.back()
    }

    pub fn last(&self, span_s: f64) -> impl Iterator<Item = &LiveRow> + Clone {
        let from = self.newest().map_or(0.0, |row| row.time_s - span_s);
        let first = self.rows.partition_point(|row| row.time_s <= from);
        self.rows.range(first..)
    }

    /// Returns minimum and maximum in each column over `span_s`, the newest on the right.
    pub fn columns(
        &self,
        span_s: f64,
        columns: usize,
        value: impl Fn(&LiveRow) -> Option<f64>,
    ) -> Vec<Option<[f64; 2]>> {
        let mut found = vec![None; columns];
        let Some(newest) = self.newest() else { return found };
        let start_s = newest.time_s - span_s;
        for row in self.last(span_s) {
            let Some(value) = value(row).filter(|value| value.is_finite()) else { continue };
            let share = (row.time_s - start_s) / span_s;
            let column = ((share * columns as f64) as usize).min(columns.saturating_sub(1));
            if let Some(extremes) = found.get_mut(column) {
                let [least, greatest] = extremes.get_or_insert([value; 2]);
                (*least, *greatest) = (least.min(value), greatest.max(value));
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(time_s: f64, value: f64) -> LiveRow {
        LiveRow { time_s, wrench: Some([value; 6]), ..LiveRow::default() }
    }

    #[test]
    fn a_column_shows_the_extremes_of_its_time_and_a_gap_shows_nothing() {
        let mut history = History::default();
        // 10 s at 100 Hz with a spike of one row, and no rows from 4 s to 6 s.
        for i in 0..=1000 {
            let time_s = f64::from(i) / 100.0;
            if !(4.0..6.0).contains(&time_s) {
                history.push(row(time_s, if i == 250 { 7.0 } else { 1.0 }));
            }
        }
        let columns = history.columns(10.0, 10, |row| row.wrench.map(|wrench| wrench[0]));
        let spike = Some([1.0, 7.0]);
        let flat = Some([1.0, 1.0]);
        let expected = [flat, flat, spike, flat, None, None, flat, flat, flat, flat];
        assert_eq!(columns, expected);
    }

    #[test]
    fn memory_does_not_grow_and_late_frames_go_where_they_belong() {
        let mut history = History::default();
        for i in 0..200_000 {
            history.push(row(f64::from(i) / 1000.0, 0.0));
        }
        assert!((60_000..=60_001).contains(&history.rows.len()), "{}", history.rows.len());
        history.push(row(199.9975, 3.0));
        let late: Vec<f64> = history.last(0.003).map(|row| row.time_s).collect();
        assert_eq!(late, [199.997, 199.9975, 199.998, 199.999]);
        history.push(row(0.0, 0.0));
        assert_eq!(history.rows.len(), 1);
    }
}
