//! The range of the readings that a calibration has seen, which shows where it can be trusted and
//! which channels never moved. Determined in the same pass as the fit.

/// The smallest and the largest reading of one channel, in counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ReadingRange {
    /// The smallest reading.
    pub min: f64,
    /// The largest reading.
    pub max: f64,
}

/// The number of rows and the range of each channel over them. Merges in any order.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadingRanges {
    /// Number of rows.
    pub rows: u64,
    /// One range per channel; `min > max` for zero rows.
    pub channels: Vec<ReadingRange>,
}

impl ReadingRange {
    const NOTHING: ReadingRange = ReadingRange { min: f64::INFINITY, max: f64::NEG_INFINITY };

    /// Returns true if `reading` is in the range.
    pub fn contains(&self, reading: f64) -> bool {
        self.min <= reading && reading <= self.max
    }

    /// Returns true if the range is a single value.
    pub fn is_constant(&self) -> bool {
        self.min == self.max
    }

    /// Widens the range to include another.
    pub fn merge(&mut self, other: ReadingRange) {
        self.min = self.min.min(other.min);
        self.max = self.max.max(other.max);
    }
}

impl ReadingRanges {
    /// The ranges over zero rows of `channels` channels.
    pub fn new(channels: usize) -> Self {
        Self { rows: 0, channels: vec![ReadingRange::NOTHING; channels] }
    }

    /// Adds the rows of `other`.
    pub fn merge(&mut self, other: &ReadingRanges) {
        self.rows += other.rows;
        for (range, &other) in self.channels.iter_mut().zip(&other.channels) {
            range.merge(other);
        }
    }

    /// The channels, from 0, whose range is a single value.
    pub fn constant_channels(&self) -> Vec<usize> {
        (0..self.channels.len()).filter(|&i| self.channels[i].is_constant()).collect()
    }
}
