//! Power cuts, a converter that fails, and code that cannot be executed.

use shared_proto::{Answer, Command, ResetCause};
use system_tests::flashed::Model;

use super::host::{Host, Modelled, boards, calibration, crc_of};

/// Two pages erased, and a slot of 2,280 bytes in double words.
const OPERATIONS: u64 = 2 + 2_280 / 8;

/// Returns first, last, and every n-th operation. The slots' unit tests cover all.
fn cuts(one_in: u64) -> impl Iterator<Item = u64> {
    (0..OPERATIONS).filter(move |operation| {
        *operation < 4 || operation.is_multiple_of(one_in) || *operation > OPERATIONS - 4
    })
}

const OUTCOMES: [&str; 4] = ["nothing", "some bits", "unreadable", "complete"];

#[test]
#[ignore = "needs the flashed image"]
fn a_power_cut_at_any_operation_of_an_upload_leaves_a_calibration() {
    // The same code writes the flash of both boards.
    for (Modelled { model, .. }, one_in) in boards().iter().zip([7, 42]) {
        let [old, new, third] = [1, 2, 3].map(calibration);
        let mut host = Host::new(model);
        assert_eq!(host.upload(&old), Some(Answer::Done));
        assert_eq!(host.last.operations, OPERATIONS);
        host.begin_upload(&new);
        for operation in cuts(one_in) {
            for outcome in OUTCOMES {
                let complete = operation == OPERATIONS - 1 && outcome == "complete";
                let expected = crc_of(if complete { &new } else { &old });
                host.branch(|host| {
                    let boots = host.boots.len();
                    host.board.cut_power(operation, outcome);
                    assert_eq!(host.ask(Command::CommitCalibration), None, "{operation} {outcome}");
                    host.board.restore_power();
                    host.run(0.03);
                    assert_eq!(host.boots.len(), boots + 1, "{operation} {outcome}: bricked");
                    let found = host.status().calibration_crc32;
                    assert_eq!(found, expected, "{operation} {outcome}");
                    if [0, 1, 42, OPERATIONS - 1].contains(&operation) {
                        assert_eq!(
                            host.upload(&third),
                            Some(Answer::Done),
                            "{operation} {outcome}"
                        );
                        assert_eq!(host.status().calibration_crc32, crc_of(&third));
                    }
                    let by_power = host.resets.iter().all(|cause| cause == "power");
                    assert!(by_power, "{operation} {outcome}: {:?}", host.resets);
                });
            }
        }
    }
}

#[test]
#[ignore = "needs the flashed image"]
fn a_dead_converter_is_reset_by_the_watchdog() {
    let model = &Model::find();
    let mut host = Host::new(model);
    host.order(Command::Start);
    host.run(0.1);
    host.board.kill_converter();
    host.run(1.3);
    assert_eq!(host.resets, ["power", "watchdog"]);
    let status = host.status();
    assert_eq!((status.reset_cause, status.streaming), (ResetCause::Watchdog, false));
}

#[test]
#[ignore = "needs the flashed image"]
fn a_fault_of_the_core_is_reported_with_its_place() {
    for Modelled { model, .. } in &boards() {
        let mut host = Host::new(model);
        assert_eq!(host.last_words(), "");
        // There is no memory at this address.
        host.board.jump(0x3000_0000);
        host.run(0.1);
        assert_eq!(host.resets, ["power", "software"]);
        assert_eq!(host.status().reset_cause, ResetCause::Fault);
        let words = host.last_words();
        // The link register may hold any value.
        assert!(words.starts_with("fault at 0x30000000, called from 0x"), "{words}");
        // IBUSERR (Arm DDI0403, B3.2.15).
        assert!(words.ends_with("CFSR 0x00000100"), "{words}");
    }
}

#[test]
#[ignore = "needs the flashed image"]
fn a_stack_that_is_too_deep_is_reported_and_harms_no_variable() {
    for Modelled { model, .. } in &boards() {
        // As deep as the memory, and so deep that only an interrupt overflows it.
        for left in [0, 40] {
            let mut host = Host::new(model);
            host.order(Command::Start);
            host.board.set_stack(0x2000_0000 + left);
            host.run(0.2);
            assert_eq!(host.resets, ["power", "software"], "{left}");
            assert_eq!(host.status().reset_cause, ResetCause::Fault, "{left}");
            let words = host.last_words();
            assert!(words.starts_with("stack overflow, down to 0x1fff"), "{words}");
        }
    }
}
