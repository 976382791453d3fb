//! How often a clock of 32 bits has wrapped around before a chunk.
//!
//! The robot's clock counts µs in 32 bits, so it wraps around every 71.6 min. Chunks are handed out in
//! the order of the file, and each is far shorter than that: the first time of one against the first of
//! the one before tells.

/// The clock wraps around after so many µs.
pub(crate) const TURN_US: f64 = 4_294_967_296.0;

/// How far a clock goes back where it has wrapped around, at least.
const BACK_US: f64 = TURN_US / 2.0;

/// Lines of a chunk that are looked at for a time.
const LINES: usize = 8;

/// Finds the turns before each of the chunks that it is shown.
#[derive(Clone, Debug)]
pub(crate) struct ClockTurns {
    separator: u8,
    column: usize,
    before_us: Option<f64>,
    turns: u32,
}

impl ClockTurns {
    /// For a clock in that column.
    pub(crate) fn new(separator: u8, column: usize) -> Self {
        Self { separator, column, before_us: None, turns: 0 }
    }

    /// Turns before the first row of the next chunk.
    pub(crate) fn before(&mut self, lines: &[u8]) -> u32 {
        let time = |line: &[u8]| {
            let field = line.split(|&byte| byte == self.separator).nth(self.column)?;
            str::from_utf8(field.trim_ascii()).ok()?.parse::<f64>().ok()
        };
        let first_us = lines.split(|&byte| byte == b'\n').take(LINES).find_map(time);
        if let Some(first_us) = first_us {
            self.turns +=
                u32::from(self.before_us.is_some_and(|before| has_turned(before, first_us)));
            self.before_us = Some(first_us);
        }
        self.turns
    }
}

fn has_turned(before_us: f64, after_us: f64) -> bool {
    before_us < TURN_US && before_us - after_us > BACK_US
}

/// Adds the turns to times in µs, of which so many are before the first.
pub(crate) fn unwrap(times_us: &mut [f64], turns: u32) {
    let mut offset_us = f64::from(turns) * TURN_US;
    let mut before_us = times_us.first().copied().unwrap_or(0.0);
    for time_us in times_us {
        if has_turned(before_us, *time_us) {
            offset_us += TURN_US;
        } else if offset_us > 0.0 && has_turned(*time_us, before_us) {
            // A row that was overtaken.
            offset_us -= TURN_US;
        }
        before_us = *time_us;
        *time_us += offset_us;
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
            let mut clock = ClockTurns::new(b'|', 1);
            let mut found = Vec::new();
            for chunk in times.chunks(rows) {
                let lines: String = chunk.iter().map(|time| format!("x| {time} |y\n")).collect();
                let mut values: Vec<f64> = chunk.iter().map(|&time| f64::from(time)).collect();
                unwrap(&mut values, clock.before(lines.as_bytes()));
                found.extend(values);
            }
            assert_eq!(found, expected, "{rows} rows a chunk");
        }
    }

    #[test]
    fn a_clock_that_was_set_back_has_not_come_round() {
        let mut times = [5e9, 1e9, 2e9, 1e9];
        unwrap(&mut times, 0);
        assert_eq!(times, [5e9, 1e9, 2e9, 1e9]);
    }
}
