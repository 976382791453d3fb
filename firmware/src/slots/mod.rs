//! A calibration that survives a loss of power at any moment: two slots, written in turn.
//!
//! | offset in the slot | bytes | field |
//! |---:|---:|---|
//! | 0 | 2,272 | record |
//! | 2,272 | 4 | generation, little-endian: the other slot's generation at the time of writing, plus one |
//! | 2,276 | 4 | CRC-32 of all bytes before it, little-endian |
//!
//! A slot is valid if its CRC is right; of two valid slots, the newer generation is in use. A new
//! record goes into the other slot, so the old one stays in use until the last byte is written. A
//! slot whose erasing or writing was interrupted has a wrong CRC, or cannot be read at all.

use crate::board::{Storage, StorageError};
use crate::upload::{RECORD, Record};
use crc::{CRC_32_ISO_HDLC, Crc, NoTable};
use embedded_storage::nor_flash::NorFlash;

const TAIL: usize = 8;

const SLOT: usize = RECORD + TAIL;

/// Bytes read at a time, to keep records off the stack.
const PIECE: usize = 128;

static CRC32: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);

/// Calibrations in a memory that is erased in sectors; each slot takes whole sectors, from the first on.
#[derive(Clone, Debug)]
pub struct Slots<F> {
    pub(crate) flash: F,
}

impl<F: NorFlash> Slots<F> {
    pub const fn new(flash: F) -> Self {
        const { assert!(SLOT.is_multiple_of(F::WRITE_SIZE), "a slot is written in whole words") };
        Self { flash }
    }

    fn offset(slot: u32) -> u32 {
        slot * SLOT.next_multiple_of(F::ERASE_SIZE) as u32
    }

    fn generation(&mut self, slot: u32) -> Option<u32> {
        let digest = &mut CRC32.digest();
        let mut tail = [0; TAIL];
        self.read_record(slot, |_, piece| digest.update(piece))?;
        self.flash.read(Self::offset(slot) + RECORD as u32, &mut tail).ok()?;
        let (generation, crc) = tail.split_first_chunk()?;
        digest.update(generation);
        let counts = digest.clone().finalize() == u32::from_le_bytes(*crc.first_chunk()?);
        counts.then_some(u32::from_le_bytes(*generation))
    }

    /// Reads the record of a slot in pieces, each passed on with its position.
    fn read_record(&mut self, slot: u32, mut take: impl FnMut(usize, &[u8])) -> Option<()> {
        let mut piece = [0; PIECE];
        for at in (0..RECORD).step_by(PIECE) {
            let piece = piece.get_mut(..PIECE.min(RECORD - at))?;
            self.flash.read(Self::offset(slot) + at as u32, piece).ok()?;
            take(at, piece);
        }
        Some(())
    }

    fn newest(&mut self) -> Option<(u32, u32)> {
        match (self.generation(0), self.generation(1)) {
            (Some(first), Some(second)) => {
                let ahead = second.wrapping_sub(first).cast_signed();
                Some(if ahead > 0 { (1, second) } else { (0, first) })
            }
            (Some(first), None) => Some((0, first)),
            (None, second) => second.map(|second| (1, second)),
        }
    }

    fn replace(&mut self, slot: u32, generation: u32, record: &Record) -> Result<(), F::Error> {
        let mut digest = CRC32.digest();
        digest.update(record);
        digest.update(&generation.to_le_bytes());
        let mut tail = [0; TAIL];
        tail[..4].copy_from_slice(&generation.to_le_bytes());
        tail[4..].copy_from_slice(&digest.finalize().to_le_bytes());
        self.flash.erase(Self::offset(slot), Self::offset(slot + 1))?;
        self.flash.write(Self::offset(slot), record)?;
        self.flash.write(Self::offset(slot) + RECORD as u32, &tail)
    }
}

impl<F: NorFlash> Storage for Slots<F> {
    fn load(&mut self, record: &mut Record) {
        let read = self.newest().and_then(|(slot, _)| {
            self.read_record(slot, |at, piece| {
                record[at..at + piece.len()].copy_from_slice(piece);
            })
        });
        if read.is_none() {
            record.fill(0xFF);
        }
    }

    /// Stores a record. The previous one stays in its slot, so it survives an error.
    fn store(&mut self, record: &Record) -> Result<(), StorageError> {
        let (slot, generation) = match self.newest() {
            Some((slot, generation)) => (1 - slot, generation.wrapping_add(1)),
            None => (0, 0),
        };
        self.replace(slot, generation, record).map_err(|_| StorageError)?;
        let mut is_kept = self.generation(slot) == Some(generation);
        let read = self.read_record(slot, |at, piece| {
            is_kept &= record.get(at..at + piece.len()) == Some(piece);
        });
        if is_kept && read.is_some() { Ok(()) } else { Err(StorageError) }
    }
}

#[cfg(test)]
pub(crate) mod tests;
