//! A calibration that survives a loss of power at any moment: two slots, written in turn.
//!
//! | offset in the slot | bytes | field |
//! |---:|---:|---|
//! | 0 | 2,272 | record |
//! | 2,272 | 4 | generation, little-endian: one more than that of the other slot when it was written |
//! | 2,276 | 4 | CRC-32 of all before it, little-endian |
//!
//! A slot counts if its CRC is right, and of two that count the newer generation is in use. A new
//! record goes into the other slot, so until its last byte is written the old one is in use. A slot
//! whose erasing or writing was cut short has a wrong CRC, or cannot be read at all where the memory
//! checks itself; either way it does not count.

#[cfg(test)]
mod fake_flash;

use crate::board::{Storage, StorageError};
use crate::upload::{RECORD, Record};
use crc::{CRC_32_ISO_HDLC, Crc, NoTable};
use embedded_storage::nor_flash::NorFlash;
#[cfg(test)]
pub(crate) use fake_flash::{CutOutcome, FakeFlash};

/// Generation and CRC-32, in bytes.
const TAIL: usize = 8;

/// Length of a slot in bytes.
const SLOT: usize = RECORD + TAIL;

/// Bytes that are read at a time: a record is not copied onto the stack.
const PIECE: usize = 128;

static CRC32: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);

/// Calibrations in memory that is erased in sectors: at its start are the slots, of as many whole sectors as one
/// takes.
#[derive(Clone, Debug)]
pub struct Slots<F> {
    flash: F,
}

impl<F: NorFlash> Slots<F> {
    /// Slots in a memory that is long enough for both.
    pub const fn new(flash: F) -> Self {
        const { assert!(SLOT.is_multiple_of(F::WRITE_SIZE), "a slot is written in whole words") };
        Self { flash }
    }

    #[cfg(test)]
    pub(crate) fn flash_mut(&mut self) -> &mut F {
        &mut self.flash
    }

    /// The first byte of a slot.
    fn offset(slot: u32) -> u32 {
        slot * SLOT.next_multiple_of(F::ERASE_SIZE) as u32
    }

    /// The generation of a slot, `None` if it does not count.
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

    /// Reads the record of a slot, piece by piece, with the position of each.
    fn read_record(&mut self, slot: u32, mut take: impl FnMut(usize, &[u8])) -> Option<()> {
        let mut piece = [0; PIECE];
        for at in (0..RECORD).step_by(PIECE) {
            let piece = piece.get_mut(..PIECE.min(RECORD - at))?;
            self.flash.read(Self::offset(slot) + at as u32, piece).ok()?;
            take(at, piece);
        }
        Some(())
    }

    /// The slot in use and its generation.
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

    /// Erases a slot and writes it.
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

    /// What was stored before stays in its slot, so it is still there after an error.
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
mod tests {
    use super::*;

    fn record(fill: u8) -> Record {
        core::array::from_fn(|i| fill ^ i as u8)
    }

    fn load<F: NorFlash>(slots: &mut Slots<F>) -> Record {
        let mut record = [0; RECORD];
        slots.load(&mut record);
        record
    }

    const NOTHING: Record = [0xFF; RECORD];

    #[test]
    fn the_last_record_that_was_stored_is_loaded() {
        let mut slots = Slots::new(FakeFlash::new());
        assert_eq!(load(&mut slots), NOTHING);
        for fill in 0..20 {
            assert_eq!(slots.store(&record(fill)), Ok(()));
            assert_eq!(load(&mut slots), record(fill));
        }
    }

    #[test]
    fn generations_wrap() {
        let mut slots = Slots::new(FakeFlash::new());
        slots.replace(0, u32::MAX - 1, &record(0)).unwrap();
        for fill in 1..5 {
            slots.store(&record(fill)).unwrap();
            assert_eq!(load(&mut slots), record(fill));
        }
    }

    /// Two sectors, and 285 double words.
    const OPERATIONS: usize = 2 + SLOT / 8;

    #[test]
    fn storing_takes_as_many_operations_as_the_cuts_below() {
        let mut slots = Slots::new(FakeFlash::new());
        slots.store(&record(1)).unwrap();
        assert_eq!(slots.flash.operations(), OPERATIONS);
    }

    // Every operation, every way in which it can be cut short, from every state that slots can be
    // in: both empty, one written, both written.
    #[test]
    fn a_power_cut_at_any_operation_leaves_the_old_record_or_the_new_one() {
        for before in 0..4 {
            let mut slots = Slots::new(FakeFlash::new());
            (0..before).for_each(|fill| slots.store(&record(fill)).unwrap());
            let old = load(&mut slots);
            for operation in 0..OPERATIONS {
                for outcome in CutOutcome::ALL {
                    let mut cut = slots.clone();
                    cut.flash.cut_power(operation, outcome);
                    assert_eq!(cut.store(&record(100)), Err(StorageError));
                    cut.flash.restore_power();

                    let kept = load(&mut cut);
                    let last = operation == OPERATIONS - 1 && outcome == CutOutcome::Complete;
                    let expected = if last { record(100) } else { old };
                    assert_eq!(kept, expected, "{before} {operation} {outcome:?}");
                    // The slots are as good as before.
                    assert_eq!(cut.store(&record(101)), Ok(()), "{before} {operation} {outcome:?}");
                    assert_eq!(load(&mut cut), record(101));
                }
            }
        }
    }

    #[test]
    fn a_memory_that_erases_but_does_not_write_keeps_the_old_record() {
        let mut slots = Slots::new(FakeFlash::new());
        for fill in 0..3 {
            slots.store(&record(fill)).unwrap();
            slots.flash.set_writable(false);
            assert_eq!(slots.store(&record(50)), Err(StorageError));
            assert_eq!(load(&mut slots), record(fill));
            slots.flash.set_writable(true);
        }
    }

    #[test]
    fn a_bit_that_has_changed_makes_the_record_before_the_one_in_use() {
        let mut slots = Slots::new(FakeFlash::new());
        slots.store(&record(1)).unwrap();
        slots.store(&record(2)).unwrap();
        slots.flash.damage(2 * FakeFlash::SECTOR + 5);
        assert_eq!(load(&mut slots), record(1));
        slots.flash.damage(RECORD);
        assert_eq!(load(&mut slots), NOTHING);
    }
}
