//! A board's identity, and the settings that it can sustain.

use crate::acquisition::{self, MAX_CONVERSIONS, Settings};
use crate::baud::Baud;
use crate::last_words::LastWords;
use shared_proto::{Identity, READINGS_FRAME, Refusal, ResetCause, Stream, WRENCH_FRAME};

#[derive(Clone, Debug)]
pub struct BoardSetup {
    pub identity: Identity,
    pub start: u16,
    pub reset_cause: ResetCause,
    pub last_words: LastWords,
    /// Rounded up, so that the limits sent to the host fit into a period.
    pub conversion_ns: u32,
    /// The line's rate; `None` if it has none and is never the bottleneck.
    pub rate: Option<Baud>,
    pub rates: &'static [Baud],
    pub has_bootloader: bool,
}

/// Share of the line for samples: answers need room, and the ends' clocks differ by some 2 %.
const SHARE_PERCENT: u64 = 95;

const MAX_PERIOD_US: u32 = 10_000_000;

const MAX_SETTLING_US: u16 = 10_000;

impl BoardSetup {
    pub(crate) fn check(&self, settings: &Settings, rate: Option<Baud>) -> Result<(), Refusal> {
        let min_period_us = self.identity.min_period_us;
        let in_range = (min_period_us..=MAX_PERIOD_US).contains(&settings.period_us)
            && (1..=MAX_CONVERSIONS).contains(&settings.conversions)
            && settings.settling_us <= MAX_SETTLING_US;
        if !in_range {
            return Err(Refusal::OutOfRange);
        }
        let frame_us = acquisition::duration_us(settings, self.conversion_ns);
        let sample_us = rate.map_or(0, |rate| sample_us(settings.stream, rate));
        let shortest_us = frame_us.max(sample_us).max(min_period_us);
        if frame_us > settings.period_us {
            Err(Refusal::PeriodTooShort { shortest_us })
        } else if sample_us > settings.period_us {
            Err(Refusal::LineTooSlow { shortest_us })
        } else {
            Ok(())
        }
    }
}

/// Returns the time of a sample on a line, µs, with room for other packets.
fn sample_us(stream: Stream, rate: Baud) -> u32 {
    let bytes = match stream {
        Stream::Wrench => WRENCH_FRAME as u64,
        _ => READINGS_FRAME as u64,
    };
    let us =
        (bytes * 100 * 1_000_000).div_ceil(u64::from(rate.bytes_per_s().max(1)) * SHARE_PERCENT);
    u32::try_from(us).unwrap_or(u32::MAX)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use shared_proto::Board;

    const RATE: Baud = Baud { name: 57_600, divider: 0, actual: 57_600 };

    pub(crate) fn setup(min_period_us: u32, conversion_ns: u32) -> BoardSetup {
        let (board, serial) = (Board::SkinProc, [7; 12]);
        BoardSetup {
            identity: Identity { board, firmware: [0; 3], serial, min_period_us },
            start: 0,
            reset_cause: ResetCause::Power,
            last_words: LastWords::new(),
            conversion_ns,
            rate: None,
            rates: &[],
            has_bootloader: false,
        }
    }

    fn settings(stream: Stream, period_us: u32) -> Settings {
        Settings { stream, period_us, conversions: 4, settling_us: 30 }
    }

    #[test]
    fn a_rate_too_high_for_the_line_is_refused_with_the_highest_possible() {
        // Bytes of a sample from the protocol's table, at 95 % of 5,760 per second.
        for (stream, bytes) in [(Stream::Raw, 34.0), (Stream::Wrench, 42.0)] {
            let shortest_us = (bytes * 1e6 / (0.95 * 5_760.0_f64)).ceil() as u32;
            let check =
                |period_us| setup(1_000, 3_250).check(&settings(stream, period_us), Some(RATE));
            assert_eq!(check(1_000), Err(Refusal::PeriodTooShort { shortest_us }));
            assert_eq!(check(2_000), Err(Refusal::LineTooSlow { shortest_us }));
            assert_eq!(check(shortest_us - 1), Err(Refusal::LineTooSlow { shortest_us }));
            assert_eq!(check(shortest_us), Ok(()));
        }
    }

    #[test]
    fn the_highest_rate_allows_for_the_longer_of_frame_and_sample() {
        let slow = Settings { settling_us: 1_000, ..settings(Stream::Raw, 6_500) };
        // 8 · (2 · 1,000 + 3 · 13 + 30)
        assert_eq!(
            setup(1_000, 3_250).check(&slow, Some(RATE)),
            Err(Refusal::PeriodTooShort { shortest_us: 16_552 })
        );
        let quick = Settings { period_us: 400, ..settings(Stream::Raw, 0) };
        // 8 · (2 · 30 + 3 · 13 + 30)
        assert_eq!(
            setup(100, 3_250).check(&quick, None),
            Err(Refusal::PeriodTooShort { shortest_us: 1_032 })
        );
    }
}
