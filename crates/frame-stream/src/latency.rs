//! How late rows are at their readers.
//!
//! Nobody knows by how much the clocks of board and computer differ. The row that was fastest, of every ten seconds,
//! is taken to have needed no time, which also follows clocks that do not run alike: what is told is how much longer
//! the others took. What the fastest took comes on top: conversion and transmission.

use std::fmt;

use calibration::magnitudes::Magnitudes;

/// How long the fastest row is the measure, µs of the board's clock.
const STRETCH_US: i64 = 10_000_000;

/// The unit of delays that are counted, µs: those up to 2.56 s are told apart.
const UNIT_US: f64 = 10_000.0;

/// Collects delays.
#[derive(Clone, Debug, Default)]
pub struct Latency {
    /// Delays of the current stretch, µs, and its start.
    stretch: Vec<i64>,
    start_us: i64,
    /// Those of the stretches before, in [`UNIT_US`].
    delays: Magnitudes,
    rows: u64,
}

/// What was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LatencySummary {
    /// Rows.
    pub rows: u64,
    /// Half of them took no longer, ms.
    pub median_ms: f64,
    /// 99 of 100 of them took no longer, ms.
    pub p99_ms: f64,
}

impl Latency {
    /// Takes in a row: its time on the board's clock, and when it was handed over on the computer's, µs.
    pub fn push(&mut self, board_us: i64, host_us: i64) {
        if self.stretch.is_empty() {
            self.start_us = board_us;
        }
        // A board that restarts has another clock.
        if !(0..STRETCH_US).contains(&(board_us - self.start_us)) {
            self.close();
            self.start_us = board_us;
        }
        self.stretch.push(host_us - board_us);
    }

    /// The summary of all rows; `None` if there were none.
    pub fn summary(mut self) -> Option<LatencySummary> {
        self.close();
        let ms = |share: f64| self.delays.quantile(share) * UNIT_US / 1000.0;
        let (rows, median_ms, p99_ms) = (self.rows, ms(0.5), ms(0.99));
        (rows > 0).then_some(LatencySummary { rows, median_ms, p99_ms })
    }

    fn close(&mut self) {
        let Some(&fastest) = self.stretch.iter().min() else { return };
        self.rows += self.stretch.len() as u64;
        for delay in self.stretch.drain(..) {
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
    fn delays_are_beyond_the_fastest_row_of_their_stretch() {
        let mut latency = Latency::default();
        assert_eq!(latency.clone().summary(), None);
        // 1 kHz for 60 s; the computer's clock gains 100 ppm, which is 1 ms in a stretch; one row of 50 is 5 ms late.
        for i in 0..60_000_i64 {
            let late = if i % 50 == 49 { 5000 } else { 0 };
            latency.push(i * 1000, 77_000_000 + i * 1000 + i / 10 + late);
        }
        let found = latency.summary().unwrap();
        assert_eq!(found.rows, 60_000);
        // Half the gain within a stretch; the late ones are two of a hundred.
        assert!((0.45..=0.55).contains(&found.median_ms), "{found}");
        assert!((5.0..=6.0).contains(&found.p99_ms), "{found}");
    }
}
