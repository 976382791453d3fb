//! The image that is flashed, executed: power cuts, wires, faults, noise.
//!
//! `cargo xtask test` builds the image, sets the model of its microcontroller up, and names both to these
//! tests. Where there is no model they are reported as ignored, and why.

#![expect(clippy::unwrap_used, reason = "a test may panic and say why")]
#![expect(unreachable_pub, reason = "modules of a test have no outside")]

#[path = "../emulated_board/bridge.rs"]
mod bridge;
mod host;
mod measures;
mod power;
mod program;
mod wires;

use libtest_mimic::{Arguments, Failed, Trial};
use system_tests::flashed::Model;

/// A test of the flashed image.
type Test = fn(&Model);

const TESTS: [(&str, Test); 12] = [
    (
        "the_image_says_what_it_is_and_answers_under_its_serial_number",
        wires::the_image_says_what_it_is_and_answers_under_its_serial_number,
    ),
    ("a_stream_is_what_the_converter_gave", wires::a_stream_is_what_the_converter_gave),
    (
        "a_line_that_is_held_up_costs_the_oldest_samples",
        wires::a_line_that_is_held_up_costs_the_oldest_samples,
    ),
    ("three_wires_are_enough", wires::three_wires_are_enough),
    (
        "the_books_balance_over_two_thousand_frames_behind_a_bad_line",
        wires::the_books_balance_over_two_thousand_frames_behind_a_bad_line,
    ),
    ("five_hundred_random_strings_do_no_harm", wires::five_hundred_random_strings_do_no_harm),
    (
        "rates_that_the_line_does_not_carry_are_refused",
        wires::rates_that_the_line_does_not_carry_are_refused,
    ),
    ("a_dead_converter_is_reset_by_the_watchdog", power::a_dead_converter_is_reset_by_the_watchdog),
    (
        "a_fault_of_the_core_is_reported_with_its_place",
        power::a_fault_of_the_core_is_reported_with_its_place,
    ),
    (
        "a_power_cut_at_any_operation_of_an_upload_leaves_a_calibration",
        power::a_power_cut_at_any_operation_of_an_upload_leaves_a_calibration,
    ),
    (
        "a_frame_takes_less_than_a_twentieth_of_the_core",
        measures::a_frame_takes_less_than_a_twentieth_of_the_core,
    ),
    (
        "shellcal_sets_the_board_up_and_records_it_whole",
        program::shellcal_sets_the_board_up_and_records_it_whole,
    ),
];

fn main() {
    let arguments = Arguments::from_args();
    let model = Model::find();
    let trials = TESTS.map(|(name, test)| match model.clone() {
        Ok(model) => Trial::test(name, move || {
            test(&model);
            Ok::<(), Failed>(())
        }),
        Err(reason) => Trial::test(name, || Ok(()))
            .with_ignored_flag(true)
            .with_kind(format!("no model: {reason}")),
    });
    libtest_mimic::run(&arguments, trials.into()).exit();
}
