//! Acquisition of one frame (ambient and lit light of every channel), and the schedule of frames.
//!
//! Each channel is converted with its emitter off, on and off again. The reading is the lit mean
//! minus the mean of both dark values: linear drift of ambient light cancels, and ambient light of
//! amplitude A that flickers at frequency f leaves at most this error:
//!
//! ```text
//! A · (1 − cos 2πfΔ)    Δ = settling + conversions of one mean
//! ```
//!
//! An emitter is lit only for its own channel: neighbours do not see it, and it stays cool.

use crate::board::{Clock, FrontEnd};
use core::num::{NonZeroU32, NonZeroU64};
use shared_proto::{CHANNELS, COUNTS_PER_LSB, Stream, Timing};

pub const MAX_CONVERSIONS: u8 = 64;

pub const FULL_SCALE: u16 = (1 << 12) - 1;

/// Distance to full scale, in steps, within which a mean counts as clipped: some of its conversions
/// may have been. With noise of 1.5 steps (an effective 9.6 bits; the data sheet promises more than
/// ten), any lower mean is less than a tenth of a step too small: E max(0, x − 4095) for x normal
/// about 4093.
const CLIPPED_STEPS: u16 = 2;

/// Switching, starting and waking up, per channel.
const OVERHEAD_US: u32 = 30;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    pub stream: Stream,
    pub period_us: u32,
    /// Conversions averaged for each lit and each dark value.
    pub conversions: u8,
    /// Time from switching an emitter to converting, µs.
    pub settling_us: u16,
}

impl Settings {
    /// Settings after a reset: 100 Hz, means of 8 conversions (one burst of the converter), 100 µs
    /// to settle, the longest response time in Sharp's data sheets of such photointerrupters into
    /// 1 kΩ (GP1S560: 90 and 100 µs). A longer one lets more flicker through (docs/board.md).
    pub const DEFAULT: Self =
        Self { stream: Stream::Raw, period_us: 10_000, conversions: 8, settling_us: 100 };
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Frame {
    /// Readings in counts, [`COUNTS_PER_LSB`] per step of the converter.
    pub readings: [u16; CHANNELS],
    /// Bit i is set if channel i was at an end of the converter's range.
    pub saturated: u8,
    /// Dark values (emitters off), in counts.
    pub dark: [u16; CHANNELS],
    pub timing: Timing,
}

/// Takes a frame; conversions take `conversion_ns` each. The emitters are off before and after.
pub async fn acquire<F: FrontEnd, C: Clock>(
    front_end: &mut F,
    clock: &C,
    settings: &Settings,
    conversion_ns: u32,
) -> Frame {
    let conversions = settings.conversions.clamp(1, MAX_CONVERSIONS);
    let settling_us = settings.settling_us;
    let mut frame = Frame::default();
    let start_us = clock.now_us();
    // From the middle of the lit conversions to the end of the second dark ones.
    let burst_us = (u32::from(conversions) * conversion_ns).div_ceil(1000);
    let ago_us = u64::from(u32::from(settling_us) + burst_us + burst_us / 2);
    let (mut first_us, mut last_us) = (start_us, start_us);
    let readings = frame.readings.iter_mut().zip(&mut frame.dark).enumerate();
    for (channel, (reading, dark_reading)) in readings {
        let sums = front_end.expose(settling_us, channel, conversions).await;
        let [before, lit, after] = sums;
        last_us = clock.now_us().saturating_sub(ago_us);
        if channel == 0 {
            first_us = last_us;
        }
        *reading = difference(before + after, 2 * lit, conversions);
        *dark_reading = difference(0, before + after, conversions);
        frame.saturated |= u8::from(is_saturated(before.max(after), lit, conversions)) << channel;
    }
    frame.timing = timing(start_us, first_us, last_us);
    frame
}

fn timing(start_us: u64, first_us: u64, last_us: u64) -> Timing {
    let steps = CHANNELS as u64 - 1;
    let fit = |us: u64| u16::try_from(us).unwrap_or(u16::MAX);
    Timing {
        first_us: fit(first_us.saturating_sub(start_us)),
        step_us: fit((last_us.saturating_sub(first_us) + steps / 2) / steps),
    }
}

/// Returns mean lit minus mean dark code in counts, at least 0. Each sum has twice `conversions` codes.
fn difference(dark: u32, lit: u32, conversions: u8) -> u16 {
    let conversions = 2 * u32::from(conversions);
    let counts = lit.saturating_sub(dark) * u32::from(COUNTS_PER_LSB);
    // At most 4095 steps of 16 counts, which fit in 16 bits; `conversions` is at least one.
    ((counts + conversions / 2) / conversions.max(1)) as u16
}

/// A mean at full scale may be clipped; a lit mean of zero is no valid reading.
fn is_saturated(dark: u32, lit: u32, conversions: u8) -> bool {
    dark.max(lit) >= u32::from(FULL_SCALE - CLIPPED_STEPS) * u32::from(conversions) || lit == 0
}

/// Lights one emitter and measures each channel's rise, in steps. Begins and ends with all off.
pub async fn illuminate<F: FrontEnd>(
    front_end: &mut F,
    settings: &Settings,
    emitter: usize,
) -> [i16; CHANNELS] {
    let conversions = settings.conversions.clamp(1, MAX_CONVERSIONS);
    let settling_us = settings.settling_us;
    let mut rise = [0; CHANNELS];
    for (channel, rise) in rise.iter_mut().enumerate() {
        let dark = front_end.sum(settling_us, channel, conversions).await;
        front_end.light(Some(emitter));
        let lit = front_end.sum(settling_us, channel, conversions).await;
        front_end.light(None);
        // At most 4,095 steps in either direction; `conversions` is at least one.
        let steps = (lit.cast_signed() - dark.cast_signed()) / i32::from(conversions).max(1);
        *rise = steps as i16;
    }
    rise
}

pub fn duration_us(settings: &Settings, conversion_ns: u32) -> u32 {
    let conversions_us = (u32::from(settings.conversions) * conversion_ns).div_ceil(1000);
    CHANNELS as u32 * (2 * u32::from(settings.settling_us) + 3 * conversions_us + OVERHEAD_US)
}

/// Maximum delay of a frame, µs: a hundredth of the 10 ms period. Later slots are skipped.
const TOLERANCE_US: u64 = 100;

/// Slots at fixed distances from the first, so that delays do not add up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Schedule {
    next_us: u64,
    period_us: NonZeroU32,
}

