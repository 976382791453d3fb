//! A reference sensor that is recorded with a board: its samples on the board's clock.
//!
//! ```text
//! samples, their arrival ─ ArrivalClock ─▶ time of this computer ─┐
//! frames, their arrival  ─ ArrivalClock ─▶ time of this computer ─┴─▶ the sample nearest to each frame
//! ```
//! A row gets the sample closest in time to its frame, or none if no sample is close. [`rows`](super::rows) describes
//! its columns.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::sync::{Arc, Mutex};
use std::time::Instant;

use serde::Serialize;
use shell_data::lock::lock;
use shell_data::{Axes, PerAxis};

use super::arrival_clock::ArrivalClock;
use super::reception::BoardFrame;

#[derive(Clone, Debug, PartialEq)]
pub struct ReferenceSample {
    /// Number that continues across wraps and restarts of the sensor.
    pub number: i64,
    /// The sensor's time in any unit, or else its sample number; `None` if it sends neither.
    pub tick: Option<f64>,
    pub restarted: bool,
    pub arrival: Instant,
    /// N and N·m, 0 for axes that are not measured; `None` if the sensor has an error.
    pub wrench: Option<PerAxis<f64>>,
    /// The sensor's status word, 0 if all is well.
    pub status: u32,
    pub missing: u64,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct ReferenceCounts {
    pub samples: u64,
    pub missing: u64,
    pub late: u64,
    pub duplicates: u64,
    pub restarts: u64,
    pub with_status: u64,
    pub damaged: u64,
    /// Samples without a time that arrived together with a later one. Their age is unknown, so they are in no row.
    pub untimed: u64,
}

impl ReferenceCounts {
    pub fn in_words(&self) -> String {
        let Self { missing, late, duplicates, restarts, with_status, damaged, untimed, .. } = *self;
        let counts = [
            (missing, "lost"),
            (late, "late"),
            (duplicates, "doubled"),
            (restarts, "restarts"),
            (with_status, "with a status word"),
            (damaged, "damaged"),
            (untimed, "of unknown age"),
        ];
        let counts = counts.into_iter().filter(|(count, _)| *count > 0);
        let words: Vec<_> = counts.map(|(count, what)| format!("{count} {what}")).collect();
        if words.is_empty() { "none lost".to_owned() } else { words.join(", ") }
    }
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReferenceState {
    pub counts: ReferenceCounts,
    pub problem: Option<String>,
}

/// The receiving end of a reference. Dropping it ends the reading thread.
#[derive(Debug)]
pub struct ReferenceInput {
    pub name: String,
    pub axes: Axes,
    pub samples: Receiver<ReferenceSample>,
    pub state: Arc<Mutex<ReferenceState>>,
    pub stop: Arc<AtomicBool>,
}

impl Drop for ReferenceInput {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RecordedReference {
    pub source: String,
    #[serde(flatten)]
    pub counts: ReferenceCounts,
    pub rows_without: u64,
    /// Error of times on the board's clock, s, without the constant parts of both delays.
    pub clock_error_s: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub problem: Option<String>,
}

#[derive(Clone, Debug)]
struct TimedSample {
    time_s: f64,
    sample: ReferenceSample,
}

/// Maximum number of samples that wait for frames: 8 s at 8 kHz.
const MOST_SAMPLES: usize = 1 << 16;

/// Age at which samples are dropped, s: no radio delays a frame for that long.
const OLDEST_S: f64 = 5.0;

/// Maximum time that a frame waits for the reference, s: longer than the reference's clock takes to settle.
const PATIENCE_S: f64 = 1.0;

/// Relative tolerance of the board's clock: some boards have no crystal.
const BOARD_CLOCK: f64 = 0.02;

/// Distance from the line of the reference's clock that means another clock, in periods.
const JUMP_PERIODS: f64 = 1.5;

/// Distance from the board's clock that means another clock, s: more than any radio's delay.
const BOARD_JUMP_S: f64 = 1.0;

#[derive(Debug)]
pub(crate) struct ReferenceBeside {
    input: ReferenceInput,
    epoch: Instant,
    clock: ArrivalClock,
    /// Clocks of the board, each with the board's time, µs, from which it applies: the board may restart.
    board: VecDeque<(i64, ArrivalClock)>,
    /// Samples that wait for a settled clock, with arrival times, s.
    pending: Vec<(f64, ReferenceSample)>,
    samples: VecDeque<TimedSample>,
    last: Option<i64>,
    newest_s: f64,
    rows_without: u64,
    period_s: f64,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct BesideRow {
    pub(crate) wrench: Option<PerAxis<f64>>,
    pub(crate) number: i64,
    pub(crate) missing: u64,
    pub(crate) status: u32,
    pub(crate) time_us: i64,
    pub(crate) error_us: i64,
}

impl ReferenceBeside {
    pub(crate) fn new(input: ReferenceInput, epoch: Instant) -> Self {
        Self {
            input,
            epoch,
            clock: ArrivalClock::default(),
            board: VecDeque::new(),
            pending: Vec::new(),
            samples: VecDeque::new(),
            last: None,
            newest_s: f64::NEG_INFINITY,
            rows_without: 0,
            period_s: 0.0,
        }
    }

