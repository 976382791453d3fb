//! Stretches in which the sensor is at rest and unloaded: where its zero can be seen.
//!
//! The first `STATIONARY_FRAMES` fresh frames of a log are one, by the same agreement as the usual tare. Later,
//! a stretch of as many frames or more, and of half a second at least, is one if in every channel
//!
//! - its readings scatter about their mean by no more than `QUIET` times what the first stretch's do,
//! - its fifths differ in their means by no more than `QUIET` times that scatter, and
//! - its mean lies within `SAME_ZERO` of the range that the readings have had so far, or `QUIET` times
//!   that scatter if that is more, of the mean of the stretch at rest before it.
//!
//! So the zero may wander as far as it likes, as long as it does so slowly or by little at once, and a load
//! that is held is no rest. A load that comes more slowly than twice the noise in half a second is taken for
//! drift, and a load below a twentieth of what the log has seen by then for none: nothing in the readings tells
//! them apart. Only the past is looked at, so that rests are the same while a log is recorded and afterwards.

mod watch;

use std::collections::VecDeque;
use std::ops::Range;

use shell_data::statistics::{RunningVariance, extremes};

use super::options::DEFAULT_TARE_FRAMES;

pub use watch::{FALSE_ALARMS, QuietLevel, ZeroChange, ZeroMove, ZeroWatch, largest_change};

/// The fewest frames of a rest: those of the usual tare.
pub(crate) const STATIONARY_FRAMES: usize = DEFAULT_TARE_FRAMES;

/// Parts of a rest. They tell how sure its mean is also where neighbouring frames have noise in common.
pub const PARTS: usize = 5;

/// How much noisier than the first rest a rest may be, and by how many times its noise a zero may move
/// from one rest to the next without further reason.
const QUIET: f64 = 2.0;

/// The share of the range seen so far by which a zero may move from one rest to the next: after loads it
/// comes back with hysteresis.
const SAME_ZERO: f64 = 0.05;

/// The least noise, as a share of the reading: half a step of a 12-bit converter in the middle of its range.
const LEAST_NOISE: f64 = 2.5e-4;

/// Time from the first frame of a part to its last at least, s: ten frames at 100 Hz, with room for a clock
/// that is not quite even.
const PART_S: f64 = 0.085;

/// A stretch at rest.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StationaryInterval {
    /// Time of each frame, s.
    pub times_s: Vec<f64>,
    /// Readings, counts, one column a channel.
    pub readings: Vec<Vec<f64>>,
    /// Frames of each of its [`PARTS`].
    pub parts: Vec<usize>,
}

impl StationaryInterval {
    /// Time of the first frame, s.
    pub fn start_s(&self) -> f64 {
        self.times_s.first().copied().unwrap_or(f64::NAN)
    }

    /// Time of the last frame, s.
    pub fn end_s(&self) -> f64 {
        self.times_s.last().copied().unwrap_or(f64::NAN)
    }

    /// The time between both, s.
    pub fn middle_s(&self) -> f64 {
        0.5 * (self.start_s() + self.end_s())
    }
}

/// A part of what may be a rest.
#[derive(Clone, Debug, PartialEq)]
struct StationaryPart {
    frames: usize,
    /// Of every channel.
    levels: Vec<RunningVariance>,
}

/// What is known of the readings of a channel.
#[derive(Clone, Copy, Debug, PartialEq)]
struct KnownZero {
    /// Standard deviation at rest.
    noise: f64,
    /// The mean of the last rest.
    zero: f64,
    /// Extremes of the means of parts.
    low: f64,
    high: f64,
}

/// The search for stationary intervals, as far as a log has been read.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StationaryFinder {
    /// Of every channel, once there was a rest.
    known: Vec<KnownZero>,
    /// The newest parts that have ended, [`PARTS`] at most.
    parts: VecDeque<StationaryPart>,
    /// Their frames.
    ended: usize,
    /// Those frames, and the ones since: times, and a column of readings for each channel.
    times_s: Vec<f64>,
    readings: Vec<Vec<f64>>,
    last_s: Option<f64>,
}

impl StationaryFinder {
    /// Takes the next fresh frames: their times, s, and their readings, one column a channel. The stationary intervals
    /// that end among them are handed to `found`, in order.
    pub fn look_at(
        &mut self,
        times_s: &[f64],
        readings: &[Vec<f64>],
        found: &mut dyn FnMut(&StationaryInterval),
    ) {
        self.readings.resize_with(readings.len(), Vec::new);
        let mut taken = 0;
        for (row, &time) in times_s.iter().enumerate() {
            // A clock that is set back, or is none, ends what was before.
            if self.last_s.is_some_and(|last| time < last) || !time.is_finite() {
                self.forget_first(self.times_s.len());
                taken = row;
            }
            self.last_s = Some(time);
            let frames = self.times_s.len() - self.ended + row + 1 - taken;
            let start = *self.times_s.get(self.ended).unwrap_or(&times_s[taken]);
            // The first rest is as short as a tare.
            let is_long = self.known.is_empty() || time - start >= PART_S;
            if frames >= STATIONARY_FRAMES / PARTS && is_long {
                self.extend(times_s, readings, taken..row + 1);
                taken = row + 1;
                if let Some(rest) = self.end_part() {
                    found(&rest);
                }
            }
        }
        self.extend(times_s, readings, taken..times_s.len());
    }

    fn extend(&mut self, times_s: &[f64], readings: &[Vec<f64>], rows: Range<usize>) {
        self.times_s.extend_from_slice(&times_s[rows.clone()]);
        for (column, new) in self.readings.iter_mut().zip(readings) {
            column.extend_from_slice(&new[rows.clone()]);
        }
    }

