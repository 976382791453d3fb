//! One frame: ambient and lit light of every channel.
//!
//! Ambient light adds to what the emitter sends back, so each channel is converted with its
//! emitter off and then on, and the difference of the two means is the reading. An emitter is lit
//! only while its own channel is converted: neighbours do not see it, and it stays cool.

use crate::board::{Clock, FrontEnd};
use crate::settings::Settings;
use shared_proto::{CHANNELS, COUNTS_PER_LSB, Timing};

/// Most conversions for one value.
pub const MAX_CONVERSIONS: u8 = 64;

/// Largest code of the 12-bit converter.
pub const FULL_SCALE: u16 = (1 << 12) - 1;

/// Allowance per channel for starting two bursts and waking up four times, in µs.
const OVERHEAD_US: u32 = 30;

/// Eight readings, one after the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Readings in counts, [`COUNTS_PER_LSB`] to a step of the converter.
    pub readings: [u16; CHANNELS],
    /// Bit i is set if channel i was at an end of the converter's range.
    pub saturated: u8,
    /// What the channels read with their emitters off, in counts.
    pub dark: [u16; CHANNELS],
    /// When the readings were taken.
    pub timing: Timing,
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
    let mut frame = Frame {
        readings: [0; CHANNELS],
        saturated: 0,
        dark: [0; CHANNELS],
        timing: Timing::default(),
    };
    let start_us = clock.now_us();
    let (mut first_us, mut last_us) = (start_us, start_us);
    let readings = frame.readings.iter_mut().zip(&mut frame.dark).enumerate();
    for (channel, (reading, dark_reading)) in readings {
        // The emitter of the channel before has just gone out.
        if channel > 0 {
            settle(clock, settings).await;
        }
        front_end.convert(channel, dark).await;
        front_end.light(Some(channel));
        settle(clock, settings).await;
        let lit_us = clock.now_us();
        front_end.convert(channel, lit).await;
        front_end.light(None);
        // The middle of the lit conversions.
        last_us = u64::midpoint(lit_us, clock.now_us());
        if channel == 0 {
            first_us = last_us;
        }
        let (dark, lit) = (Burst::of(dark), Burst::of(lit));
        *reading = difference(dark, lit, conversions as u32);
        *dark_reading = difference(Burst::NOTHING, dark, conversions as u32);
        frame.saturated |= u8::from(is_saturated(dark, lit)) << channel;
    }
    frame.timing = timing(start_us, first_us, last_us);
    frame
}

/// Timing of a frame from its start and its first and last reading.
fn timing(start_us: u64, first_us: u64, last_us: u64) -> Timing {
    let steps = CHANNELS as u64 - 1;
    let fit = |us: u64| u16::try_from(us).unwrap_or(u16::MAX);
    Timing {
        first_us: fit(first_us.saturating_sub(start_us)),
        step_us: fit((last_us.saturating_sub(first_us) + steps / 2) / steps),
    }
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
    const NOTHING: Self = Self { sum: 0, largest: 0 };

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

/// Lights one emitter and no other for each channel in turn: by how much it raises them, in steps of the
/// converter. The emitters are off before and after.
pub async fn illuminate<F: FrontEnd, C: Clock>(
    front_end: &mut F,
    clock: &C,
    settings: &Settings,
    emitter: usize,
) -> [i16; CHANNELS] {
    let conversions = usize::from(settings.conversions.clamp(1, MAX_CONVERSIONS));
    let mut codes = [0; MAX_CONVERSIONS as usize];
    let codes = &mut codes[..conversions];
    let mut rise = [0; CHANNELS];
    for (channel, rise) in rise.iter_mut().enumerate() {
        settle(clock, settings).await;
        front_end.convert(channel, codes).await;
        let dark = Burst::of(codes).sum.cast_signed();
        front_end.light(Some(emitter));
        settle(clock, settings).await;
        front_end.convert(channel, codes).await;
        front_end.light(None);
        let lit = Burst::of(codes).sum.cast_signed();
        // At most 4,095 steps either way.
        *rise = ((lit - dark) / conversions as i32) as i16;
    }
    rise
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
