//! Channels that stand still in a log while others move: dead ones, whose forces are wrong without any other sign.

use super::Calibration;
use shell_data::statistics::extremes;

/// Frames below which a channel may be still by chance.
const ENOUGH_FRAMES: usize = 20;

/// Least part of its calibrated range over which another channel moves; noise is below it.
const MOVED: f64 = 0.05;

/// Least and greatest reading of each channel over the frames added.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReadingSpans {
    frames: usize,
    spans: Vec<(f64, f64)>,
}

impl ReadingSpans {
    /// The spans of `readings`, one column per channel.
    pub fn new(readings: &[Vec<f64>]) -> Self {
        let spans = readings.iter().map(|column| extremes(column.iter().copied())).collect();
        Self { frames: readings.first().map_or(0, Vec::len), spans }
    }

    pub fn merge(&mut self, other: &Self) {
        self.frames += other.frames;
        self.spans.resize(other.spans.len().max(self.spans.len()), extremes([]));
        for ((low, high), other) in self.spans.iter_mut().zip(&other.spans) {
            (*low, *high) = (low.min(other.0), high.max(other.1));
        }
    }

    /// Channels, from 0, with one reading in all frames, and that reading. Empty if no channel moves, and without
    /// channels that did not vary in the training data, either: the calibration does not use them.
    pub fn stuck(&self, calibration: &Calibration) -> Vec<(usize, f64)> {
        let spans = || self.spans.iter().take(calibration.channels()).enumerate();
        let trained =
            |channel: usize| calibration.valid_range.as_ref().and_then(|of| of.get(channel));
        let moves = |(channel, (low, high)): (usize, &(f64, f64))| {
            let least = trained(channel).map_or(0.0, |range| MOVED * (range.max - range.min));
            high - low > least
        };
        if self.frames < ENOUGH_FRAMES || !spans().any(moves) {
            return Vec::new();
        }
        let is_used = |channel| trained(channel).is_none_or(|range| range.min < range.max);
        let is_stuck = |(channel, (low, high)): (usize, &(f64, f64))| {
            (low == high && is_used(channel)).then_some((channel, *low))
        };
        spans().filter_map(is_stuck).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reading_ranges::ReadingRange;
    use crate::scaling::Scaling;
    use crate::{Basis, Model};

    #[test]
    fn a_channel_that_stands_still_while_others_move_is_stuck() {
        let model = Model { basis: Basis::Linear, intercept: false, channels: 3, memory: 0 };
        let mut calibration = Calibration::new(model, Scaling::identity(3), vec![[1.0; 6]; 3]);
        let moving: Vec<f64> = (0..20).map(f64::from).collect();
        let readings = [moving.clone(), vec![7.0; 20], vec![8.0; 20]];
        let spans = ReadingSpans::new(&readings);
        assert_eq!(spans.stuck(&calibration), [(1, 7.0), (2, 8.0)]);
        // Channel 3 did not move in the training data.
        let range = |min, max| ReadingRange { min, max };
        calibration.valid_range = Some(vec![range(0., 9.), range(0., 9.), range(8., 8.)]);
        assert_eq!(spans.stuck(&calibration), [(1, 7.0)]);

        let mut merged = spans;
        merged.merge(&ReadingSpans::new(&[vec![3.0], vec![6.0], vec![8.0]]));
        assert_eq!(merged.stuck(&calibration), []);
        // Channel 1 flickers by one of 21 counts.
        calibration.valid_range = Some(vec![range(0., 21.), range(0., 9.), range(0., 9.)]);
        let flicker = (0..20).map(|row| f64::from(5 + row % 2)).collect();
        let still = ReadingSpans::new(&[flicker, vec![7.0; 20], vec![8.0; 20]]);
        assert_eq!(still.stuck(&calibration), [], "a log at rest");
    }
}
