//! Rows and ranges of readings.

use serde::{Deserialize, Serialize};

/// The smallest and the largest reading of one channel, in counts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Range {
    /// The smallest reading.
    pub min: f64,
    /// The largest reading.
    pub max: f64,
}

/// Rows seen and the range of each channel over them. Merges in any order.
#[derive(Clone, Debug, PartialEq)]
pub struct Extent {
    /// Number of rows.
    pub rows: u64,
    /// One range per channel; of no rows, upside down.
    pub ranges: Vec<Range>,
}

impl Range {
    const NOTHING: Range = Range { min: f64::INFINITY, max: f64::NEG_INFINITY };

    /// Whether `reading` lies within.
    pub fn contains(&self, reading: f64) -> bool {
        self.min <= reading && reading <= self.max
    }

    /// Whether there was only ever one value.
    pub fn is_constant(&self) -> bool {
        self.min == self.max
    }

    fn merge(&mut self, other: Range) {
        self.min = self.min.min(other.min);
        self.max = self.max.max(other.max);
    }
}

impl Extent {
    /// No rows of `channels` channels.
    pub fn new(channels: usize) -> Self {
        Self { rows: 0, ranges: vec![Range::NOTHING; channels] }
    }

    /// Adds what `other` has seen.
    pub fn merge(&mut self, other: &Extent) {
        self.rows += other.rows;
        for (range, &other) in self.ranges.iter_mut().zip(&other.ranges) {
            range.merge(other);
        }
    }

    /// The channels, from 0, that only ever had one value.
    pub fn constant_channels(&self) -> Vec<usize> {
        (0..self.ranges.len()).filter(|&i| self.ranges[i].is_constant()).collect()
    }
}
