//! Ranges of the training readings. A calibration can be trusted within them. They are found while fitting.

/// Range of the readings of a channel, in counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ReadingRange {
    pub min: f64,
    pub max: f64,
}

/// Ranges of all channels. They merge in any order.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadingRanges {
    pub rows: u64,
    /// Range of each channel; `min > max` for zero rows.
    pub channels: Vec<ReadingRange>,
}

impl ReadingRange {
    const NOTHING: ReadingRange = ReadingRange { min: f64::INFINITY, max: f64::NEG_INFINITY };

    pub fn contains(&self, reading: f64) -> bool {
        self.min <= reading && reading <= self.max
    }

    pub fn is_constant(&self) -> bool {
        self.min == self.max
    }

    pub fn merge(&mut self, other: ReadingRange) {
        self.min = self.min.min(other.min);
        self.max = self.max.max(other.max);
    }
}

impl ReadingRanges {
    pub fn new(channels: usize) -> Self {
        Self { rows: 0, channels: vec![ReadingRange::NOTHING; channels] }
    }

    pub fn merge(&mut self, other: &ReadingRanges) {
        self.rows += other.rows;
        for (range, &other) in self.channels.iter_mut().zip(&other.channels) {
            range.merge(other);
        }
    }

    /// Channels that never change, numbered from 0.
    pub fn constant_channels(&self) -> Vec<usize> {
        (0..self.channels.len()).filter(|&i| self.channels[i].is_constant()).collect()
    }
}
