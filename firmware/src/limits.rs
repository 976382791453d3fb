//! What settings a board can keep up with.

use crate::acquisition::{self, MAX_CONVERSIONS};
use crate::settings::Settings;
use shared_proto::Refusal;

/// What a board can do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Limits {
    /// Shortest period in µs.
    pub(crate) min_period_us: u32,
    /// Time of a conversion in ns, see [`crate::FrontEnd::CONVERSION_NS`].
    pub(crate) conversion_ns: u32,
    /// How late a frame may start in µs, see [`crate::Clock::TOLERANCE_US`].
    pub(crate) tolerance_us: u32,
}

impl Limits {
    /// Longest period in µs.
    pub(crate) const MAX_PERIOD_US: u32 = 10_000_000;

    /// Longest settling in µs.
    pub(crate) const MAX_SETTLING_US: u16 = 10_000;

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
        if acquisition::duration_us(settings, self.conversion_ns) > settings.period_us {
            return Err(Refusal::PeriodTooShort);
        }
        Ok(())
    }
}
