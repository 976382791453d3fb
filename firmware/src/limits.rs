//! What settings a board can keep up with.

use crate::acquisition::{self, MAX_CONVERSIONS};
use crate::baud::Baud;
use crate::settings::Settings;
use shared_proto::{READINGS_FRAME, Refusal, Stream, WRENCH_FRAME};

/// Share of the line that samples may take, in percent: answers need room, and the clocks at its ends
/// differ by up to 2 % or so.
const SHARE_PERCENT: u64 = 95;

/// What a board can do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Limits {
    /// Shortest period in µs.
    pub(crate) min_period_us: u32,
    /// Time of a conversion in ns, rounded up.
    pub(crate) conversion_ns: u32,
    /// What the serial line carries, in bytes per second; `None` if it is never the bottleneck.
    pub(crate) bytes_per_s: Option<u32>,
    /// Rates that the line can be set to.
    pub(crate) rates: &'static [Baud],
    /// Whether the chip has a bootloader in ROM.
    pub(crate) has_bootloader: bool,
}

impl Limits {
    /// Longest period in µs.
    pub(crate) const MAX_PERIOD_US: u32 = 10_000_000;

    /// Longest settling in µs.
    pub(crate) const MAX_SETTLING_US: u16 = 10_000;

    /// The same where the line has this rate.
    pub(crate) fn with_rate(self, rate: Baud) -> Self {
        Self { bytes_per_s: Some(rate.bytes_per_s()), ..self }
    }

    /// Time that a sample takes on the line, in µs, with room for the rest.
    fn sample_us(self, stream: Stream) -> u32 {
        let Some(bytes_per_s) = self.bytes_per_s.filter(|&rate| rate > 0) else { return 0 };
        let bytes = match stream {
            Stream::Wrench => WRENCH_FRAME as u64,
            _ => READINGS_FRAME as u64,
        };
        let us = (bytes * 100 * 1_000_000).div_ceil(u64::from(bytes_per_s) * SHARE_PERCENT);
        u32::try_from(us).unwrap_or(u32::MAX)
    }

    /// Whether frames can be taken with these settings.
    ///
    /// # Errors
    /// Why not.
    pub(crate) fn check(self, settings: &Settings) -> Result<(), Refusal> {
        let in_range = (self.min_period_us..=Self::MAX_PERIOD_US).contains(&settings.period_us)
            && (1..=MAX_CONVERSIONS).contains(&settings.conversions)
            && settings.settling_us <= Self::MAX_SETTLING_US;
        if !in_range {
            return Err(Refusal::OutOfRange);
        }
        let frame_us = acquisition::duration_us(settings, self.conversion_ns);
        let sample_us = self.sample_us(settings.stream);
        let shortest_us = frame_us.max(sample_us).max(self.min_period_us);
        if frame_us > settings.period_us {
            Err(Refusal::PeriodTooShort { shortest_us })
        } else if sample_us > settings.period_us {
            Err(Refusal::LineTooSlow { shortest_us })
        } else {
            Ok(())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 57,600 baud with ten bits to a byte.
    const LIMITS: Limits = Limits {
        min_period_us: 1_000,
        conversion_ns: 3_250,
        bytes_per_s: Some(5_760),
        rates: &[],
        has_bootloader: false,
    };

    fn settings(stream: Stream, period_us: u32) -> Settings {
        Settings { stream, period_us, conversions: 4, settling_us: 30 }
    }

    #[test]
    fn a_rate_that_the_line_cannot_carry_is_refused_and_what_fits_is_said() {
        // Bytes of a sample by the protocol's table, at 95 % of 5,760 per second.
        for (stream, bytes) in [(Stream::Raw, 34.0), (Stream::Wrench, 42.0)] {
            let shortest_us = (bytes * 1e6 / (0.95 * 5_760.0_f64)).ceil() as u32;
            let check = |period_us| LIMITS.check(&settings(stream, period_us));
            assert_eq!(check(1_000), Err(Refusal::PeriodTooShort { shortest_us }));
            assert_eq!(check(2_000), Err(Refusal::LineTooSlow { shortest_us }));
            assert_eq!(check(shortest_us - 1), Err(Refusal::LineTooSlow { shortest_us }));
            assert_eq!(check(shortest_us), Ok(()));
        }
    }

    #[test]
    fn the_longer_of_frame_and_sample_is_said_to_fit() {
        let slow = Settings { settling_us: 1_000, ..settings(Stream::Raw, 6_500) };
        // 8 · (2 · 1,000 + 3 · 13 + 30)
        assert_eq!(LIMITS.check(&slow), Err(Refusal::PeriodTooShort { shortest_us: 16_552 }));
        let quick = Settings { period_us: 400, ..settings(Stream::Raw, 0) };
        let limits = Limits { min_period_us: 100, bytes_per_s: None, ..LIMITS };
        // 8 · (2 · 30 + 3 · 13 + 30)
        assert_eq!(limits.check(&quick), Err(Refusal::PeriodTooShort { shortest_us: 1_032 }));
    }
}
