//! What the image takes of its microcontroller.

use shared_proto::{Answer, Command, Stream};
use system_tests::emulation::PlayedFrame;
use system_tests::flashed::Model;
use system_tests::workload;

use super::host::{Host, Modelled, boards};

/// Instructions of a frame, at 100 Hz.
fn per_frame(host: &mut Host, stream: Stream) -> f64 {
    host.order(Command::SetStream(stream));
    host.order(Command::Start);
    host.run(0.2);
    let before = host.last.instructions;
    host.run(0.5);
    let instructions = host.last.instructions - before;
    host.order(Command::Stop);
    instructions as f64 / 50.0
}

fn start(model: &Model, played: &[PlayedFrame], calibration: &shared_proto::Calibration) -> Host {
    let mut host = Host::start(model, played);
    assert_eq!(host.upload(calibration), Some(Answer::Done));
    host
}

/// `cargo xtask firmware` prints the same figures.
#[test]
#[ignore = "needs the flashed image"]
fn a_frame_takes_no_more_than_is_promised() {
    for Modelled { model, .. } in &boards() {
        // 2.5 % of 80 million per second, and twice that for the physics model.
        let host = &mut start(model, &workload::everywhere(), &workload::cubic());
        for stream in [Stream::Raw, Stream::Wrench] {
            let instructions = per_frame(host, stream);
            assert!(instructions < 20_000.0, "{stream:?}: {instructions}");
        }
        let host = &mut start(model, &workload::poses(), &workload::physics());
        let instructions = per_frame(host, Stream::Wrench);
        assert!(instructions < 40_000.0, "{instructions}");
    }
}
