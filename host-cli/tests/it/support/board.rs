//! A board that is as it should be.

use shared_proto::{ResetCause, Status, Stream};

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
