//! Traits that a board has to implement.

use crate::baud::Baud;
use crate::upload::Record;
use shared_proto::Vitals;

/// The emitters and the converter behind the eight photointerrupters.
pub trait FrontEnd {
    /// Lights the emitter of one channel and no other, or none.
    fn light(&mut self, channel: Option<usize>);

    /// Returns the sum of `conversions` 12-bit conversions of a channel, back to back, the first
    /// `settling_us` from now.
    ///
    /// The sum is exact, so that converters that sum in hardware give the same readings as those that do not.
    /// At least one conversion, at most [`MAX_CONVERSIONS`](crate::acquisition::MAX_CONVERSIONS).
    async fn sum(&mut self, settling_us: u16, channel: usize, conversions: u8) -> u32;

    /// Returns three sums of `conversions` conversions of a channel: emitter off, on after `settling_us`, and
    /// off again after the same time. No emitter is lit before and after. The default is for boards without
    /// hardware for it.
    async fn expose(&mut self, settling_us: u16, channel: usize, conversions: u8) -> [u32; 3] {
        let before = self.sum(0, channel, conversions).await;
        self.light(Some(channel));
        let lit = self.sum(settling_us, channel, conversions).await;
        self.light(None);
        [before, lit, self.sum(settling_us, channel, conversions).await]
    }

    /// Measures temperature and supply within [`VITALS_US`]. The default is for boards that cannot.
    async fn vitals(&mut self) -> Vitals {
        Vitals::default()
    }
}

/// Maximum duration of [`FrontEnd::vitals`], in µs.
pub const VITALS_US: u64 = 250;

/// Time since the reset.
pub trait Clock {
    /// Returns the time in µs, which is monotonic.
    fn now_us(&self) -> u64;

    /// Waits until a time in µs; returns immediately if it has passed.
    async fn wait_until_us(&self, at_us: u64);
}

/// Memory that survives a reset.
pub trait Storage {
    /// Reads the last stored record; arbitrary bytes if nothing was ever stored.
    fn load(&mut self, record: &mut Record);

    /// Replaces the stored record.
    ///
    /// # Errors
    /// [`StorageError`] if the memory does not hold the record afterwards.
    fn store(&mut self, record: &Record) -> Result<(), StorageError>;
}

/// The memory failed to store a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StorageError;

/// A rising edge at the sync input. Another recorder sees the same signal, so that its edges relate the two
/// clocks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SeenEdge {
    /// Time of the edge, in µs since the reset.
    pub at_us: u64,
    /// Lower bound of the edges since the previous one that came too fast to be kept.
    pub missed: u16,
}

/// The rate of the serial line, and the bootloader in ROM. The defaults are for a board with a fixed rate and
/// no bootloader.
pub trait Chip<W> {
    /// Sets the rate of the line, after the last byte written has left.
    async fn set_baud(&mut self, _sender: &mut W, _rate: Baud) {}

    /// Starts the bootloader and does not return. The last byte written has left.
    async fn start_bootloader(&mut self) {}
}

/// A board with a fixed rate and no bootloader.
#[derive(Clone, Copy, Debug)]
pub struct NoChip;

impl<W> Chip<W> for NoChip {}
