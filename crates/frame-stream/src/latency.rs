//! Latency of rows at their readers.
//!
//! The offset between the clocks of board and computer is unknown. The latency of a row is its delay beyond the fastest
//! row of the same ten seconds. Blocks of time as short as these also follow clock drift. The fastest row's own delay
//! (conversion and transmission) is not included.

use std::fmt;

use calibration::magnitudes::Magnitudes;

/// Duration of a block of time, within which rows are compared with the fastest, µs of the board's clock.
const TIME_BLOCK_US: i64 = 10_000_000;

/// Unit of the counted delays, µs: up to 2.56 s are distinguished.
const UNIT_US: f64 = 10_000.0;

#[derive(Clone, Debug, Default)]
pub struct Latency {
    /// Differences between the clocks in the current block of time, µs.
    time_block: Vec<i64>,
    start_us: i64,
    /// Delays of the earlier blocks, in [`UNIT_US`].
    delays: Magnitudes,
    rows: u64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LatencySummary {
    pub rows: u64,
    pub median_ms: f64,
    pub p99_ms: f64,
}

impl Latency {
    /// Adds a row, by its time on the board's clock and its output on the computer's, µs.
    pub fn push(&mut self, board_us: i64, host_us: i64) {
        if self.time_block.is_empty() {
            self.start_us = board_us;
        }
        if !(0..TIME_BLOCK_US).contains(&(board_us - self.start_us)) {
            self.close();
            self.start_us = board_us;
        }
        self.time_block.push(host_us - board_us);
    }

    pub fn summary(mut self) -> Option<LatencySummary> {
        self.close();
        let ms = |share: f64| self.delays.quantile(share) * UNIT_US / 1000.0;
        let (rows, median_ms, p99_ms) = (self.rows, ms(0.5), ms(0.99));
        (rows > 0).then_some(LatencySummary { rows, median_ms, p99_ms })
    }

    fn close(&mut self) {
        let Some(&fastest) = self.time_block.iter().min() else { return };
        self.rows += self.time_block.len() as u64;
        for delay in self.time_block.drain(..) {
            self.delays.add((delay - fastest) as f64 / UNIT_US);
        }
    }
}

impl fmt::Display for LatencySummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { rows, median_ms, p99_ms } = self;
        write!(
            f,
            "latency beyond the fastest row: median {median_ms:.2} ms, 99th percentile {p99_ms:.2} ms ({rows} rows)"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn delays_are_beyond_the_fastest_row_of_their_block() {
        let mut latency = Latency::default();
        assert_eq!(latency.clone().summary(), None);
        // 1 kHz for 60 s; the computer's clock gains 1 ms per block; one row in 50 is 5 ms late.
        for i in 0..60_000_i64 {
            let late = if i % 50 == 49 { 5000 } else { 0 };
            latency.push(i * 1000, 77_000_000 + i * 1000 + i / 10 + late);
        }
        let found = latency.summary().unwrap();
        assert_eq!(found.rows, 60_000);
        // The median is half the gain of a block. 2 % are late, so the 99th percentile is too.
        assert!((0.45..=0.55).contains(&found.median_ms), "{found}");
        assert!((5.0..=6.0).contains(&found.p99_ms), "{found}");
    }
}