impl Schedule {
    /// `period_us` is at least 1.
    pub(crate) fn new(first_us: u64, period_us: u32) -> Self {
        let period_us = NonZeroU32::new(period_us).unwrap_or(NonZeroU32::MIN);
        Self { next_us: first_us, period_us }
    }

    /// Returns the time of the next slot that can be met, and the number of slots skipped.
    pub(crate) fn next(&mut self, now_us: u64) -> (u64, u32) {
        let latest_us = self.next_us.saturating_add(TOLERANCE_US);
        let late_us = now_us.saturating_sub(latest_us);
        if late_us == 0 {
            return (self.next_us, 0); // the usual case, which needs no 64-bit division
        }
        let period_us = NonZeroU64::from(self.period_us);
        let skipped = late_us.div_ceil(period_us.get());
        self.next_us = self.next_us.saturating_add(skipped * period_us.get());
        (self.next_us, u32::try_from(skipped).unwrap_or(u32::MAX))
    }

    pub(crate) fn advance(&mut self) {
        self.next_us = self.next_us.saturating_add(u64::from(self.period_us.get()));
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use proptest::prelude::*;

    #[test]
    fn readings_are_differences_of_means_in_sixteenths_of_a_step() {
        assert_eq!(difference(200, 4_200, 1), 32_000);
        assert_eq!(difference(804, 16_806, 4), 32_004);
        assert_eq!(difference(201, 4_200, 1), 31_992);
        assert_eq!(difference(0, 2, 3), 5);
        assert_eq!(difference(0, 2 * 64 * u32::from(FULL_SCALE), 64), 65_520);
    }

    #[test]
    fn a_channel_that_light_makes_darker_reads_zero() {
        assert_eq!(difference(1_000, 999, 2), 0);
    }

    #[test]
    fn either_end_of_the_range_saturates() {
        assert!(!is_saturated(0, 1, 2));
        assert!(is_saturated(0, 0, 2));
        assert!(is_saturated(0, 4_093 * 2, 2));
        assert!(!is_saturated(0, 4_093 * 2 - 1, 2));
        assert!(is_saturated(4_095 * 2, 2, 2));
        assert!(!is_saturated(4_092, 4_092, 1));
    }

    #[test]
    fn a_frame_takes_two_settlings_and_three_bursts_per_channel() {
        let settings = Settings { conversions: 16, settling_us: 50, ..Settings::DEFAULT };
        assert_eq!(duration_us(&settings, 1_500), 8 * (2 * 50 + 3 * 24 + 30));
    }

    #[test]
    fn slots_do_not_drift_with_the_time_that_frames_take() {
        let mut schedule = Schedule::new(1_000, 10_000);
        for slot in 0..1_000_000 {
            let at = 1_000 + slot * 10_000;
            assert_eq!(schedule.next(at + slot % 100), (at, 0));
            schedule.advance();
        }
    }

    #[test]
    fn slots_that_have_passed_are_skipped_and_counted() {
        let mut schedule = Schedule::new(0, 10_000);
        schedule.advance();
        assert_eq!(schedule.next(10_100), (10_000, 0));
        assert_eq!(schedule.next(10_101), (20_000, 1));
        assert_eq!(schedule.next(54_321), (60_000, 4));
        schedule.advance();
        assert_eq!(schedule.next(60_500), (70_000, 0));
    }

    proptest! {
        #[test]
        fn every_slot_is_used_or_skipped_once(
            period_us in 1..20_000_u32,
            frames in prop::collection::vec(0..60_000_u64, 1..200),
        ) {
            let mut schedule = Schedule::new(7, period_us);
            let (mut now, mut slots) = (0, 0_u64);
            for frame_us in frames {
                let (at, skipped) = schedule.next(now);
                slots += u64::from(skipped);
                prop_assert_eq!(at, 7 + slots * u64::from(period_us));
                prop_assert!(now <= at + 100);
                slots += 1;
                schedule.advance();
                now = now.max(at) + frame_us;
            }
        }
    }
}
