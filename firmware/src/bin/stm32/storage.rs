//! The calibration's flash pages as the memory that holds its slots.
//!
//! Each double word has a code that corrects one wrong bit. Two wrong bits raise the non-maskable interrupt at every
//! read (RM0394, section 3.3.2). A loss of power during a write leaves such a double word, which must not keep the
//! board from starting.
#![expect(unsafe_code, reason = "an exception is handled, and the linker's symbols are declared")]

use core::ops::Range;
use core::sync::atomic::{AtomicBool, Ordering};

use embassy_stm32::flash::{Blocking, Flash};
use embassy_stm32::pac;
use embassy_stm32::pac::flash::regs::Eccr;
use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};

/// Smallest unit of erasure (RM0394, table "Flash module organization").
const PAGE: usize = 2 * 1024;

/// The calibration's pages as a separate memory. Erasing a page stops the core for about 25 ms,
/// since code runs from the same bank. Frames that fall due meanwhile count as late.
pub(crate) struct Area {
    flash: Flash<'static, Blocking>,
    range: Range<u32>,
}

impl Area {
    pub(crate) fn new(flash: Flash<'static, Blocking>) -> Self {
        Self { flash, range: range() }
    }

    fn locate(&self, offset: u32, len: usize) -> Result<u32, NorFlashErrorKind> {
        let inside = offset as usize + len <= self.range.len();
        inside.then_some(self.range.start + offset).ok_or(NorFlashErrorKind::OutOfBounds)
    }
}

impl ErrorType for Area {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for Area {
    const READ_SIZE: usize = 1;

    /// Reads bytes; two wrong bits in a double word, after a loss of power, are an error.
    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        let start = self.locate(offset, bytes.len())?;
        FAILED.store(false, Ordering::SeqCst);
        self.flash.blocking_read(start, bytes).map_err(|_| NorFlashErrorKind::Other)?;
        if has_failed() { Err(NorFlashErrorKind::Other) } else { Ok(()) }
    }

    fn capacity(&self) -> usize {
        self.range.len()
    }
}

impl NorFlash for Area {
    const WRITE_SIZE: usize = 8;
    const ERASE_SIZE: usize = PAGE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        let len = to.checked_sub(from).ok_or(NorFlashErrorKind::OutOfBounds)?;
        let start = self.locate(from, len as usize)?;
        let erased = self.flash.blocking_erase(start, start + len);
        forget_cached();
        erased.map_err(|_| NorFlashErrorKind::Other)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        let start = self.locate(offset, bytes.len())?;
        self.flash.blocking_write(start, bytes).map_err(|_| NorFlashErrorKind::Other)
    }
}

/// Empties the data cache of erased data; possible only while the cache is off (RM0394, section 3.3.4).
fn forget_cached() {
    let acr = pac::FLASH.acr();
    acr.modify(|acr| acr.set_dcen(false));
    acr.modify(|acr| acr.set_dcrst(true));
    acr.modify(|acr| acr.set_dcrst(false));
    acr.modify(|acr| acr.set_dcen(true));
}

/// Set if a double word of the calibration's pages could not be read.
static FAILED: AtomicBool = AtomicBool::new(false);

/// Returns true if a double word was unreadable since the flag was cleared.
fn has_failed() -> bool {
    // The interrupt is taken before the code after the barriers (Arm DDI0403, B1.5.14).
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
    FAILED.load(Ordering::SeqCst)
}

// SAFETY: accesses only an atomic and a register that no other code writes.
#[cortex_m_rt::exception]
unsafe fn NonMaskableInt() {
    let eccr = pac::FLASH.eccr().read();
    let is_ours = range().contains(&eccr.addr_ecc()) && !eccr.sysf_ecc();
    if eccr.eccd() && is_ours {
        let mut clear = Eccr::default();
        clear.set_eccd(true); // cleared by writing a one
        pac::FLASH.eccr().write_value(clear);
        FAILED.store(true, Ordering::SeqCst);
        return;
    }
    // The code itself is damaged, or the clock has failed.
    panic!("NMI, flash ECC register {:#010x}", eccr.0);
}

/// Start of the flash (RM0394, table "Flash module organization").
const FLASH: usize = 0x0800_0000;

// SAFETY: both are defined by memory/stm32.x. Only the symbols' addresses are used, below.
unsafe extern "C" {
    safe static __calibration_start: u8;
    safe static __calibration_end: u8;
}

fn range() -> Range<u32> {
    let offset = |symbol: *const u8| symbol.addr().wrapping_sub(FLASH) as u32;
    offset(&raw const __calibration_start)..offset(&raw const __calibration_end)
}
