//! Alignment of a frame's readings to a common time.
//!
//! The board's converter reads the channels one after the other over about 4 ms, in which a load of
//! 20 Hz and 1 N changes by half a newton. The board reports the times ([`shared_proto::Timing`]),
//! and every channel is interpolated to the middle of the frame, by the polynomial through its
//! readings in this frame and in up to [`REACH`] frames on either side. At a distance s (in frames)
//! from its middle point, the polynomial of seven equidistant points has an error of at most
//! s(s²−1)(s²−4)(s²−9)/5040 · (2πf/rate)⁷ of a sine's amplitude (J. Stoer, R. Bulirsch,
//! "Introduction to Numerical Analysis", 2.1.4): 0.6 % for 20 Hz at 100 Hz and s = 0.19.
//! Next to a gap there are fewer points; an isolated frame is left as sampled.

use super::reception::{BoardFrame, Measured};
use shared_proto::{CHANNELS, COUNTS_PER_LSB, Timing};

const REACH: usize = 3;

/// Largest time between consecutive frames of a run, as a multiple of the shorter of the two times
/// next to the frame.
const LONGEST_STEP: f64 = 1.5;

/// Maximum delay of frames until the board reports its timing, µs; it reports once a second.
const PATIENCE_US: i64 = 1_200_000;

const MOST_HELD: usize = 4096;

const LARGEST: f64 = 4096.0 - 1.0 / COUNTS_PER_LSB as f64;

#[derive(Clone, Debug, Default)]
pub struct Simultaneous {
    /// Frames already returned, as they arrived: at most [`REACH`].
    before: Vec<BoardFrame>,
    waiting: Vec<BoardFrame>,
    described: bool,
    as_sampled: bool,
    /// True if frames do not wait for later ones.
    immediate: bool,
}

impl Simultaneous {
    /// Creates an aligner. With `as_sampled`, readings stay unchanged, and only the time of a frame
    /// moves to the frame's middle.
    pub fn new(as_sampled: bool) -> Self {
        Self { as_sampled, ..Self::default() }
    }

    /// Creates an aligner that leaves readings as sampled and waits only for the first report.
    pub fn immediate() -> Self {
        Self { as_sampled: true, immediate: true, ..Self::default() }
    }

    /// Takes frames sorted by index; returns the frames due, in the same order. Until `ended`, the
    /// last ones wait. A frame that is older than a frame already returned comes before the others,
    /// with its readings as sampled.
    pub fn take(
        &mut self,
        frames: impl Iterator<Item = BoardFrame>,
        ended: bool,
    ) -> Vec<BoardFrame> {
        let newest = self.before.last().map(|frame| frame.index);
        let (mut ready, mut on_time): (Vec<_>, Vec<_>) =
            frames.partition(|frame| newest.is_some_and(|newest| frame.index < newest));
        for frame in &mut ready {
            *frame = BoardFrame { skewed: frame.timing.is_some(), ..at_middle(frame) };
        }
        self.waiting.append(&mut on_time);
        self.waiting.sort_by_key(|frame| frame.index);
        if !(self.is_described() || ended) {
            return ready;
        }
        let kept = if ended || self.immediate { 0 } else { REACH };
        let count = self.waiting.len().saturating_sub(kept);
        let first = self.before.len();
        let mut all = std::mem::take(&mut self.before);
        all.append(&mut self.waiting);
        ready.extend((first..first + count).map(|at| match self.as_sampled {
            true => at_middle(&all[at]),
            false => at_one_time(&all, at),
        }));
        self.waiting = all.split_off(first + count);
        self.before = all.split_off(all.len().saturating_sub(REACH));
        ready
    }

    /// Returns true once the timing, which also holds for earlier frames, is known or no longer waited for.
    fn is_described(&mut self) -> bool {
        if self.described {
            return true;
        }
        let timing = self.waiting.iter().find_map(|frame| frame.timing);
        let extent_us = match &self.waiting[..] {
            [first, .., last] => last.time_us - first.time_us,
            _ => 0,
        };
        self.described =
            timing.is_some() || extent_us > PATIENCE_US || self.waiting.len() >= MOST_HELD;
        let undescribed = self.waiting.iter_mut().take_while(|frame| frame.timing.is_none());
        undescribed.for_each(|frame| frame.timing = timing);
        self.described
    }
}

fn middle_us(timing: Timing) -> f64 {
    f64::from(timing.first_us) + f64::from(timing.step_us) * (CHANNELS as f64 - 1.0) / 2.0
}

fn at_middle(frame: &BoardFrame) -> BoardFrame {
    let shift_us = frame.timing.map_or(0.0, middle_us).round() as i64;
    BoardFrame { time_us: frame.time_us + shift_us, ..frame.clone() }
}

