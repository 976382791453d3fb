//! What the image takes of its microcontroller.

use shared_proto::{Answer, Command, Stream};
use system_tests::flashed::Model;

use super::host::{Host, calibration};

/// 2.5 % of 80 million per second, at 100 Hz.
const INSTRUCTIONS: f64 = 20_000.0;

/// `cargo xtask firmware` prints the same figures.
#[test]
#[cfg_attr(
    not(flashed_image),
    ignore = "SHELLCAL_FLASHED_IMAGE or SHELLCAL_MODEL_PYTHON is not set"
)]
fn a_frame_takes_less_than_a_fortieth_of_the_core() {
    let model = &Model::find();
    let mut host = Host::new(model);
    assert_eq!(host.upload(&calibration(1)), Some(Answer::Done));
    for stream in [Stream::Raw, Stream::Wrench] {
        host.order(Command::SetStream(stream));
        host.order(Command::Start);
        host.run(0.2);
        let before = host.last.instructions;
        host.run(0.5);
        let per_frame = (host.last.instructions - before) as f64 / 50.0;
        assert!(per_frame < INSTRUCTIONS, "{stream:?}: {per_frame}");
        host.order(Command::Stop);
    }
}
