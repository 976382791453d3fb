//! A fake of the STM32L4's flash that behaves like it when the power is cut (RM0394, section 3.3).
//!
//! Sectors are erased, double words written, each with an error-correcting code. An interrupted
//! operation leaves a mix of old and new bits, or a wrong code, which makes reading fail.

extern crate std;

use std::collections::BTreeSet;
use std::vec;
use std::vec::Vec;

use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum CutOutcome {
    Nothing,
    SomeBits,
    Unreadable,
    Complete,
}

impl CutOutcome {
    pub(crate) const ALL: [Self; 4] =
        [Self::Nothing, Self::SomeBits, Self::Unreadable, Self::Complete];
}

const DOUBLE_WORD: usize = 8;

#[derive(Clone, Debug)]
pub(crate) struct FakeFlash {
    bytes: Vec<u8>,
    /// Double words with a wrong error-correcting code, by their first byte.
    unreadable: BTreeSet<usize>,
    operations: usize,
    cut: Option<(usize, CutOutcome)>,
    powered: bool,
    writable: bool,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Failed;

impl NorFlashError for Failed {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl FakeFlash {
    pub(crate) const SECTOR: usize = 2048;

    pub(crate) fn new() -> Self {
        Self {
            bytes: vec![0xFF; 4 * Self::SECTOR],
            unreadable: BTreeSet::new(),
            operations: 0,
            cut: None,
            powered: true,
            writable: true,
        }
    }

    pub(crate) fn operations(&self) -> usize {
        self.operations
    }

    pub(crate) fn cut_power(&mut self, operation: usize, outcome: CutOutcome) {
        self.cut = Some((self.operations + operation, outcome));
    }

    pub(crate) fn restore_power(&mut self) {
        (self.cut, self.powered) = (None, true);
    }

    pub(crate) fn set_writable(&mut self, writable: bool) {
        self.writable = writable;
    }

    pub(crate) fn damage(&mut self, at: usize) {
        self.bytes[at] ^= 0x10;
    }

    /// Changes an area, in part if the power is cut.
    fn change(&mut self, start: usize, content: &[u8]) -> Result<(), Failed> {
        if !self.powered {
            return Err(Failed);
        }
        let cut = self.cut.filter(|&(operation, _)| operation == self.operations);
        self.operations += 1;
        let outcome = cut.map_or(CutOutcome::Complete, |(_, outcome)| outcome);
        let area = &mut self.bytes[start..start + content.len()];
        let words = (start..start + content.len()).step_by(DOUBLE_WORD);
        match outcome {
            CutOutcome::Nothing => {}
            CutOutcome::SomeBits => {
                // Any mask with some bits of both.
                let mask = |i: usize| (i as u8).wrapping_mul(167) ^ 0x5A;
                for (i, (byte, new)) in area.iter_mut().zip(content).enumerate() {
                    *byte = *byte & mask(i) | new & !mask(i);
                }
                self.unreadable.retain(|word| !words.clone().any(|it| it == *word));
            }
            CutOutcome::Unreadable => self.unreadable.extend(words),
            CutOutcome::Complete => {
                area.copy_from_slice(content);
                self.unreadable.retain(|word| !words.clone().any(|it| it == *word));
            }
        }
        self.powered = cut.is_none();
        if self.powered { Ok(()) } else { Err(Failed) }
    }
}

impl ErrorType for FakeFlash {
    type Error = Failed;
}

impl ReadNorFlash for FakeFlash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Failed> {
        let start = offset as usize;
        let area = start..start + bytes.len();
        let overlaps = |word: &usize| word + DOUBLE_WORD > area.start && *word < area.end;
        if !self.powered || self.unreadable.iter().any(overlaps) {
            return Err(Failed);
        }
        bytes.copy_from_slice(&self.bytes[area]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

impl NorFlash for FakeFlash {
    const WRITE_SIZE: usize = DOUBLE_WORD;
    const ERASE_SIZE: usize = Self::SECTOR;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Failed> {
        for start in (from as usize..to as usize).step_by(Self::SECTOR) {
            self.change(start, &[0xFF; Self::SECTOR])?;
        }
        Ok(())
    }

    /// Writes double words; one that is not erased is refused (RM0394, PROGERR).
    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Failed> {
        for (i, word) in bytes.chunks(DOUBLE_WORD).enumerate() {
            let start = offset as usize + i * DOUBLE_WORD;
            let erased = self.bytes[start..start + DOUBLE_WORD].iter().all(|&byte| byte == 0xFF);
            if !self.writable || !erased {
                return Err(Failed);
            }
            self.change(start, word)?;
        }
        Ok(())
    }
}
