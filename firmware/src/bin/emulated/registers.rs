//! Access to the board's registers and memory: the only place that makes pointers of addresses.
#![expect(unsafe_code, reason = "registers are reached through their addresses")]

/// A block of 32-bit registers of a device of the mps2-an386 (Arm DAI0386), or an area
/// of its 16 MiB of PSRAM at 0x2100_0000, which nothing else uses.
#[derive(Clone, Copy)]
pub(crate) struct Block(usize);

impl Block {
    pub(crate) const UART0: Self = Self(0x4000_4000);
    pub(crate) const DUAL_TIMER: Self = Self(0x4000_2000);
    /// What the front end plays.
    pub(crate) const SCRIPT: Self = Self(0x2100_0000);
    /// Orders to the board before it starts.
    pub(crate) const ORDERS: Self = Self(0x2170_0000);
    /// Takes the place of the flash page for the calibration.
    pub(crate) const STORAGE: Self = Self(0x2180_0000);

    /// Reads the word at a byte offset, a multiple of four.
    pub(crate) fn read(self, offset: usize) -> u32 {
        // SAFETY: the constants above and the offsets that their users add lie within devices or
        // memory that the board has, and are multiples of four.
        unsafe { ((self.0 + offset) as *const u32).read_volatile() }
    }

    /// Writes the word at a byte offset, a multiple of four.
    pub(crate) fn write(self, offset: usize, value: u32) {
        // SAFETY: as above; no Rust object lives there.
        unsafe { ((self.0 + offset) as *mut u32).write_volatile(value) }
    }
}
