//! Where the pages of the flash are that hold the calibration.
#![expect(unsafe_code, reason = "the linker's symbols are declared")]

use core::ops::Range;

/// The first byte of the flash in the core's memory (RM0394, table "Flash module organization").
const FLASH: usize = 0x0800_0000;

// SAFETY: both are defined by memory/stm32.x. They have addresses only, which are taken below.
unsafe extern "C" {
    safe static __calibration_start: u8;
    safe static __calibration_end: u8;
}

/// Where the pages are, in bytes from the start of the flash.
pub(crate) fn range() -> Range<u32> {
    let offset = |symbol: *const u8| symbol.addr().wrapping_sub(FLASH) as u32;
    offset(&raw const __calibration_start)..offset(&raw const __calibration_end)
}
