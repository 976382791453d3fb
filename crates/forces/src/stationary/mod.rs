//! Stationary intervals: times in which a still and unloaded sensor shows its zero.
//!
//! The first `STATIONARY_FRAMES` fresh frames of a log form an interval, as in the usual tare. A later block of at
//! least as many frames, and half a second, is stationary if in every channel
//!
//! - its readings scatter about their mean by at most `QUIET` times the scatter of the first
//!   interval,
//! - the means of its fifths differ by no more than `QUIET` times that scatter, and
//! - its mean differs from the previous interval's by no more than `SAME_ZERO` of the range so far,
//!   or `QUIET` times that scatter if that is more.
//!
//! So the zero may drift arbitrarily far if it does so slowly or in small steps, but a pose with a
//! load is not taken for a stationary interval. A load that rises more slowly than twice the noise
//! in half a second is taken for drift. A load below a twentieth of the range so far is taken for
//! no load. Only the past is used: the intervals are the same during recording and afterwards.

mod watch;

use std::collections::VecDeque;
use std::ops::Range;

use shell_data::statistics::{RunningVariance, extremes};

use super::options::DEFAULT_TARE_FRAMES;

pub use watch::{FALSE_ALARMS, ZeroChange, ZeroEstimate, ZeroMove, ZeroWatch, largest_change};

/// Minimum number of frames of a stationary interval, as in the usual tare.
pub(crate) const STATIONARY_FRAMES: usize = DEFAULT_TARE_FRAMES;

/// Number of parts of a stationary interval. Their scatter gives the standard error of its mean even for correlated
/// noise.
pub const PARTS: usize = 5;

/// Limit, in units of the first interval's noise, on the noise of an interval, on the range of its parts' means, and on
/// the shift of the zero between intervals.
const QUIET: f64 = 2.0;

/// Limit on the shift of the zero between intervals, as a share of the range so far: because of
/// hysteresis, the zero does not return exactly.
const SAME_ZERO: f64 = 0.05;

/// The minimum noise, as a share of the reading: half a step of a 12-bit converter at mid-range.
const LEAST_NOISE: f64 = 2.5e-4;

/// Least time from the first to the last frame of a part, s: ten frames at 100 Hz, with an
/// allowance for an uneven clock.
const PART_S: f64 = 0.085;

#[derive(Clone, Debug, Default, PartialEq)]
pub struct StationaryInterval {
    pub times_s: Vec<f64>,
    pub readings: Vec<Vec<f64>>,
    pub parts: Vec<usize>,
}

impl StationaryInterval {
    pub fn start_s(&self) -> f64 {
        self.times_s.first().copied().unwrap_or(f64::NAN)
    }

    pub fn end_s(&self) -> f64 {
        self.times_s.last().copied().unwrap_or(f64::NAN)
    }

    pub fn middle_s(&self) -> f64 {
        0.5 * (self.start_s() + self.end_s())
    }
}

