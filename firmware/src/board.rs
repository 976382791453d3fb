//! What a board has to provide.

use crate::baud::Baud;
use crate::upload::Record;
use shared_proto::Vitals;

/// The emitters and the converter behind the eight photointerrupters.
pub trait FrontEnd {
    /// Lights the emitter of one channel and no other, or none.
    fn light(&mut self, channel: Option<usize>);

    /// The sum of so many conversions of a channel, 12 bits each, one right after the other, the first `settling_us` from
    /// now: exact, so that converters that sum by themselves and those that do not give the same readings. At least one,
    /// at most [`MAX_CONVERSIONS`](crate::acquisition::MAX_CONVERSIONS).
    async fn sum(&mut self, settling_us: u16, channel: usize, conversions: u8) -> u32;

    /// The sums of so many conversions of a channel with its emitter off, on after `settling_us`, and off again
    /// after as long; no emitter is lit before and after. As it is here, for a board that does not do it by itself.
    async fn expose(&mut self, settling_us: u16, channel: usize, conversions: u8) -> [u32; 3] {
        let before = self.sum(0, channel, conversions).await;
        self.light(Some(channel));
        let lit = self.sum(settling_us, channel, conversions).await;
        self.light(None);
        [before, lit, self.sum(settling_us, channel, conversions).await]
    }

    /// Measures temperature and supply, within [`VITALS_US`]. As it is here, for a board that cannot.
    async fn vitals(&mut self) -> Vitals {
        Vitals::default()
    }
}

/// Longest time that [`FrontEnd::vitals`] may take, in µs.
pub const VITALS_US: u64 = 250;

/// Time since the reset.
pub trait Clock {
    /// Now, in µs; never goes back.
    fn now_us(&self) -> u64;

    /// Comes back at a time in µs, at once if that has passed.
    async fn wait_until_us(&self, at_us: u64);
}

/// Memory that outlives a reset.
pub trait Storage {
    /// Reads what was stored last; of memory that never was written, anything.
    fn load(&mut self, record: &mut Record);

    /// Replaces what was stored.
    ///
    /// # Errors
    /// [`StorageError`] if the memory does not hold it afterwards.
    fn store(&mut self, record: &Record) -> Result<(), StorageError>;
}

/// The memory did not take what was to be stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StorageError;

/// A rising edge at the sync input, for a signal that another recorder has, too: the two clocks are compared by its edges.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SeenEdge {
    /// When it was, in µs since the reset.
    pub at_us: u64,
    /// Edges after the one before that came too fast to be kept, at least.
    pub missed: u16,
}

/// The rate of the serial line, and a bootloader in ROM. The defaults are those of a board with a fixed rate and
/// no bootloader.
pub trait Chip<W> {
    /// Sets the line to a rate; the last byte that was written has left.
    async fn set_baud(&mut self, _sender: &mut W, _rate: Baud) {}

    /// Starts the bootloader and does not come back; the last byte that was written has left.
    async fn start_bootloader(&mut self) {}
}

/// A board with a fixed rate and no bootloader.
#[derive(Clone, Copy, Debug)]
pub struct NoChip;

impl<W> Chip<W> for NoChip {}
