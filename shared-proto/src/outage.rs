//! Long silences: how many samples were sent meanwhile, and whether the board has restarted.
//!
//! A sequence number comes round after 65,536 samples, the board's clock after 71.6 min. Where a
//! silence is longer than a quarter of the former, the numbers alone are ambiguous. What is known
//! beside them:
//!
//! ```text
//! elapsed = step of the clock + k · 2³² µs        the host's time tells k
//! sent    = step of the number + m · 2¹⁶          elapsed / period, less what was dropped, tells m
//! ```
//!
//! Both must agree, or the board has restarted, or it has paused. Without the host's time, as in a
//! replay, k is taken to be 0. What cannot be told so is said to be uncertain, with the least that it
//! can have been.

/// Samples in a silence that is short: numbers and clock tell by themselves.
const SHORT: u64 = 1 << 14;

/// Numbers that a board may be ahead of its clock because it has just been told to be quicker.
const MOST_AT_ANOTHER_RATE: u64 = 64;

/// How far the host's time of a sample and the board's may be apart, beside one in 64.
const HOST_SLACK_US: u64 = 2_000_000;

/// The clock comes round after so long.
const TURN_US: u64 = 1 << 32;

/// Numbers of samples come round after so many.
const NUMBERS: u64 = 1 << 16;

/// What lies between the newest sample and the one that comes now.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gap {
    /// Step of the sequence number.
    pub(crate) sequence: u16,
    /// Step of the board's clock.
    pub(crate) clock_us: u32,
    /// Step of the board's count of frames that it has dropped.
    pub(crate) dropped: u8,
    /// Step of the host's time, where it is known.
    pub(crate) host_us: Option<u64>,
}

/// What a silence was.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Silence {
    /// None to speak of.
    Short,
    /// A long one, during which the board ran.
    Long {
        /// The board's time between the samples before and after it.
        elapsed_us: u64,
    },
    /// The board has started anew meanwhile.
    Restart,
}

/// A silence, and what is known of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Verdict {
    pub(crate) silence: Silence,
    /// Step of the sequence number without the wraps, of a long silence.
    pub(crate) sent: u64,
    /// Whether no more can have been lost.
    pub(crate) certain: bool,
}

/// How far apart samples are, as a mean.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Period {
    samples: u64,
    span_us: u64,
}

impl Period {
    pub(crate) const fn new() -> Self {
        Self { samples: 0, span_us: 0 }
    }

    /// Takes a step between two samples of one run of the board.
    pub(crate) fn observe(&mut self, gap: &Gap) {
        /// A mean over so many is as good as it gets.
        const ENOUGH: u64 = 1 << 20;
        let (samples, span_us) = (u64::from(gap.sequence), u64::from(gap.clock_us));
        if samples == 0 || samples > SHORT || gap.dropped != 0 || span_us > 1 << 31 {
            return;
        }
        // Another rate, by more than an eighth: what came before says nothing about it.
        let expected = self.span_us * samples;
        if (span_us * self.samples).abs_diff(expected) > expected / 8 {
            *self = Self::new();
        }
        self.samples += samples;
        self.span_us += span_us;
        if self.samples > ENOUGH {
            self.samples /= 2;
            self.span_us /= 2;
        }
    }

    /// Periods in a time, to the nearest.
    fn count(&self, us: u64) -> u64 {
        let periods = u128::from(us) * u128::from(self.samples) + u128::from(self.span_us / 2);
        u64::try_from(periods / u128::from(self.span_us.max(1))).unwrap_or(u64::MAX)
    }