#[derive(Clone, Debug, PartialEq)]
struct StationaryPart {
    frames: usize,
    channels: Vec<RunningVariance>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct KnownZero {
    noise: f64,
    zero: f64,
    low: f64,
    high: f64,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct StationaryFinder {
    /// The zero of each channel, once a stationary interval was found.
    known: Vec<KnownZero>,
    parts: VecDeque<StationaryPart>,
    ended: usize,
    /// Times and readings of the `ended` frames in whole parts and of the later frames; one column
    /// per channel.
    times_s: Vec<f64>,
    readings: Vec<Vec<f64>>,
    last_s: Option<f64>,
}

impl StationaryFinder {
    /// Takes the next fresh frames: times, s, and readings, one column per channel. Passes
    /// stationary intervals that end among them to `found`, in order.
    pub fn look_at(
        &mut self,
        times_s: &[f64],
        readings: &[Vec<f64>],
        found: &mut dyn FnMut(&StationaryInterval),
    ) {
        self.readings.resize_with(readings.len(), Vec::new);
        let mut taken = 0;
        for (row, &time) in times_s.iter().enumerate() {
            // A clock that is set back, or is not finite, ends the current candidate.
            if self.last_s.is_some_and(|last| time < last) || !time.is_finite() {
                self.forget_first(self.times_s.len());
                taken = row;
            }
            self.last_s = Some(time);
            let frames = self.times_s.len() - self.ended + row + 1 - taken;
            let start = *self.times_s.get(self.ended).unwrap_or(&times_s[taken]);
            // The first interval may be as short as a tare.
            let is_long = self.known.is_empty() || time - start >= PART_S;
            if frames >= STATIONARY_FRAMES / PARTS && is_long {
                self.extend(times_s, readings, taken..row + 1);
                taken = row + 1;
                if let Some(stationary) = self.end_part() {
                    found(&stationary);
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

    /// Forgets the oldest frames: those of whole parts, or all of them.
    fn forget_first(&mut self, frames: usize) {
        self.ended = self.ended.saturating_sub(frames);
        if self.ended == 0 {
            self.parts.clear();
        }
        self.times_s.drain(..frames);
        self.readings.iter_mut().for_each(|column| drop(column.drain(..frames)));
    }

    fn end_part(&mut self) -> Option<StationaryInterval> {
        let channels =
            self.readings.iter().map(|column| RunningVariance::new(&column[self.ended..]));
        let part = StationaryPart {
            frames: self.times_s.len() - self.ended,
            channels: channels.collect(),
        };
        for (known, channel) in self.known.iter_mut().zip(&part.channels) {
            known.low = known.low.min(channel.mean);
            known.high = known.high.max(channel.mean);
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
            self.parts.iter().for_each(|part| whole.merge(&part.channels[channel]));
            whole
        };
        let whole: Vec<RunningVariance> = (0..self.readings.len()).map(whole).collect();
        // Values that are not finite are never stationary.
        if !whole.iter().all(|channel| channel.mean.is_finite() && channel.squares.is_finite()) {
            return None;
        }
        if self.known.is_empty() {
            let known = |channel: &RunningVariance| {
                let (noise, zero) = (channel.rms_about_mean(), channel.mean);
                KnownZero { noise, zero, low: zero, high: zero }
            };
            self.known = whole.iter().map(known).collect();
        } else if whole
            .iter()
            .enumerate()
            .all(|(channel, whole)| self.is_stationary(channel, whole))
        {
            self.known
                .iter_mut()
                .zip(&whole)
                .for_each(|(known, channel)| known.zero = channel.mean);
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

    /// Returns true if a channel is stationary over the parts, whose combined readings are `whole`.
    fn is_stationary(&self, channel: usize, whole: &RunningVariance) -> bool {
        let known = self.known[channel];
        let quiet = QUIET * known.noise.max(LEAST_NOISE * known.zero.abs());
        let (low, high) = extremes(self.parts.iter().map(|part| part.channels[channel].mean));
        let near = quiet.max(SAME_ZERO * (known.high - known.low));
        whole.rms_about_mean() <= quiet
            && high - low <= quiet
            && (whole.mean - known.zero).abs() <= near
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(i: usize) -> f64 {
        let hash = (i as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let hash = (hash ^ (hash >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        ((hash >> 11) as f64 / (1_u64 << 53) as f64 - 0.5) * 12_f64.sqrt()
    }

    /// First and last times of stationary intervals of a channel at 100 Hz, fed in pieces.
    fn stationary(signal: impl Fn(f64) -> f64, seconds: usize, piece: usize) -> Vec<(f64, f64)> {
        let times: Vec<f64> = (0..100 * seconds).map(|i| i as f64 / 100.0).collect();
        let readings: Vec<f64> =
            times.iter().enumerate().map(|(i, &t)| 2000.0 + signal(t) + 4.0 * noise(i)).collect();
        let mut finder = StationaryFinder::default();
        let mut found = Vec::new();
        for (times, readings) in times.chunks(piece).zip(readings.chunks(piece)) {
            let take = &mut |of: &StationaryInterval| found.push((of.start_s(), of.end_s()));
            finder.look_at(times, &[readings.to_vec()], take);
        }
        found
    }

    #[test]
    fn a_still_sensor_is_stationary_throughout_for_any_blocks() {
        let found = stationary(|_| 0.0, 60, 10_000);
        assert_eq!((found.len(), found[0]), (120, (0.0, 0.49)));
        assert_eq!(stationary(|_| 0.0, 60, 7), found);
        // A drift of 40 times the noise in a minute is followed.
        assert_eq!(stationary(|t| 160.0 * t / 60.0, 60, 333).len(), 120);
    }

    #[test]
    fn a_moving_or_held_load_is_not_stationary() {
        // Loaded from 10 s to 40 s, held from 20 s on; the zero returns with 3 % hysteresis.
        let signal = |t: f64| match t {
            t if t < 10.0 => 0.0,
            t if t < 20.0 => 500.0 + 300.0 * (9.0 * t).sin(),
            t if t < 40.0 => 700.0,
            _ => 24.0,
        };
        let found = stationary(signal, 60, 100);
        assert!(found.iter().all(|&(start, end)| end < 10.1 || start >= 40.0), "{found:?}");
        assert!(found.iter().filter(|(start, _)| *start >= 40.0).count() >= 39, "{found:?}");
    }

    #[test]
    fn a_clock_that_goes_back_splits_stationary_intervals() {
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