    pub(crate) fn axes(&self) -> Axes {
        self.input.axes
    }

    /// Takes the samples that have arrived; returns the newest wrench.
    pub(crate) fn listen(&mut self) -> Option<PerAxis<f64>> {
        let fresh: Vec<_> = self.input.samples.try_iter().collect();
        let newest = fresh.iter().rev().find_map(|sample| sample.wrench);
        for sample in fresh {
            let since = sample.arrival.saturating_duration_since(self.epoch);
            let before = self.epoch.saturating_duration_since(sample.arrival);
            let arrival_s = since.as_secs_f64() - before.as_secs_f64();
            if sample.restarted {
                self.settle();
                self.clock = self.clock.begun_anew();
            }
            let Some(tick) = sample.tick else {
                self.keep(arrival_s, sample);
                continue;
            };
            self.clock.push(tick, arrival_s, (JUMP_PERIODS * self.period_s).max(2e-3));
            self.pending.push((arrival_s, sample));
            // Until the clock is settled, a sample may have waited in a queue for an unknown time.
            if self.clock.is_settled() {
                self.settle();
            }
        }
        let is_old = |of: &TimedSample| of.time_s < self.newest_s - OLDEST_S;
        while self.samples.front().is_some_and(is_old) || self.samples.len() > MOST_SAMPLES {
            self.samples.pop_front();
        }
        self.period_s = self.period();
        newest
    }

    /// Assigns times to the waiting samples, or drops them if their clock is not settled.
    fn settle(&mut self) {
        let is_settled = self.clock.is_settled();
        for (arrival_s, sample) in std::mem::take(&mut self.pending) {
            let time_s = sample.tick.and_then(|tick| self.clock.time_s(tick));
            if let Some(time_s) = time_s.filter(|_| is_settled) {
                self.keep(time_s.min(arrival_s), sample);
            }
        }
    }

    fn keep(&mut self, time_s: f64, sample: ReferenceSample) {
        self.newest_s = self.newest_s.max(time_s);
        let at = self.samples.partition_point(|of| of.time_s <= time_s);
        self.samples.insert(at, TimedSample { time_s, sample });
    }

    fn period(&self) -> f64 {
        let last = self.samples.len().saturating_sub(64);
        let times: Vec<f64> = self.samples.range(last..).map(|of| of.time_s).collect();
        let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        if steps.is_empty() {
            return self.period_s;
        }
        let middle = steps.len() / 2;
        *steps.select_nth_unstable_by(middle, f64::total_cmp).1
    }

    pub(crate) fn see(&mut self, frames: &[BoardFrame], now_s: f64) {
        let restart = frames.iter().rev().find(|frame| frame.restarted);
        if let Some(first) = restart.or(frames.first().filter(|_| self.board.is_empty())) {
            self.board.push_back((first.time_us, ArrivalClock::known(1.0, BOARD_CLOCK)));
            if self.board.len() > 8 {
                self.board.pop_front();
            }
        }
        if let (Some(frame), Some((_, clock))) = (frames.last(), self.board.back_mut()) {
            clock.push(frame.time_us as f64 / 1e6, now_s, BOARD_JUMP_S);
        }
    }

    fn clock_at(&self, time_us: i64) -> Option<&ArrivalClock> {
        let of = self.board.iter().rev().find(|(from, _)| *from <= time_us);
        of.or(self.board.front()).map(|(_, clock)| clock)
    }

    fn frame_s(&self, frame: &BoardFrame) -> Option<f64> {
        let clock = self.clock_at(frame.time_us).filter(|clock| clock.is_settled())?;
        clock.time_s(frame.time_us as f64 / 1e6)
    }

    /// Returns how many leading frames are due: reached by the reference, or held long enough.
    pub(crate) fn due(&self, frames: &[BoardFrame], now_s: f64) -> usize {
        let waits = |frame: &BoardFrame| match self.frame_s(frame) {
            Some(time_s) => time_s > self.newest_s && now_s - time_s < PATIENCE_S,
            None => {
                let is_newest = self.board.back().is_none_or(|(from, _)| *from <= frame.time_us);
                is_newest && frames.len() < 4096
            }
        };
        frames.iter().position(waits).unwrap_or(frames.len())
    }