fn at_one_time(all: &[BoardFrame], at: usize) -> BoardFrame {
    let mut frame = at_middle(&all[at]);
    let (Some(timing), Measured::Readings(readings)) = (frame.timing, &mut frame.measured) else {
        return frame; // the times are unknown, or the board has converted
    };
    let points = &all[run(all, at)];
    if points.len() < 2 {
        frame.skewed = true;
        return frame;
    }
    let times: Vec<f64> = points.iter().map(|p| (p.time_us - all[at].time_us) as f64).collect();
    for (channel, reading) in readings.iter_mut().enumerate() {
        let ahead_us = f64::from(timing.step_us) * ((CHANNELS as f64 - 1.0) / 2.0 - channel as f64);
        let values = points.iter().filter_map(|point| Some(point.measured.readings()?[channel]));
        let value = interpolate(&times, values, ahead_us);
        let counts = f64::from(COUNTS_PER_LSB);
        *reading = ((value * counts).round() / counts).clamp(0.0, LARGEST);
    }
    frame.saturated = points.iter().fold(0, |mask, point| mask | point.saturated);
    frame
}

/// Returns the consecutive frames around `at`, at most [`REACH`] on either side.
fn run(all: &[BoardFrame], at: usize) -> std::ops::Range<usize> {
    let step = |left: usize| -> Option<f64> {
        let (a, b) = (all.get(left)?, all.get(left + 1)?);
        let follows = b.index == a.index + 1 && !b.restarted && b.dropped == a.dropped;
        let alike = a.measured.readings().is_some() && b.measured.readings().is_some();
        let step = b.time_us - a.time_us;
        (follows && alike && step > 0).then_some(step as f64)
    };
    let nearest = [at.checked_sub(1).and_then(step), step(at)].into_iter().flatten();
    let longest = LONGEST_STEP * nearest.fold(f64::INFINITY, f64::min);
    let belongs = |left: usize| step(left).is_some_and(|step| step <= longest);
    let (mut start, mut end) = (at, at + 1);
    while start > 0 && at - start < REACH && belongs(start - 1) {
        start -= 1;
    }
    while end - at <= REACH && belongs(end - 1) {
        end += 1;
    }
    start..end
}

