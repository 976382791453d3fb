//! One frame: ambient and lit light of every channel.
//!
//! Ambient light adds to what the emitter sends back, so each channel is converted with its
//! emitter off and then on, and the difference of the two means is the reading. An emitter is lit
//! only while its own channel is converted: neighbours do not see it, and it stays cool.

use crate::board::{Clock, FrontEnd};
use crate::settings::Settings;
use shared_proto::{CHANNELS, COUNTS_PER_LSB};

/// Most conversions for one value.
pub const MAX_CONVERSIONS: u8 = 64;

/// Largest code of the 12-bit converter.
pub const FULL_SCALE: u16 = (1 << 12) - 1;

/// Allowance per channel for starting two bursts and waking up four times, in µs.
const OVERHEAD_US: u32 = 30;

/// Eight readings at one time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Readings in counts, [`COUNTS_PER_LSB`] to a step of the converter.
    pub readings: [u16; CHANNELS],
    /// Bit i is set if channel i was at an end of the converter's range.
    pub saturated: u8,
}

/// Takes a frame. The emitters are off before and after.
pub async fn acquire<F: FrontEnd, C: Clock>(
    front_end: &mut F,
    clock: &C,
    settings: &Settings,
) -> Frame {
    let conversions = usize::from(settings.conversions.clamp(1, MAX_CONVERSIONS));
    let (mut dark, mut lit) = ([0; MAX_CONVERSIONS as usize], [0; MAX_CONVERSIONS as usize]);
    let (dark, lit) = (&mut dark[..conversions], &mut lit[..conversions]);
    let mut frame = Frame { readings: [0; CHANNELS], saturated: 0 };
    for (channel, reading) in frame.readings.iter_mut().enumerate() {
        // The emitter of the channel before has just gone out.
        if channel > 0 {
            settle(clock, settings).await;
        }
        front_end.convert(channel, dark).await;
        front_end.light(Some(channel));
        settle(clock, settings).await;
        front_end.convert(channel, lit).await;
        front_end.light(None);
        let (dark, lit) = (Burst::of(dark), Burst::of(lit));
        *reading = difference(dark, lit, conversions as u32);
        frame.saturated |= u8::from(is_saturated(dark, lit)) << channel;
    }
    frame
}

async fn settle<C: Clock>(clock: &C, settings: &Settings) {
    clock.wait_until_us(clock.now_us() + u64::from(settings.settling_us)).await;
}

/// What there is to know of some conversions one after the other, found in one pass.
#[derive(Clone, Copy, Debug)]
struct Burst {
    /// At most 64 codes of 12 bits.
    sum: u32,
    largest: u16,
}

impl Burst {
    fn of(codes: &[u16]) -> Self {
        codes.iter().fold(Self { sum: 0, largest: 0 }, |burst, &code| Self {
            sum: burst.sum + u32::from(code),
            largest: burst.largest.max(code),
        })
    }
}

/// Mean lit code less mean dark code, in counts, rounded; zero if it is darker with light.
fn difference(dark: Burst, lit: Burst, conversions: u32) -> u16 {
    let counts = lit.sum.saturating_sub(dark.sum) * u32::from(COUNTS_PER_LSB);
    // At most 4095 steps of 16 counts, which fit; there is at least one conversion.
    ((counts + conversions / 2) / conversions.max(1)) as u16
}

/// A code at full scale may stand for more light; none at all with the emitter on is no reading.
fn is_saturated(dark: Burst, lit: Burst) -> bool {
    dark.largest.max(lit.largest) >= FULL_SCALE || lit.largest == 0
}

/// Longest time that a frame with these settings takes, in µs.
pub fn duration_us(settings: &Settings, conversion_ns: u32) -> u32 {
    let conversions_us = (u32::from(settings.conversions) * conversion_ns).div_ceil(1000);
    CHANNELS as u32 * (2 * (u32::from(settings.settling_us) + conversions_us) + OVERHEAD_US)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn difference(dark: &[u16], lit: &[u16]) -> u16 {
        super::difference(Burst::of(dark), Burst::of(lit), lit.len() as u32)
    }

    fn is_saturated(dark: &[u16], lit: &[u16]) -> bool {
        super::is_saturated(Burst::of(dark), Burst::of(lit))
    }

    #[test]
    fn readings_are_differences_of_means_in_sixteenths_of_a_step() {
        assert_eq!(difference(&[100], &[2100]), 32_000);
        assert_eq!(difference(&[100, 101, 100, 101], &[2100, 2101, 2101, 2101]), 32_004);
        assert_eq!(difference(&[0; 3], &[1, 0, 0]), 5);
        assert_eq!(difference(&[0; 64], &[FULL_SCALE; 64]), 65_520);
    }

    #[test]
    fn a_channel_that_light_makes_darker_reads_zero() {
        assert_eq!(difference(&[500, 500], &[499, 500]), 0);
    }

    #[test]
    fn either_end_of_the_range_saturates() {
        assert!(!is_saturated(&[0, 0], &[0, 1]));
        assert!(is_saturated(&[0, 0], &[0, 0]));
        assert!(is_saturated(&[0, 0], &[4094, 4095]));
        assert!(is_saturated(&[4095, 0], &[1, 1]));
        assert!(!is_saturated(&[4094], &[4094]));
    }

    #[test]
    fn a_frame_takes_two_settlings_and_two_bursts_per_channel() {
        let settings = Settings { conversions: 16, settling_us: 50, ..Settings::DEFAULT };
        assert_eq!(duration_us(&settings, 1_500), 8 * (2 * (50 + 24) + 30));
    }
}
