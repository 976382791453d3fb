//! Options of a recording, watchers and their commands, and errors that end a recording early.

use std::time::Duration;

use output_file::OutputError;
use shared_proto::Protocol;
use shell_data::block::FrameLabel;
use shell_data::hint::Hint;
use shell_data::wrench::{AxisValues, PerAxis};

use super::{LinkError, LogSink, Uplink};
use crate::recording::{BoardFrame, LiveForces, Losses, NoFrame, UnsuitableCalibration};

#[derive(Clone, Debug, Default)]
pub struct RecordOptions {
    /// The board's protocol; `None` to detect it.
    pub protocol: Option<Protocol>,
    pub forces: Option<LiveForces>,
    pub duration: Option<Duration>,
    /// Uplink that starts the board's stream, restores it after a restart, and stops it at the end.
    pub start: Option<Uplink>,
    pub as_sampled: bool,
    /// Enables [`RecordCommand::Label`]: adds a column, and delays rows of the first board until they are
    /// [settled](RecordCommand::Settled), since a block of time is recognised only after its start.
    pub labels: bool,
}

/// An observer of a recording, called on the recording thread; it must not block.
pub trait Watcher: std::fmt::Debug + Send {
    /// Receives new frames in order of arrival; with several boards, those of the first.
    fn see(&mut self, frames: &[BoardFrame]);

    /// Receives the newest wrench of the reference sensor, N and N·m.
    fn see_reference(&mut self, _wrench: PerAxis<f64>) {}

    /// Returns the next command; called about twice a second, until it returns `None`.
    fn next_command(&mut self) -> Option<RecordCommand> {
        None
    }
}

#[derive(Debug)]
pub enum RecordCommand {
    /// Starts a new log for the first board; other boards get logs next to it.
    Record(Box<dyn LogSink>),
    StopLog,
    /// Flags the first unwritten row from this frame on with the mark's number.
    Mark {
        index: i64,
        number: u32,
    },
    /// Labels the unwritten rows of a block of time of the first board.
    Label(FrameLabel),
    /// Declares that frames of the first board before this index get no more labels.
    Settled(i64),
}

#[derive(Clone, Debug, PartialEq)]
pub struct RecordingProgress {
    pub elapsed: Duration,
    pub rate_hz: f64,
    pub frames: u64,
    pub bytes: u64,
    pub losses: Losses,
    pub protocol: Option<Protocol>,
    pub connected: bool,
    /// N and N·m, if forces are enabled.
    pub wrench: Option<AxisValues<f64>>,
    /// Bytes to send so that boards continue to stream; usually empty.
    pub commands: Vec<u8>,
}

/// An error that ends a recording early; the data received until then are in the files.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    #[error(transparent)]
    Link(#[from] LinkError),
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error("`{source_name}`: {problem}")]
    NoFrame { source_name: String, problem: NoFrame },
    #[error(transparent)]
    Calibration(#[from] UnsuitableCalibration),
    #[error("the board sends wrenches, and the reference belongs beside readings")]
    ReferenceBesideWrenches,
    #[error(transparent)]
    Forces(#[from] forces::ForceError),
}

impl Hint for RecordError {
    fn hint(&self) -> Option<String> {
        let text = match self {
            Self::Link(error) => return error.hint(),
            Self::Output(error) => return error.hint(),
            Self::NoFrame { problem: NoFrame::Any { .. }, .. } => {
                "try another `--baud` (57600 unless told), or `--framing` if you know it"
            }
            Self::NoFrame { problem: NoFrame::OtherProtocol { .. }, .. } => {
                "leave out `--framing` to have it recognised"
            }
            Self::NoFrame { problem: NoFrame::Silence | NoFrame::NotStreaming, .. } => {
                "a board streams once it is started: `--start`, or `shellcal board PORT start`"
            }
            Self::Calibration(UnsuitableCalibration::Wrenches) => {
                "leave out `--calibration`, or have it stream readings: `shellcal board PORT mode raw`"
            }
            Self::ReferenceBesideWrenches => {
                "have it stream readings: `shellcal board PORT mode raw`"
            }
            _ => return None,
        };
        Some(text.to_owned())
    }
}
