//! How frames are taken, as commands set it.

use shared_proto::Stream;

/// How frames are taken and what is sent of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Readings or wrenches.
    pub stream: Stream,
    /// Time from frame to frame in µs.
    pub period_us: u32,
    /// Conversions averaged for each lit and each dark value.
    pub conversions: u8,
    /// Time from switching an emitter to converting, in µs.
    pub settling_us: u16,
}

impl Settings {
    /// After a reset: readings at 100 Hz, means of 8 conversions, which are one burst of the converter's, 100 µs to settle: the longest response time
    /// that Sharp's data sheets give for photointerrupters of this kind into 1 kΩ (GP1S560: 90 and 100 µs).
    /// A longer one lets more flicker through (docs/board.md).
    pub const DEFAULT: Self =
        Self { stream: Stream::Raw, period_us: 10_000, conversions: 8, settling_us: 100 };
}
