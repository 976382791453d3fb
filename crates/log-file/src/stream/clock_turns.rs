//! Counts the wraparounds of a clock before each chunk: of a 32-bit counter, or of the time of day.
//!
//! The robot's clock counts µs in 32 bits and wraps around every 71.6 min; another logger's may count ms or ns, or
//! begin again at midnight. A comparison of a chunk's first time with the first and last times of the previous chunk
//! in file order finds the wraparounds, as long as a chunk is shorter than half a turn.

use crate::parse::date::{DateOrder, parse_date};
use crate::parse::form::RowForm;
use crate::parse::number::parse_field;

/// The number of units after which a 32-bit counter wraps around.
pub(crate) const TURN: f64 = 4_294_967_296.0;

const DAY: f64 = 86_400.0;

/// Number of lines of a chunk that are searched for a time.
const LINES: usize = 8;

#[derive(Clone, Debug)]
pub(crate) struct ClockTurns {
    form: RowForm,
    separator: u8,
    column: usize,
    /// Number of units after which the clock wraps around.
    turn: f64,
    /// A wraparound is a step from at most this far below a turn to at most this far above 0.
    margin: f64,
    before: Option<f64>,
    turns: u32,
}

impl ClockTurns {
    /// Makes a counter for the robot's clock in this column, which is known to wrap around.
    pub(crate) fn new(form: RowForm, separator: u8, column: usize) -> Self {
        Self { form, separator, column, turn: TURN, margin: TURN / 2.0, before: None, turns: 0 }
    }

    /// Adapts the counter to a clock that may not wrap: only a jump from just below a turn to just above 0 counts.
    pub(crate) fn of_counter(self) -> Self {
        Self { margin: TURN / 8.0, ..self }
    }

    pub(crate) fn of_day(self) -> Self {
        Self { turn: DAY, margin: DAY / 8.0, ..self }
    }

    /// Returns the number of units after which the clock wraps around, and the event in words.
    pub(crate) fn turn(&self) -> (f64, &'static str) {
        (self.turn, if self.turn == DAY { "midnight passed" } else { "32 bits came round" })
    }

    /// Returns the turns before the first row of the next chunk.
    pub(crate) fn before(&mut self, lines: &[u8]) -> u32 {
        let time = |line: &[u8]| {
            let made = (!self.form.is_plain()).then(|| self.form.separated(line, self.separator));
            let line = made.as_deref().unwrap_or(line);
            let field = line.split(|&byte| byte == self.separator).nth(self.column)?;
            let field = field.trim_ascii();
            let field =
                field.strip_prefix(b"\"").and_then(|it| it.strip_suffix(b"\"")).unwrap_or(field);
            match self.turn == DAY {
                true => parse_date(field, DateOrder::DayFirst).ok(),
                false => parse_field(field).ok(),
            }
        };
        let is_end = |byte: &u8| *byte == b'\n';
        let first = lines.split(is_end).take(LINES).find_map(time);
        let last = lines.rsplit(is_end).take(LINES).find_map(time);
        let Some(ends) = first.zip(last) else { return self.turns };
        // If the last time is not before the first, the clock has not wrapped within the chunk.
        let times = if ends.1 < ends.0 {
            lines.split(is_end).filter_map(time).collect()
        } else {
            Vec::new()
        };
        self.count(ends, &times)
    }

    /// Returns the turns before the first of some times, which are the next in the log.
    pub(crate) fn before_times(&mut self, times: &[f64]) -> u32 {
        match times {
            [first, ..] => self.count((*first, times[times.len() - 1]), times),
            [] => self.turns,
        }
    }

    /// Counts the turns within `times`, which begin and end with `first` and `last`; returns the turns before them.
    fn count(&mut self, (first, last): (f64, f64), times: &[f64]) -> u32 {
        self.turns += u32::from(self.before.is_some_and(|before| self.has_turned(before, first)));
        let turns = self.turns;
        if last < first {
            let mut before = first;
            for &time in times {
                if self.has_turned(before, time) {
                    self.turns += 1;
                } else if self.turns > 0 && self.has_turned(time, before) {
                    self.turns -= 1;
                }
                before = time;
            }
        }
        self.before = Some(last);
        turns
    }

    fn has_turned(&self, before: f64, after: f64) -> bool {
        let is_at_the_turn = before > self.turn - self.margin && after < self.margin;
        before < self.turn && before - after > self.turn / 2.0 && is_at_the_turn
    }

    /// Adds turns to times; `turns` precede the first time.
    pub(crate) fn unwrap(&self, times: &mut [f64], turns: u32) {
        let mut offset = f64::from(turns) * self.turn;
        let mut before = times.first().copied().unwrap_or(0.0);
        for time in times {
            if self.has_turned(before, *time) {
                offset += self.turn;
            } else if offset > 0.0 && self.has_turned(*time, before) {
                // The row is out of order: its time is from before the wraparound.
                offset -= self.turn;
            }
            before = *time;
            *time += offset;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_are_found_between_chunks_and_within_them() {
        let times: Vec<u32> = (0..2000_u32).map(|i| i.wrapping_mul(10_000_019)).collect();
        let expected: Vec<f64> = (0..2000).map(|i| f64::from(i) * 10_000_019.0).collect();
        for rows in [1, 7, 100, 2000] {
            let mut clock = ClockTurns::new(RowForm::default(), b'|', 1);
            let mut found = Vec::new();
            for chunk in times.chunks(rows) {
                let lines: String = chunk.iter().map(|time| format!("x| {time} |y\n")).collect();
                let mut values: Vec<f64> = chunk.iter().map(|&time| f64::from(time)).collect();
                let turns = clock.before(lines.as_bytes());
                clock.unwrap(&mut values, turns);
                found.extend(values);
            }
            assert_eq!(found, expected, "{rows} rows a chunk");
        }
    }

    #[test]
    fn the_time_of_day_goes_on_after_midnight() {
        let mut clock = ClockTurns::new(RowForm::default(), b',', 0).of_day();
        assert_eq!(clock.before(b"23:59:59.0,1\n23:59:59.5,2\n"), 0);
        assert_eq!(clock.before(b"00:00:00.0,3\n00:00:00.5,4\n"), 1);
        let mut times = [86_399.5, 0.0, 0.5];
        clock.unwrap(&mut times, 0);
        assert_eq!(times, [86_399.5, 86_400.0, 86_400.5]);
        let mut of_table = ClockTurns::new(RowForm::default(), b',', 0).of_day();
        assert_eq!(of_table.before_times(&[86_399.0, 0.0]), 0);
        assert_eq!(of_table.before_times(&[1.0, 2.0]), 1);
    }

    #[test]
    fn a_clock_that_was_set_back_has_not_come_round() {
        let robot = ClockTurns::new(RowForm::default(), b'|', 1);
        let unwrapped = |clock: &ClockTurns, mut times: [f64; 4]| {
            clock.unwrap(&mut times, 0);
            times
        };
        assert_eq!(unwrapped(&robot, [5e9, 1e9, 2e9, 1e9]), [5e9, 1e9, 2e9, 1e9]);
        // Concatenated recordings with a clock that is not known to wrap around.
        let counter = robot.clone().of_counter();
        assert_eq!(unwrapped(&counter, [3e9, 3.1e9, 1e3, 2e3]), [3e9, 3.1e9, 1e3, 2e3]);
        let turned = unwrapped(&counter, [4.29e9, 4.294e9, 1e3, 2e3]);
        assert_eq!(turned, [4.29e9, 4.294e9, TURN + 1e3, TURN + 2e3]);
    }
}