    /// Forgets so many of the oldest frames: those of whole parts, or all there are.
    fn forget_first(&mut self, frames: usize) {
        self.ended = self.ended.saturating_sub(frames);
        if self.ended == 0 {
            self.parts.clear();
        }
        self.times_s.drain(..frames);
        self.readings.iter_mut().for_each(|column| drop(column.drain(..frames)));
    }

    /// Ends the current part, and with it a rest if it is the last of one.
    fn end_part(&mut self) -> Option<StationaryInterval> {
        let levels = self.readings.iter().map(|column| RunningVariance::new(&column[self.ended..]));
        let part =
            StationaryPart { frames: self.times_s.len() - self.ended, levels: levels.collect() };
        for (known, level) in self.known.iter_mut().zip(&part.levels) {
            known.low = known.low.min(level.mean);
            known.high = known.high.max(level.mean);
        }
        if self.parts.len() == PARTS
            && let Some(oldest) = self.parts.pop_front()
        {
            self.forget_first(oldest.frames);
        }
        self.ended += part.frames;
        self.parts.push_back(part);
        if self.parts.len() < PARTS {
            return None;
        }
        let whole = |channel: usize| {
            let mut whole = RunningVariance::default();
            self.parts.iter().for_each(|part| whole.merge(&part.levels[channel]));
            whole
        };
        let whole: Vec<RunningVariance> = (0..self.readings.len()).map(whole).collect();
        // What is not a number is at rest nowhere.
        if !whole.iter().all(|level| level.mean.is_finite() && level.squares.is_finite()) {
            return None;
        }
        if self.known.is_empty() {
            let known = |level: &RunningVariance| {
                let noise = level.rms_about_mean();
                KnownZero { noise, zero: level.mean, low: level.mean, high: level.mean }
            };
            self.known = whole.iter().map(known).collect();
        } else if whole.iter().enumerate().all(|(channel, whole)| self.is_at_rest(channel, whole)) {
            self.known.iter_mut().zip(&whole).for_each(|(known, level)| known.zero = level.mean);
        } else {
            return None;
        }
        self.ended = 0;
        Some(StationaryInterval {
            times_s: std::mem::take(&mut self.times_s),
            readings: self.readings.iter_mut().map(std::mem::take).collect(),
            parts: self.parts.drain(..).map(|part| part.frames).collect(),
        })
    }

    /// Whether a channel rests over the parts, whose readings together are `whole`.
    fn is_at_rest(&self, channel: usize, whole: &RunningVariance) -> bool {
        let known = self.known[channel];
        let quiet = QUIET * known.noise.max(LEAST_NOISE * known.zero.abs());
        let (low, high) = extremes(self.parts.iter().map(|part| part.levels[channel].mean));
        let near = quiet.max(SAME_ZERO * (known.high - known.low));
        whole.rms_about_mean() <= quiet
            && high - low <= quiet
            && (whole.mean - known.zero).abs() <= near
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Noise without pattern, of standard deviation 1.
    fn noise(i: usize) -> f64 {
        let hash = (i as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let hash = (hash ^ (hash >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        ((hash >> 11) as f64 / (1_u64 << 53) as f64 - 0.5) * 12_f64.sqrt()
    }

    /// The stationary intervals of one channel at 100 Hz, as first and last time, looked at in pieces.
    fn rests(level: impl Fn(f64) -> f64, seconds: usize, piece: usize) -> Vec<(f64, f64)> {
        let times: Vec<f64> = (0..100 * seconds).map(|i| i as f64 / 100.0).collect();
        let readings: Vec<f64> =
            times.iter().enumerate().map(|(i, &t)| 2000.0 + level(t) + 4.0 * noise(i)).collect();
        let mut finder = StationaryFinder::default();
        let mut found = Vec::new();
        for (times, readings) in times.chunks(piece).zip(readings.chunks(piece)) {
            let take = &mut |rest: &StationaryInterval| found.push((rest.start_s(), rest.end_s()));
            finder.look_at(times, &[readings.to_vec()], take);
        }
        found
    }

    #[test]
    fn a_sensor_at_rest_rests_all_the_time_however_its_log_is_cut() {
        let found = rests(|_| 0.0, 60, 10_000);
        assert_eq!((found.len(), found[0]), (120, (0.0, 0.49)));
        assert_eq!(rests(|_| 0.0, 60, 7), found);
        // A drift of 40 times the noise in a minute is followed.
        assert_eq!(rests(|t| 160.0 * t / 60.0, 60, 333).len(), 120);
    }

    #[test]
    fn a_load_is_no_rest_moving_or_held() {
        // Loaded from 10 s to 40 s, held from 20 s on; the zero comes back with 3 % of hysteresis.
        let level = |t: f64| match t {
            t if t < 10.0 => 0.0,
            t if t < 20.0 => 500.0 + 300.0 * (9.0 * t).sin(),
            t if t < 40.0 => 700.0,
            _ => 24.0,
        };
        let found = rests(level, 60, 100);
        assert!(found.iter().all(|&(start, end)| end < 10.1 || start >= 40.0), "{found:?}");
        assert!(found.iter().filter(|(start, _)| *start >= 40.0).count() >= 39, "{found:?}");
    }

    #[test]
    fn a_clock_that_is_set_back_parts_rests() {
        let mut finder = StationaryFinder::default();
        let times: Vec<f64> = (0..90).map(|i| f64::from(i % 45) / 100.0).collect();
        let readings = vec![vec![7.0; 90]];
        let mut found = 0;
        finder.look_at(&times, &readings, &mut |_| found += 1);
        assert_eq!(found, 0);
        finder.look_at(&[0.45, 0.46, 0.47, 0.48, 0.49], &[vec![7.0; 5]], &mut |_| found += 1);
        assert_eq!(found, 1);
    }
}
