//! Traits that a board has to implement.

use crate::baud::Baud;
use crate::upload::Record;
use shared_proto::Vitals;

pub trait FrontEnd {
    fn light(&mut self, channel: Option<usize>);

    /// Returns the sum of `conversions` 12-bit conversions of a channel, back to back after
    /// `settling_us`: at least one, at most
    /// [`MAX_CONVERSIONS`](crate::acquisition::MAX_CONVERSIONS). The sum is exact, so that
    /// converters that sum in hardware give the same readings.
    async fn sum(&mut self, settling_us: u16, channel: usize, conversions: u8) -> u32;

    /// Returns three sums of a channel: emitter off, on after `settling_us`, and off again after
    /// the same time. No emitter is lit before and after. The default needs no hardware for it.
    async fn expose(&mut self, settling_us: u16, channel: usize, conversions: u8) -> [u32; 3] {
        let before = self.sum(0, channel, conversions).await;
        self.light(Some(channel));
        let lit = self.sum(settling_us, channel, conversions).await;
        self.light(None);
        [before, lit, self.sum(settling_us, channel, conversions).await]
    }

    /// Measures temperature and supply within [`VITALS_US`], on boards that can.
    async fn vitals(&mut self) -> Vitals {
        Vitals::default()
    }
}

pub const VITALS_US: u64 = 250;

pub trait Clock {
    /// Returns the monotonic time, µs.
    fn now_us(&self) -> u64;

    /// Waits until a time, µs; returns immediately if it has passed.
    async fn wait_until_us(&self, at_us: u64);
}

pub trait Storage {
    /// Reads the stored record, or arbitrary bytes before the first.
    fn load(&mut self, record: &mut Record);

    /// # Errors
    /// [`StorageError`] if the memory does not hold the record afterwards.
    fn store(&mut self, record: &Record) -> Result<(), StorageError>;
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StorageError;

/// A rising edge at the sync input, which relates another recorder's clock to the board's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SeenEdge {
    /// In µs since the reset.
    pub at_us: u64,
    /// Minimum number of edges since the previous one that came too fast to be kept.
    pub missed: u16,
}

/// Rate of the serial line, and bootloader in ROM. By default, the rate is fixed and there is no bootloader.
pub trait Chip<W> {
    /// Sets the line's rate, after the last byte written has left.
    async fn set_baud(&mut self, _sender: &mut W, _rate: Baud) {}

    /// Starts the bootloader, after the last byte written has left, and does not return.
    async fn start_bootloader(&mut self) {}
}

/// A board with a fixed rate and no bootloader.
#[derive(Clone, Copy, Debug)]
pub struct NoChip;

impl<W> Chip<W> for NoChip {}
