//! The position of a frame in its board's stream: number and time without the wraps.
//!
//! A sequence number wraps after 65,536 frames, the board's clock after 71.6 min. A frame *follows*
//! another if number and clock have advanced consistently. Otherwise it is held until the next
//! arrives. If that follows the held frame, there was a silence or a restart; if not, the held
//! frame was damage that passed the CRC. The length of a silence is:
//!
//! ```text
//! elapsed = step of the clock + k · 2³² µs        k from the host's time
//! sent    = step of the number + m · 2¹⁶          m from elapsed / period − dropped frames
//! ```
//!
//! Without the host's time, as in a replay, k is assumed to be 0. The start number in the packets
//! shows a restart. In version 2 of the protocol, without it, a clock or number that goes back
//! means a restart, unless the host's time shows a wrap.

use super::sequence::{Arrival, Tracker, WINDOW};

/// Longest silence, in frames, whose length follows from number and clock alone.
const SHORT: u64 = 1 << 14;

/// Tolerance between the host's and the board's time, in addition to one part in 64.
const HOST_SLACK_US: u64 = 2_000_000;

const TURN_US: u64 = 1 << 32;

const NUMBERS: u64 = 1 << 16;

/// Longer than any period that a board can be set to.
const LONGEST_PERIOD_US: u64 = 11_000_000;

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Stamp {
    pub(super) sequence: u16,
    pub(super) clock_us: u32,
    pub(super) dropped: u8,
    pub(super) start: Option<u16>,
    pub(super) host_us: Option<u64>,
}

#[derive(Clone, Copy, Debug)]
struct FrameStep {
    sequence: u16,
    clock_us: u32,
    dropped: u8,
    is_new_run: Option<bool>,
    host_us: Option<u64>,
}

impl Stamp {
    fn step_to(&self, next: &Self) -> FrameStep {
        FrameStep {
            sequence: next.sequence.wrapping_sub(self.sequence),
            clock_us: next.clock_us.wrapping_sub(self.clock_us),
            dropped: next.dropped.wrapping_sub(self.dropped),
            is_new_run: self.start.zip(next.start).map(|(before, now)| before != now),
            host_us: next.host_us.zip(self.host_us).map(|(now, then)| now.saturating_sub(then)),
        }
    }

