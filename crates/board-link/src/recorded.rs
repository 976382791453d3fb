//! What came of a recording.

use serde::Serialize;
use shared_proto::Boot;

use super::board_log::RecordedBoard;
use crate::recording::Losses;

/// What a whole recording was.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Recorded {
    /// The protocol, `None` if nothing arrived.
    pub framing: Option<&'static str>,
    /// Distinct frames, all of them written.
    pub frames: u64,
    /// Bytes that arrived.
    pub bytes: u64,
    /// The board's time from the first frame to the last, s.
    pub board_time_s: f64,
    /// Time that it took, s.
    pub elapsed_s: f64,
    /// What was lost.
    #[serde(flatten)]
    pub losses: Losses,
    /// Frames that are not in the log, because they hold wrenches and the first held readings, or
    /// the other way round.
    pub other_content: u64,
    /// Times that the port has come back.
    pub reconnections: u64,
    /// What the board said when it last started, if it did.
    #[serde(skip)]
    pub boot: Option<Boot>,
    /// The boards, where there are several.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub boards: Vec<RecordedBoard>,
}
