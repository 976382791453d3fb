//! Shared parts of the simulated boards.

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use serialport::{SerialPort, TTYPort};
use shared_proto::{ResetCause, Status, Stream};
use system_tests::program;

/// Returns the board's end of a pty, and the name of the other.
pub(crate) fn pty() -> (TTYPort, String) {
    let (mut board, host) = TTYPort::pair().unwrap();
    board.set_timeout(Duration::from_millis(10)).unwrap();
    (board, host.name().unwrap())
}

/// Starts a recording that waits for the port `adapter`. If started later, it would inherit the board's end.
pub(crate) fn start_before_the_port(dir: &Path, arguments: &str) -> Child {
    Command::new("sh")
        .arg("-c")
        .arg("while [ ! -e adapter ]; do sleep 0.02; done; exec \"$0\" \"$@\"")
        .arg(program::command(dir).get_program())
        .args(arguments.split_whitespace())
        .current_dir(dir)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

pub(crate) fn sound_status() -> Status {
    Status {
        streaming: false,
        calibrated: false,
        zeroed: false,
        stream: Stream::Raw,
        reset_cause: ResetCause::Power,
        period_us: 10_000,
        conversions: 16,
        settling_us: 200,
        uptime_s: 12,
        frames: 1234,
        late: 0,
        overflowed: 0,
        damaged: 0,
        longest_frame_us: 4567,
        calibration_crc32: 0,
        foreign: 0,
    }
}
