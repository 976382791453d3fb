//! The calibration's pages of the flash as a memory that slots are kept in.

use core::ops::Range;

use super::{ecc, pages};
use embassy_stm32::flash::{Blocking, Flash};
use embassy_stm32::pac;
use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};

/// Bytes in a page, the least that can be erased (RM0394, table "Flash module organization").
const PAGE: usize = 2 * 1024;

/// The calibration's pages as a memory of their own, in which nothing else can be reached.
///
/// Erasing a page stops the core for some 25 ms, for code runs from the same bank: frames that fall
/// due meanwhile are counted as late.
pub(crate) struct Area {
    flash: Flash<'static, Blocking>,
    range: Range<u32>,
}

impl Area {
    pub(crate) fn new(flash: Flash<'static, Blocking>) -> Self {
        Self { flash, range: pages::range() }
    }

    /// The address of `len` bytes in the flash.
    fn locate(&self, offset: u32, len: usize) -> Result<u32, Failed> {
        let inside = offset as usize + len <= self.range.len();
        if inside { Ok(self.range.start + offset) } else { Err(Failed) }
    }
}

/// The flash did not do it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Failed;

impl NorFlashError for Failed {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl ErrorType for Area {
    type Error = Failed;
}

impl ReadNorFlash for Area {
    const READ_SIZE: usize = 1;

    /// A double word with two wrong bits, as a loss of power leaves them, is an error.
    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Failed> {
        let start = self.locate(offset, bytes.len())?;
        ecc::forget();
        self.flash.blocking_read(start, bytes).map_err(|_| Failed)?;
        if ecc::has_failed() { Err(Failed) } else { Ok(()) }
    }

    fn capacity(&self) -> usize {
        self.range.len()
    }
}

impl NorFlash for Area {
    const WRITE_SIZE: usize = 8;
    const ERASE_SIZE: usize = PAGE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Failed> {
        let len = to.checked_sub(from).ok_or(Failed)?;
        let start = self.locate(from, len as usize)?;
        let erased = self.flash.blocking_erase(start, start + len);
        forget_cached();
        erased.map_err(|_| Failed)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Failed> {
        let start = self.locate(offset, bytes.len())?;
        self.flash.blocking_write(start, bytes).map_err(|_| Failed)
    }
}

/// Empties the data cache, which would go on showing what was erased. It can be reset only while it
/// is off (RM0394, section 3.3.4).
fn forget_cached() {
    let acr = pac::FLASH.acr();
    acr.modify(|acr| acr.set_dcen(false));
    acr.modify(|acr| acr.set_dcrst(true));
    acr.modify(|acr| acr.set_dcrst(false));
    acr.modify(|acr| acr.set_dcen(true));
}