    /// Returns the reference's values for a frame; `None` if no sample is close.
    pub(crate) fn beside(&mut self, frame: &BoardFrame) -> Option<BesideRow> {
        let found = self.nearest(frame);
        self.rows_without += u64::from(found.as_ref().is_none_or(|row| row.wrench.is_none()));
        found
    }

    fn nearest(&mut self, frame: &BoardFrame) -> Option<BesideRow> {
        let frame_s = self.frame_s(frame)?;
        let after = self.samples.partition_point(|of| of.time_s < frame_s);
        let around = [after.checked_sub(1), Some(after)].into_iter().flatten();
        let distance = |of: &&TimedSample| (of.time_s - frame_s).abs();
        let (at, nearest) = around
            .filter_map(|at| Some((at, self.samples.get(at)?)))
            .min_by(|(_, a), (_, b)| distance(a).total_cmp(&distance(b)))?;
        if distance(&nearest) > 0.75 * self.period_s + 1e-3 {
            return None;
        }
        // Missing samples are counted only now, after late ones have arrived.
        let number = nearest.sample.number;
        let last = self.last.unwrap_or(number);
        let here = self.samples.range(..=at).rev().map(|of| of.sample.number);
        let here = here.take_while(|it| *it > last).filter(|it| *it <= number).count() as u64;
        let missing = u64::try_from(number - last).unwrap_or(0).saturating_sub(here);
        self.last = Some(last.max(number));
        Some(BesideRow {
            wrench: nearest.sample.wrench,
            number: nearest.sample.number,
            missing,
            status: nearest.sample.status,
            time_us: frame.time_us + ((nearest.time_s - frame_s) * 1e6).round() as i64,
            error_us: (self.error_s() * 1e6).round() as i64,
        })
    }

    fn error_s(&self) -> f64 {
        let board = self.board.back().map_or(0.0, |(_, clock)| clock.error_s());
        // Without a settled clock, a sample may have been under way for one period.
        let own = if self.clock.is_settled() { self.clock.error_s() } else { self.period_s };
        board + own
    }

    pub(crate) fn recorded(&self) -> RecordedReference {
        let ReferenceState { counts, problem } = lock(&self.input.state).clone();
        RecordedReference {
            source: self.input.name.clone(),
            counts,
            rows_without: self.rows_without,
            clock_error_s: self.error_s(),
            problem,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;
    use std::time::Duration;

    use super::*;

    /// A reference at 1 kHz, sometimes read late, and a board at 100 Hz whose clock drifts.
    #[test]
    fn every_row_has_the_sample_of_its_time() {
        let (sender, samples) = channel();
        let input = ReferenceInput {
            name: "scripted".to_owned(),
            axes: Axes::ALL,
            samples,
            state: Arc::default(),
            stop: Arc::default(),
        };
        let epoch = Instant::now();
        let mut beside = ReferenceBeside::new(input, epoch);
        let mut rows = 0;
        for ms in 0..20_000_u64 {
            let now_s = ms as f64 / 1e3;
            // Every second, the samples of 30 ms are read late, all at once.
            let read_at = if ms % 1000 < 30 { ms - ms % 1000 + 30 } else { ms };
            let sample = ReferenceSample {
                number: ms as i64,
                tick: Some(ms as f64),
                restarted: false,
                arrival: epoch + Duration::from_micros(read_at * 1000 + 100 * (ms * 7919 % 5)),
                wrench: Some([now_s; 6]),
                status: 0,
                missing: 0,
            };
            if !(5000..5100).contains(&ms) {
                sender.send(sample).unwrap();
            }
            if ms % 10 != 5 {
                continue;
            }
            beside.listen();
            // The board was started 7 s earlier, and its clock is 100 ppm fast.
            let time_us = ((7.0 + now_s) * 1e6 * 1.0001).round() as i64;
            let frame = BoardFrame { time_us, index: ms as i64 / 10, ..BoardFrame::default() };
            beside.see(std::slice::from_ref(&frame), now_s + 3e-4);
            if beside.due(std::slice::from_ref(&frame), now_s + 2.0) == 0 {
                continue;
            }
            match beside.beside(&frame) {
                Some(row) => {
                    rows += 1;
                    // In a pause the newest sample may be 1 ms old.
                    let own_s = row.wrench.unwrap()[0];
                    assert!((own_s - now_s).abs() <= 1e-3 + 1e-9, "{own_s} at {now_s}");
                    let on_board = (row.time_us - time_us) as f64 / 1e6;
                    assert!((on_board - (own_s - now_s)).abs() < 1e-3, "{on_board} at {now_s}");
                    assert!(row.error_us < 1000, "{}", row.error_us);
                }
                None => assert!(ms < 700 || (5000..5100).contains(&ms), "none at {ms}"),
            }
        }
        assert!(rows > 1900, "{rows} rows");
        assert!((10..80).contains(&beside.rows_without), "{}", beside.rows_without);
    }
}