/// Evaluates the polynomial through points at `times`, which all differ (Lagrange's form).
fn interpolate(times: &[f64], values: impl Iterator<Item = f64>, t: f64) -> f64 {
    let weight = |i: usize| -> f64 {
        let others = times.iter().enumerate().filter(|(j, _)| *j != i);
        others.map(|(_, other)| (t - other) / (times[i] - other)).product()
    };
    values.enumerate().map(|(i, value)| weight(i) * value).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    const TIMING: Timing = Timing { first_us: 278, step_us: 530 };

    fn frame(index: i64, light: impl Fn(f64) -> f64) -> BoardFrame {
        let time_us = index * 10_000;
        let read = |channel: usize| {
            let at_us = time_us as f64 + 278.0 + 530.0 * channel as f64;
            light(at_us / 1e6)
        };
        BoardFrame {
            time_us,
            index,
            measured: Measured::Readings(std::array::from_fn(read)),
            saturated: 0,
            dropped: 0,
            restarted: false,
            timing: Some(TIMING),
            health: None,
            edge: None,
            skewed: false,
            rssi_dbm: None,
        }
    }

    fn readings(frame: &BoardFrame) -> [f64; CHANNELS] {
        match frame.measured {
            Measured::Readings(readings) => readings,
            Measured::Wrench(_) => panic!("a wrench"),
        }
    }

    fn corrected(frames: &[BoardFrame], batch: usize) -> Vec<BoardFrame> {
        let mut simultaneous = Simultaneous::default();
        let mut out = Vec::new();
        for batch in frames.chunks(batch) {
            out.extend(simultaneous.take(batch.iter().cloned(), false));
        }
        out.extend(simultaneous.take(std::iter::empty(), true));
        out
    }

    fn spread(frame: &BoardFrame) -> f64 {
        let readings = readings(frame);
        readings.iter().copied().fold(f64::MIN, f64::max)
            - readings.iter().copied().fold(f64::MAX, f64::min)
    }

    /// Effect of a load, equal on all channels, in steps: 1 N is 500.
    fn sine(t: f64) -> f64 {
        2000.0 + 500.0 * (TAU * 20.0 * t).sin()
    }

    #[test]
    fn channels_agree_on_a_load_of_20_hz_within_two_hundredths() {
        // A period of the load has only five frames, so try phases in between.
        let (mut before, mut after, mut off) = (0.0_f64, 0.0_f64, 0.0_f64);
        for phase in 0..20 {
            let shift_s = f64::from(phase) / 20.0 * 0.01;
            let frames: Vec<_> = (0..60).map(|index| frame(index, |t| sine(t + shift_s))).collect();
            before = frames.iter().map(spread).fold(before, f64::max);
            for (row, frame) in corrected(&frames, 7).iter().enumerate() {
                assert_eq!(frame.time_us, 10_000 * row as i64 + 278 + 1_855);
                if (REACH..60 - REACH).contains(&row) {
                    after = after.max(spread(frame));
                    let truth = sine(frame.time_us as f64 / 1e6 + shift_s);
                    let errors = readings(frame).map(|reading| (reading - truth).abs());
                    off = errors.into_iter().fold(off, f64::max);
                }
            }
        }
        // Largest change in 3.71 ms: 2 sin(π · 20 Hz · 3.71 ms) times the amplitude, which is 500
        // steps (1 N).
        assert!((before / 500.0 - 0.462).abs() < 0.005, "{before}");
        // The bound in the module's documentation at s = ±0.1855 is 0.0062; rounding to a sixteenth
        // of a step adds a hundredth of that.
        assert!(off / 500.0 < 0.0064, "{off}");
        assert!(after / 500.0 < 0.0127, "{after}");
    }

    #[test]
    fn batches_make_no_difference() {
        let frames: Vec<_> = (0..50).map(|index| frame(index, sine)).collect();
        let whole = corrected(&frames, 50);
        for batch in 1..20 {
            assert_eq!(corrected(&frames, batch), whole);
        }
    }

    #[test]
    fn a_polynomial_is_met_next_to_gaps_and_ends_too() {
        // Any two points determine a straight line.
        let line = |t: f64| 1000.0 + 800.0 * t;
        let frames: Vec<_> =
            (0..60).filter(|index| index % 11 != 5).map(|index| frame(index, line)).collect();
        for frame in corrected(&frames, 9) {
            let truth = line(frame.time_us as f64 / 1e6);
            for reading in readings(&frame) {
                assert!((reading - truth).abs() <= 1.0 / 32.0 + 1e-9, "{reading} for {truth}");
            }
        }
    }

    #[test]
    fn a_single_frame_is_unchanged_and_flagged() {
        let mut frames: Vec<_> = (0..5).map(|index| frame(index * 2, sine)).collect();
        let out = corrected(&frames, 5);
        for (out, frame) in out.iter().zip(&frames) {
            assert!(out.skewed);
            assert_eq!(out.measured, frame.measured);
        }
        // Frames around a dropped frame or a restart are isolated as well.
        frames = (0..2).map(|index| frame(index, sine)).collect();
        frames[1].dropped = 1;
        assert!(corrected(&frames, 2).iter().all(|frame| frame.skewed));
        frames[1].dropped = 0;
        frames[1].restarted = true;
        assert!(corrected(&frames, 2).iter().all(|frame| frame.skewed));
    }

    #[test]
    fn a_pause_of_the_stream_is_not_interpolated() {
        let mut frames: Vec<_> = (0..20).map(|index| frame(index, |_| 1000.0)).collect();
        for frame in &mut frames[10..] {
            frame.time_us += 3_000_000;
            frame.measured = Measured::Readings([3000.0; CHANNELS]);
        }
        let out = corrected(&frames, 20);
        for (row, frame) in out.iter().enumerate() {
            assert_eq!(readings(frame), [if row < 10 { 1000.0 } else { 3000.0 }; CHANNELS]);
        }
    }

    #[test]
    fn frames_before_the_boards_timing_wait_with_a_timeout() {
        let mut frames: Vec<_> = (0..60).map(|index| frame(index, sine)).collect();
        let whole = corrected(&frames, 60);
        frames[..50].iter_mut().for_each(|frame| frame.timing = None);
        assert_eq!(corrected(&frames, 10), whole);
        // Frames of a board that never reports its timing are returned as sampled, and no row is
        // flagged.
        let mut frames: Vec<_> = (0..300).map(|index| frame(index, sine)).collect();
        frames.iter_mut().for_each(|frame| frame.timing = None);
        let mut simultaneous = Simultaneous::default();
        assert!(simultaneous.take(frames[..100].iter().cloned(), false).is_empty());
        let out = simultaneous.take(frames[100..].iter().cloned(), false);
        assert_eq!(out, frames[..297]);
    }

    #[test]
    fn late_frames_are_written_as_sampled() {
        let frames: Vec<_> = (0..30).map(|index| frame(index, sine)).collect();
        let mut simultaneous = Simultaneous::default();
        let without = frames.iter().filter(|frame| frame.index != 4).cloned();
        simultaneous.take(without, false);
        let late = simultaneous.take(frames[4..5].iter().cloned(), false);
        assert_eq!(late.len(), 1);
        assert_eq!((late[0].measured, late[0].skewed), (frames[4].measured, true));
    }

    #[test]
    fn frames_interpolated_from_saturated_readings_are_flagged() {
        let mut frames: Vec<_> = (0..20).map(|index| frame(index, sine)).collect();
        frames[10].saturated = 0b100;
        for frame in corrected(&frames, 20) {
            let near = (frame.index - 10).unsigned_abs() <= REACH as u64;
            assert_eq!(frame.saturated, if near { 0b100 } else { 0 });
        }
    }
}