    /// What the silence before a sample was.
    pub(crate) fn judge(&self, gap: &Gap) -> Verdict {
        let short = Verdict { silence: Silence::Short, sent: 0, certain: true };
        if self.samples == 0 || self.span_us == 0 {
            return short;
        }
        let clock_us = u64::from(gap.clock_us);
        let longest = self.count(clock_us.max(gap.host_us.unwrap_or(0)));
        let is_short = longest < SHORT;
        let step = u64::from(gap.sequence);
        let most = self.count(clock_us) + self.slack(clock_us) + MOST_AT_ANOTHER_RATE;
        let is_back = gap.sequence.cast_signed() <= 0;
        let fits = if is_back { gap.clock_us.cast_signed() <= 0 } else { step <= most };
        let by_host = self.by_host(gap);
        // A program that was stopped reads the few frames that the system has kept when it goes on.
        // More of them tell if number and clock agree well.
        let agrees = || step + 16 + self.slack(clock_us) >= self.count(clock_us);
        let is_told = gap.host_us.is_none()
            || by_host.is_some()
            || self.count(clock_us) < 256
            || (!is_back && agrees());
        if (is_short && fits && is_told) || self.is_late(gap) {
            return short;
        }
        let told = by_host.or_else(|| self.by_clock(gap));
        let agreed = told.and_then(|elapsed_us| Some((elapsed_us, self.sent(gap, elapsed_us)?)));
        if let Some((elapsed_us, sent)) = agreed {
            return Verdict { silence: Silence::Long { elapsed_us }, sent, certain: true };
        }
        // Number and clock do not agree. Where the host's time confirms the clock, or the number is the
        // next one, the board has run on and sent less than it might have: it was told to pause, or to
        // be slower.
        let is_next = (1..16).contains(&step);
        match by_host {
            Some(elapsed_us) if step > 0 => {
                Verdict { silence: Silence::Long { elapsed_us }, sent: step, certain: is_next }
            }
            None if gap.host_us.is_none() && is_short && !is_back => {
                Verdict { certain: false, ..short }
            }
            None if gap.host_us.is_none() && is_next && gap.clock_us.cast_signed() > 0 => short,
            _ => Verdict { silence: Silence::Restart, sent: 0, certain: false },
        }
    }

    /// A sample that was overtaken, or comes twice, seems to be of the time before the clock came
    /// round.
    fn is_late(&self, gap: &Gap) -> bool {
        let (back, back_us) = (gap.sequence.wrapping_neg(), u64::from(gap.clock_us.wrapping_neg()));
        let is_recent = gap.host_us.is_none_or(|host_us| self.count(host_us) < SHORT);
        // With what the board may have dropped in between.
        is_recent && back < 128 && self.count(back_us) < 128 + 256
    }

    /// What has elapsed by the clock and the host's time, if these agree.
    fn by_host(&self, gap: &Gap) -> Option<u64> {
        let (clock_us, host_us) = (u64::from(gap.clock_us), gap.host_us?);
        let wraps = (host_us + TURN_US / 2).saturating_sub(clock_us) / TURN_US;
        let elapsed_us = clock_us + wraps * TURN_US;
        (elapsed_us.abs_diff(host_us) <= HOST_SLACK_US + host_us / 64).then_some(elapsed_us)
    }

    /// What has elapsed by the clock alone, where there is nothing else and it says anything.
    fn by_clock(&self, gap: &Gap) -> Option<u64> {
        let clock_us = u64::from(gap.clock_us);
        // A clock and a number that went back are also what a restart looks like, if a whole turn of
        // the clock is whole turns of the number.
        let turn = self.count(TURN_US) % NUMBERS;
        let is_ambiguous =
            gap.clock_us.cast_signed() < 0 && turn.min(NUMBERS - turn) <= self.slack(TURN_US) + 256;
        (gap.host_us.is_none() && !is_ambiguous).then_some(clock_us)
    }

    /// How far a count of periods in a time may be off.
    fn slack(&self, us: u64) -> u64 {
        // A frame may start a sixteenth of a period late.
        2 + self.count(us) / (16 * self.samples)
    }

    /// The step of the sequence number in so much time, without the wraps; `None` if there is none that
    /// fits.
    fn sent(&self, gap: &Gap, elapsed_us: u64) -> Option<u64> {
        let (expected, slack) = (self.count(elapsed_us), self.slack(elapsed_us));
        if slack >= SHORT {
            return None;
        }
        let most = expected + slack;
        let step = u64::from(gap.sequence);
        let sent = most.checked_sub((most.checked_sub(step)?) % NUMBERS)?;
        // What was not sent was dropped on the board, which counts it modulo 256.
        let unsent = most - sent;
        let dropped = unsent.wrapping_sub(u64::from(gap.dropped)) % 256;
        let fits = unsent <= 2 * slack + 256 && dropped <= 2 * slack;
        (sent > 0 && fits).then_some(sent)
    }
}
