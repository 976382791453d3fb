//! How late rows are at their readers.
//!
//! Nobody knows by how much the clocks of board and computer differ. The row that was fastest, of every ten seconds,
//! is taken to have needed no time, which also follows clocks that do not run alike: what is told is how much longer
//! the others took. What the fastest took comes on top: conversion and transmission.

use std::fmt;

/// How long the fastest row is the measure, µs of the board's clock.
const STRETCH_US: i64 = 10_000_000;

/// Width of a class, µs, and how many there are; what is longer is counted in the last.
const CLASS_US: i64 = 10;
const CLASSES: usize = 100_000;

/// Collects delays.
#[derive(Clone, Debug, Default)]
pub struct Latency {
    /// Delays of the current stretch, µs, and its start.
    stretch: Vec<i64>,
    start_us: i64,
    classes: Vec<u64>,
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

    /// What has been found so far; `None` of nothing.
    pub fn summary(&self) -> Option<LatencySummary> {
        let mut all = self.clone();
        all.close();
        let rows: u64 = all.classes.iter().sum();
        let within = |share: f64| {
            let mut left = (share * rows as f64).ceil() as u64;
            let class = all.classes.iter().position(|&count| {
                let is_in = left <= count;
                left = left.saturating_sub(count);
                is_in
            });
            class.map_or(f64::INFINITY, |class| (class as i64 * CLASS_US) as f64 / 1000.0)
        };
        (rows > 0).then(|| LatencySummary { rows, median_ms: within(0.5), p99_ms: within(0.99) })
    }

    fn close(&mut self) {
        let Some(&fastest) = self.stretch.iter().min() else { return };
        self.classes.resize(CLASSES, 0);
        for delay in self.stretch.drain(..) {
            let class = ((delay - fastest) / CLASS_US) as usize;
            self.classes[class.min(CLASSES - 1)] += 1;
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
        assert_eq!(latency.summary(), None);
        // 1 kHz for 60 s; the computer's clock gains 100 ppm, which is 1 ms in a stretch; one row of 50 is 5 ms late.
        for i in 0..60_000_i64 {
            let late = if i % 50 == 49 { 5000 } else { 0 };
            latency.push(i * 1000, 77_000_000 + i * 1000 + i / 10 + late);
        }
        let found = latency.summary().unwrap();
        assert_eq!(found.rows, 60_000);
        // Half the gain within a stretch, to the width of a class; the late ones are two of a hundred.
        assert!((0.45..=0.55).contains(&found.median_ms), "{found}");
        assert!((5.0..=6.0).contains(&found.p99_ms), "{found}");
    }
}
