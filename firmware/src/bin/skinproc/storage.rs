//! The last page of the flash.

use embassy_stm32::flash::{Blocking, Flash};
use firmware::{RECORD, Record, Storage, StorageError};

/// Offset and length of the last page in bytes (RM0394, table "Flash module organization").
const PAGE: u32 = 254 * 1024;
const PAGE_LEN: u32 = 2 * 1024;

/// The calibration's page.
///
/// Erasing it stops the core for some 25 ms, for code runs from the same bank: frames that fall due
/// meanwhile are counted as late.
pub(crate) struct Page(pub(crate) Flash<'static, Blocking>);

impl Storage for Page {
    fn load(&mut self, record: &mut Record) {
        if self.0.blocking_read(PAGE, record).is_err() {
            *record = [0xFF; RECORD];
        }
    }

    fn store(&mut self, record: &Record) -> Result<(), StorageError> {
        const { assert!(RECORD % 8 == 0, "flash is written in double words") };
        let mut kept = [0; RECORD];
        self.0
            .blocking_erase(PAGE, PAGE + PAGE_LEN)
            .and_then(|()| self.0.blocking_write(PAGE, record))
            .and_then(|()| self.0.blocking_read(PAGE, &mut kept))
            .map_err(|_| StorageError)?;
        if kept == *record { Ok(()) } else { Err(StorageError) }
    }
}
