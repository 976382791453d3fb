//! One frame as it is shown.

use shared_proto::CHANNELS;
use shell_data::wrench::PerAxis;

/// One frame as it is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LiveRow {
    /// s, on the board's clock or the log's.
    pub time_s: f64,
    /// The number of the frame.
    pub index: i64,
    /// Readings in steps of the converter.
    pub readings: Option<[f64; CHANNELS]>,
    /// N and N·m.
    pub wrench: Option<PerAxis<f64>>,
    /// Bit i is set if channel i was at an end of the converter's range.
    pub saturated: u8,
    /// Bit i is set if channel i was outside the calibrated range.
    pub out_of_range: u8,
}
