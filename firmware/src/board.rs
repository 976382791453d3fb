//! What a board has to provide.

use crate::baud::Baud;
use crate::upload::Record;
use shared_proto::Vitals;

/// The emitters and the converter behind the eight photointerrupters.
pub trait FrontEnd {
    /// Time of one conversion in ns, rounded up: what the host is told fits into a period.
    const CONVERSION_NS: u32;

    /// Lights the emitter of one channel and no other, or none.
    fn light(&mut self, channel: Option<usize>);

    /// The sum of so many conversions of a channel, 12 bits each, one right after the other: exact, so that
    /// converters that sum by themselves and those that do not give the same readings. At least one, at
    /// most [`MAX_CONVERSIONS`](crate::acquisition::MAX_CONVERSIONS).
    async fn sum(&mut self, channel: usize, conversions: u8) -> u32;

    /// As [`sum`](Self::sum), the first conversion `settling_us` from now. As it is here, for a board without
    /// a timer of its own for that.
    async fn settle_and_sum<C: Clock>(
        &mut self,
        clock: &C,
        settling_us: u16,
        channel: usize,
        conversions: u8,
    ) -> u32 {
        clock.wait_until_us(clock.now_us() + u64::from(settling_us)).await;
        self.sum(channel, conversions).await
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
    /// How late a frame may start, in µs; a slot that cannot be kept so well is skipped.
    ///
    /// The default is a hundredth of the 10 ms period. Where something wakes the firmware less
    /// punctually than a timer's interrupt does, it has to be more.
    const TOLERANCE_US: u32 = 100;

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

/// An input for a signal that another recorder has, too: the two clocks are compared by its edges.
pub trait SyncInput {
    /// The next rising edge, once there is one.
    async fn next_edge(&mut self) -> SeenEdge;
}

/// An edge at the sync input.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SeenEdge {
    /// When it was, in µs since the reset.
    pub at_us: u64,
    /// Edges after the one before that came too fast to be kept, at least.
    pub missed: u16,
}

/// A board without such an input.
#[derive(Clone, Copy, Debug)]
pub struct NoSyncInput;

impl SyncInput for NoSyncInput {
    async fn next_edge(&mut self) -> SeenEdge {
        core::future::pending().await
    }
}

/// The rate of the serial line, and a bootloader in ROM. The defaults are those of a board with a fixed rate and
/// no bootloader.
pub trait Chip {
    /// Rates that the line to the host can be set to.
    const RATES: &'static [Baud] = &[];

    /// Whether it has a bootloader of its own that listens on that line.
    const HAS_BOOTLOADER: bool = false;

    /// Sets the line to one of [`Self::RATES`] once the last byte that was written has left.
    async fn set_baud(&mut self, _rate: Baud) {}

    /// Starts the bootloader once the last byte that was written has left, and does not come back.
    async fn start_bootloader(&mut self) {}
}

/// A board with a fixed rate and no bootloader.
#[derive(Clone, Copy, Debug)]
pub struct NoChip;

impl Chip for NoChip {}

/// Resets the board unless fed at least once a second.
pub trait Watchdog {
    /// All is well.
    fn feed(&mut self);
}