    pub(super) fn precedes(&self, next: &Self) -> bool {
        Period::default().fits(&self.step_to(next))
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct FramePosition {
    pub(super) index: i64,
    /// The board's time since its first observed start, µs.
    pub(super) time_us: i64,
    pub(super) arrival: Arrival,
    pub(super) restarted: bool,
}

#[derive(Clone, Debug, Default)]
pub(super) struct Timeline {
    pub(super) tracker: Tracker,
    newest: Option<(Stamp, i64)>,
    period: Period,
    pub(super) uncertain: u64,
    /// True if the board has announced a start, and no frame has followed yet.
    has_booted: bool,
}

impl Timeline {
    pub(super) fn is_followed_by(&self, next: &Stamp) -> bool {
        self.newest.is_some_and(|(newest, _)| {
            let is_new_run = self.has_booted && newest.start.is_none();
            !is_new_run && self.period.fits(&newest.step_to(next))
        })
    }

    /// Returns true if the clock has advanced, the only possible check of the original board.
    pub(super) fn is_forward(&self, next: &Stamp) -> bool {
        self.newest.is_none_or(|(newest, _)| newest.step_to(next).clock_us.cast_signed() >= 0)
    }

    pub(super) fn has_begun(&self) -> bool {
        self.newest.is_some()
    }

    pub(super) fn boot(&mut self) {
        self.has_booted = self.newest.is_some();
    }

    /// Positions a frame that follows the others, before or after the newest: frames may be out of order.
    pub(super) fn follow(&mut self, stamp: Stamp) -> FramePosition {
        let (index, arrival) = self.tracker.position(stamp.sequence);
        let time_us = self.newest.map_or(i64::from(stamp.clock_us), |(newest, newest_us)| {
            newest_us + i64::from(newest.step_to(&stamp).clock_us.cast_signed())
        });
        if arrival == Arrival::InOrder {
            if let Some((newest, _)) = self.newest {
                self.period.observe(&newest.step_to(&stamp));
            }
            self.newest = Some((stamp, time_us));
        }
        FramePosition { index, time_us, arrival, restarted: false }
    }

    /// Positions a frame that does not follow the previous ones, but is followed by another.
    pub(super) fn jump(&mut self, stamp: Stamp) -> FramePosition {
        let Some((newest, newest_us)) = self.newest else { return self.follow(stamp) };
        let step = newest.step_to(&stamp);
        if self.has_booted || is_restart(&step) {
            return self.restart(stamp, newest_us, step.host_us);
        }
        let elapsed_us = elapsed(&step);
        let sent = self.period.sent(&step, elapsed_us);
        // Number and clock disagree if the board has paused, or has another rate.
        let is_next = (1..16).contains(&step.sequence);
        self.uncertain += u64::from(sent.is_none() && !is_next);
        let sent = sent.unwrap_or_else(|| u64::from(step.sequence.max(1)));
        let (index, arrival) = self.tracker.advance(sent);
        let time_us = newest_us.saturating_add_unsigned(elapsed_us);
        self.newest = Some((stamp, time_us));
        FramePosition { index, time_us, arrival, restarted: false }
    }

    /// Positions the first frame after a restart. The board was off for the time that the host
    /// measured, at least for the time since its start.
    fn restart(&mut self, stamp: Stamp, newest_us: i64, host_us: Option<u64>) -> FramePosition {
        let gap_us = host_us.unwrap_or(0).max(u64::from(stamp.clock_us));
        let lost = host_us.map_or(0, |_| self.period.count(gap_us).saturating_sub(1));
        let is_known = host_us.is_some() && self.period.samples > 0;
        self.uncertain += u64::from(!is_known && !self.has_booted);
        self.tracker.restart(lost);
        let (index, arrival) = self.tracker.position(stamp.sequence);
        let time_us = newest_us.saturating_add_unsigned(gap_us);
        self.newest = Some((stamp, time_us));
        (self.period, self.has_booted) = (Period::default(), false);
        FramePosition { index, time_us, arrival, restarted: true }
    }
}

fn is_restart(step: &FrameStep) -> bool {
    let is_back = step.clock_us.cast_signed() <= 0;
    let is_soon = step.host_us.is_some_and(|host_us| host_us < TURN_US / 2);
    match step.is_new_run {
        Some(true) => true,
        // Two runs have the same start number with a probability of one in 65,536.
        Some(false) => is_soon && is_back,
        None => {
            let went_on = !is_back && step.sequence.cast_signed() > 0;
            let agrees =
                |host_us: u64| elapsed(step).abs_diff(host_us) <= HOST_SLACK_US + host_us / 64;
            match step.host_us {
                None => !went_on,
                Some(host_us) => !(agrees(host_us) || went_on && is_soon),
            }
        }
    }
}

fn elapsed(step: &FrameStep) -> u64 {
    let clock_us = u64::from(step.clock_us);
    let turns = step.host_us.map_or(0, |us| (us + TURN_US / 2).saturating_sub(clock_us) / TURN_US);
    clock_us + turns * TURN_US
}

#[derive(Clone, Copy, Debug, Default)]
struct Period {
    samples: u64,
    span_us: u64,
}

impl Period {
    fn observe(&mut self, step: &FrameStep) {
        /// More samples do not make the mean more accurate.
        const ENOUGH: u64 = 1 << 20;
        let (samples, span_us) = (u64::from(step.sequence), u64::from(step.clock_us));
        if samples == 0 || step.dropped != 0 {
            return;
        }
        // The rate has changed by more than an eighth: forget earlier steps.
        let expected = self.span_us.saturating_mul(samples);
        if (span_us * self.samples).abs_diff(expected) > expected / 8 {
            *self = Self::default();
        }
        self.samples += samples;
        self.span_us += span_us;
        if self.samples > ENOUGH {
            self.samples /= 2;
            self.span_us /= 2;
        }
    }

    /// Returns true if number and clock of a step agree: forwards, or back to a late frame.
    fn fits(&self, step: &FrameStep) -> bool {
        let mut frames = i64::from(step.sequence.cast_signed());
        let mut us = i64::from(step.clock_us.cast_signed());
        let mut dropped = step.dropped;
        if frames <= 0 {
            (frames, us, dropped) = (-frames, -us, dropped.wrapping_neg());
            if frames >= i64::from(WINDOW) {
                return false;
            }
        }
        let is_recent = step.host_us.is_none_or(|host_us| host_us < TURN_US / 2);
        let (Ok(frames), Ok(us), true) = (u64::try_from(frames), u64::try_from(us), is_recent)
        else {
            return false;
        };
        let with_dropped = frames + u64::from(dropped);
        let is_in_step = match self.span_us.checked_div(self.samples) {
            None => us <= (with_dropped + 1) * LONGEST_PERIOD_US,
            Some(period_us) => {
                let least = (frames * period_us / 8 * 7).saturating_sub(period_us);
                (least..=with_dropped * period_us / 8 * 9 + period_us).contains(&us)
            }
        };
        frames < SHORT && step.is_new_run != Some(true) && is_in_step
    }

    fn count(&self, us: u64) -> u64 {
        let periods = us.saturating_mul(self.samples).saturating_add(self.span_us / 2);
        periods.checked_div(self.span_us).unwrap_or(0)
    }

    fn slack(&self, us: u64) -> u64 {
        // A frame may start a sixteenth of a period late.
        2 + self.count(us) / (16 * self.samples.max(1))
    }

    /// Returns the number of frames sent in a time: the step of the sequence number plus wraps. `None` if none fits.
    fn sent(&self, step: &FrameStep, elapsed_us: u64) -> Option<u64> {
        let (expected, slack) = (self.count(elapsed_us), self.slack(elapsed_us));
        if slack >= SHORT {
            return None;
        }
        let most = expected + slack;
        let sequence = u64::from(step.sequence);
        let sent = most.checked_sub((most.checked_sub(sequence)?) % NUMBERS)?;
        // The board counts dropped frames modulo 256.
        let unsent = most - sent;
        let dropped = unsent.wrapping_sub(u64::from(step.dropped)) % 256;
        let fits = unsent <= 2 * slack + 256 && dropped <= 2 * slack;
        (sent > 0 && fits).then_some(sent)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stamp(sequence: u16, clock_us: u32, start: u16, host_us: Option<u64>) -> Stamp {
        Stamp { sequence, clock_us, dropped: 0, start: Some(start), host_us }
    }

    fn after_a_second() -> Timeline {
        let mut timeline = Timeline::default();
        for frame in 0..100 {
            let stamp = stamp(frame, u32::from(frame) * 10_000, 1, Some(u64::from(frame) * 10_000));
            assert_eq!(timeline.is_followed_by(&stamp), frame > 0);
            timeline.follow(stamp);
        }
        timeline
    }

    #[test]
    fn a_paused_host_is_not_a_restart() {
        let mut timeline = after_a_second();
        // 15 s later, frames buffered by the system arrive before the current ones.
        let stale = stamp(100, 1_000_000, 1, Some(16_000_000));
        assert!(timeline.is_followed_by(&stale));
        assert_eq!(timeline.follow(stale).time_us, 1_000_000);
        let now = stamp(1_600, 16_000_000, 1, Some(16_000_100));
        assert!(timeline.is_followed_by(&now));
        let placed = timeline.follow(now);
        assert_eq!((placed.time_us, placed.restarted), (16_000_000, false));
        assert_eq!((timeline.tracker.missing(), timeline.tracker.restarts), (1_499, 0));
    }

    #[test]
    fn the_clock_unwraps_both_ways() {
        let mut timeline = Timeline::default();
        let mut time =
            |sequence, clock_us| timeline.follow(stamp(sequence, clock_us, 1, None)).time_us;
        assert_eq!(time(5, u32::MAX - 9), 4_294_967_286);
        assert_eq!(time(7, 10), 4_294_967_306);
        assert_eq!(time(6, u32::MAX), 4_294_967_295);
        assert_eq!(time(8, 20), 4_294_967_316);
    }

    #[test]
    fn the_time_that_a_board_was_off_is_counted() {
        let mut timeline = after_a_second();
        let first = stamp(0, 4_000, 2, Some(3_990_000));
        assert!(!timeline.is_followed_by(&first));
        let placed = timeline.jump(first);
        assert_eq!((placed.index, placed.time_us, placed.restarted), (399, 3_990_000, true));
        assert_eq!((timeline.tracker.missing(), timeline.uncertain), (299, 0));
    }

    #[test]
    fn frames_out_of_step_are_found_by_number_clock_or_start() {
        let timeline = after_a_second();
        let step = |sequence, clock_us, start| {
            timeline.is_followed_by(&stamp(sequence, clock_us, start, Some(1_000_000)))
        };
        assert!(step(100, 1_000_000, 1) && step(99, 990_000, 1) && step(90, 900_000, 1));
        assert!(!step(100, 1_000_000, 2));
        assert!(!step(100, 36_400_000, 1));
        assert!(!step(4_196, 1_000_000, 1));
        assert!(!step(100, 1 << 31, 1));
    }
}
