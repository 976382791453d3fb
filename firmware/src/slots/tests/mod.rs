pub(crate) mod fake_flash;

use super::*;
use fake_flash::{CutOutcome, FakeFlash};

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
fn storing_takes_the_number_of_operations_that_the_power_cut_test_assumes() {
    let mut slots = Slots::new(FakeFlash::new());
    slots.store(&record(1)).unwrap();
    assert_eq!(slots.flash.operations(), OPERATIONS);
}

// Tests every operation, every kind of interruption, and every state of the slots.
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
