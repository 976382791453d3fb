//! Clock of the low-pass: the period of its grid, and the slot of each row.

use super::RowRule;

/// Number of rows at the start of a log that determine the period of the grid.
pub(crate) const CLOCK_ROWS: usize = 50;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clock {
    pub first_s: f64,
    /// Slots per second: one over the usual period between rows, Hz.
    pub rate_hz: f64,
}

impl Clock {
    pub fn slot(&self, time_s: f64) -> u64 {
        (((time_s - self.first_s) * self.rate_hz).round() as u64).min(LAST_SLOT)
    }

    pub fn time_s(&self, slot: u64) -> f64 {
        self.first_s + slot as f64 / self.rate_hz
    }
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct ClockSearch {
    first_s: Option<f64>,
    last_s: f64,
    rows: usize,
    periods_s: Vec<f64>,
}

impl ClockSearch {
    /// Takes the times of the next rows, s. After `CLOCK_ROWS` rows, ignores further rows once a period is known.
    pub fn look_at(&mut self, times_s: &[f64]) {
        for &time in times_s {
            if self.is_done() {
                return;
            }
            match self.first_s {
                None => self.first_s = Some(time),
                Some(_) if time > self.last_s => self.periods_s.push(time - self.last_s),
                Some(_) => {}
            }
            self.last_s = time;
            self.rows += 1;
        }
    }

    pub fn is_done(&self) -> bool {
        self.rows >= CLOCK_ROWS && !self.periods_s.is_empty()
    }

    /// Returns the clock. `None` without rows, and also if time never advances and `rate_hz` is not given.
    pub fn finish(&self, rate_hz: Option<f64>) -> Option<Clock> {
        let first_s = self.first_s?;
        let own = || {
            let mut periods = self.periods_s.clone();
            periods.sort_unstable_by(f64::total_cmp);
            // The lower median is a period that actually occurs.
            let middle = periods.len().checked_sub(1)? / 2;
            Some(1.0 / periods[middle])
        };
        Some(Clock { first_s, rate_hz: rate_hz.or_else(own)? })
    }
}

/// The largest slot: later ones are clamped, as no valid time is that late.
const LAST_SLOT: u64 = 1 << 60;

#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    clock: Clock,
    rule: RowRule,
    next_row: u64,
    last_slot: u64,
}

impl Grid {
    /// Creates a grid without rows. With [`RowRule::Rows`], the next row must be the first of the log.
    pub fn new(clock: Clock, rule: RowRule) -> Self {
        Self { clock, rule, next_row: 0, last_slot: 0 }
    }

    /// Assigns slots to the next rows. A late row, with an earlier time than a previous one, gets the highest slot so
    /// far.
    pub fn slots(&mut self, times_s: &[f64]) -> Vec<u64> {
        let slot = |&time: &f64| {
            let slot = match self.rule {
                RowRule::Time => self.clock.slot(time),
                RowRule::Rows => self.next_row,
            };
            self.next_row += 1;
            self.last_slot = self.last_slot.max(slot);
            self.last_slot
        };
        times_s.iter().map(slot).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_follows_the_usual_period_for_any_pieces() {
        // Every tenth row is missing.
        let times: Vec<f64> =
            (0..200).filter(|i| i % 10 != 3).map(|i| 2.0 + f64::from(i) / 500.0).collect();
        for piece in [1, 7, 50, 200] {
            let mut search = ClockSearch::default();
            times.chunks(piece).for_each(|times| search.look_at(times));
            let clock = search.finish(None).unwrap();
            assert_eq!(clock.first_s, 2.0);
            // Times near 2 s have rounding errors of 4e-16 s; the period is 2e-3 s.
            assert!((clock.rate_hz - 500.0).abs() < 1e-6, "{clock:?}");
            assert_eq!(search.finish(Some(100.0)).unwrap().rate_hz, 100.0);
        }
    }

    #[test]
    fn a_clock_that_stands_still_has_no_rate() {
        let mut search = ClockSearch::default();
        search.look_at(&[1.0; 100]);
        assert!(!search.is_done());
        assert_eq!(search.finish(None), None);
        search.look_at(&[1.5]);
        assert!(search.is_done());
        assert_eq!(search.finish(None).unwrap().rate_hz, 2.0);
    }

    #[test]
    fn rows_stand_in_the_slot_nearest_to_their_time() {
        let clock = Clock { first_s: 1.0, rate_hz: 1000.0 };
        let mut grid = Grid::new(clock, RowRule::Time);
        assert_eq!(grid.slots(&[1.0, 1.001, 1.0039]), [0, 1, 4]);
        // The third row arrives late.
        assert_eq!(grid.slots(&[1.005, 1.0051, 1.003, 1.009]), [5, 5, 5, 9]);
        let mut rows = Grid::new(clock, RowRule::Rows);
        assert_eq!(rows.slots(&[1.0, 5.0, 5.0]), [0, 1, 2]);
    }

    #[test]
    fn a_clock_that_drifts_by_less_than_half_a_period_a_row_keeps_the_grid_in_step() {
        let times: Vec<f64> = (0..10_000).map(|i| f64::from(i) * 1.001e-3).collect();
        let clock = Clock { first_s: 0.0, rate_hz: 1000.0 };
        // The last row is 10.009 s after the first.
        assert_eq!(Grid::new(clock, RowRule::Time).slots(&times)[9999], 10_009);
    }
}
