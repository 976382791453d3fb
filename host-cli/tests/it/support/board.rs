//! What planted boards share: a pty, and the status of a sound board.

use std::time::Duration;

use serialport::{SerialPort, TTYPort};
use shared_proto::{ResetCause, Status, Stream};

/// The board's end of a pty, and the name of the other.
pub(crate) fn pty() -> (TTYPort, String) {
    let (mut board, host) = TTYPort::pair().unwrap();
    board.set_timeout(Duration::from_millis(10)).unwrap();
    (board, host.name().unwrap())
}
/// Its status after some frames at the settings after a reset.
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
