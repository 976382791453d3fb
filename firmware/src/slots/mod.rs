//! A calibration that survives a loss of power at any moment: two slots, written in turn.
//!
//! | offset in the slot | bytes | field |
//! |---:|---:|---|
//! | 0 | 2,296 | record |
//! | 2,296 | 4 | generation, little-endian: one more than that of the other slot when it was written |
//! | 2,300 | 4 | CRC-32 of all before it, little-endian |
//!
//! A slot counts if its CRC is right, and of two that count the newer generation is in use. A new
//! record goes into the other slot, so until its last byte is written the old one is in use. A slot
//! whose erasing or writing was cut short has a wrong CRC, or cannot be read at all where the memory
//! checks itself; either way it does not count.

#[cfg(test)]
mod fake_flash;

use crate::board::{Storage, StorageError};
use crate::upload::{RECORD, Record};
use embedded_storage::nor_flash::NorFlash;
#[cfg(test)]
pub(crate) use fake_flash::{FakeFlash, Outcome};
use shared_proto::crc32;

/// Length of a slot in bytes: record, generation, CRC-32.
const SLOT: usize = RECORD + 8;

/// Calibrations in memory that is erased in sectors: at its start are the slots, of as many whole sectors as one
/// takes.
#[derive(Clone, Debug)]
pub struct Slots<F> {
    flash: F,
}

/// What is in a slot that counts.
struct Kept {
    slot: u32,
    generation: u32,
    record: Record,
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

    /// What is in a slot, `None` if it does not count.
    fn read(&mut self, slot: u32) -> Option<Kept> {
        let mut bytes = [0; SLOT];
        self.flash.read(Self::offset(slot), &mut bytes).ok()?;
        let (content, crc) = bytes.split_last_chunk()?;
        let (record, generation) = content.split_first_chunk()?;
        let generation = u32::from_le_bytes(*generation.first_chunk()?);
        let counts = crc32(content) == u32::from_le_bytes(*crc);
        counts.then_some(Kept { slot, generation, record: *record })
    }

    /// What is in use.
    fn newest(&mut self) -> Option<Kept> {
        match (self.read(0), self.read(1)) {
            (Some(first), Some(second)) => {
                let ahead = second.generation.wrapping_sub(first.generation).cast_signed();
                Some(if ahead > 0 { second } else { first })
            }
            (first, second) => first.or(second),
        }
    }

    /// Erases a slot and writes it.
    fn replace(&mut self, slot: u32, generation: u32, record: &Record) -> Result<(), F::Error> {
        let mut bytes = [0; SLOT];
        bytes[..RECORD].copy_from_slice(record);
        bytes[RECORD..RECORD + 4].copy_from_slice(&generation.to_le_bytes());
        let crc = crc32(&bytes[..RECORD + 4]);
        bytes[RECORD + 4..].copy_from_slice(&crc.to_le_bytes());
        self.flash.erase(Self::offset(slot), Self::offset(slot + 1))?;
        self.flash.write(Self::offset(slot), &bytes)
    }
}

impl<F: NorFlash> Storage for Slots<F> {
    fn load(&mut self, record: &mut Record) {
        *record = self.newest().map_or([0xFF; RECORD], |kept| kept.record);
    }

    /// What was stored before stays in its slot, so it is still there after an error.
    fn store(&mut self, record: &Record) -> Result<(), StorageError> {
        let (slot, generation) = match self.newest() {
            Some(Kept { slot, generation, .. }) => (1 - slot, generation.wrapping_add(1)),
            None => (0, 0),
        };
        self.replace(slot, generation, record).map_err(|_| StorageError)?;
        match self.read(slot) {
            Some(kept) if kept.record == *record => Ok(()),
            _ => Err(StorageError),
        }
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

    /// Two sectors, and 288 double words.
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
                for outcome in Outcome::ALL {
                    let mut cut = slots.clone();
                    cut.flash.cut_power(operation, outcome);
                    assert_eq!(cut.store(&record(100)), Err(StorageError));
                    cut.flash.restore_power();

                    let kept = load(&mut cut);
                    let last = operation == OPERATIONS - 1 && outcome == Outcome::Complete;
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
