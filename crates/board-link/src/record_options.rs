//! How a recording is made, who looks on meanwhile and what they may want of it, and why it ends before its time.

use std::time::Duration;

use output_file::OutputError;
use shared_proto::Protocol;
use shell_data::block::FrameLabel;
use shell_data::hint::Hint;
use shell_data::wrench::AxisValues;

use super::{LinkError, LogSink, Uplink};
use crate::recording::{BoardFrame, LiveForces, Losses, NoFrame, UnsuitableCalibration};

/// How a recording is made.
#[derive(Clone, Debug, Default)]
pub struct RecordOptions {
    /// The protocol, if it is not to be recognised.
    pub protocol: Option<Protocol>,
    /// For forces beside the readings.
    pub forces: Option<LiveForces>,
    /// When to end.
    pub duration: Option<Duration>,
    /// Tells the board to start streaming, again as before if it restarts, and to stop at the end.
    pub start: Option<Uplink>,
    /// Channels are not brought to one time.
    pub as_sampled: bool,
    /// Stretches are labelled while they are recorded ([`RecordCommand::Label`]): there is a
    /// column for the labels, and rows of the first board wait until they are
    /// [settled](RecordCommand::Settled), so that a stretch may have begun when it is found.
    pub labels: bool,
}

/// Looks on while a recording is made. It is called on the thread that records, so it must not wait.
pub trait Watcher: std::fmt::Debug + Send {
    /// Frames that have just arrived, in the order in which they did; of several boards those of the first.
    fn see(&mut self, frames: &[BoardFrame]);

    /// What is to happen to the log from now on; asked about twice a second, until there is nothing more.
    fn next_command(&mut self) -> Option<RecordCommand> {
        None
    }
}

/// What a watcher wants.
#[derive(Debug)]
pub enum RecordCommand {
    /// A new log, in place of those that are being written; of several boards of the first, others beside it.
    Record(Box<dyn LogSink>),
    /// No log.
    StopLog,
    /// A flag with the number of the mark on the first row, from the frame of this index on, that has not been
    /// written.
    Mark { index: i64, number: u32 },
    /// A label for the rows of a stretch of the first board that have not been written.
    Label(FrameLabel),
    /// Frames of the first board before the one of this index get no label any more.
    Settled(i64),
}

/// How a recording is going, about twice a second.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordingProgress {
    /// Time since its start.
    pub elapsed: Duration,
    /// Frames per second since the report before.
    pub rate_hz: f64,
    /// Frames so far.
    pub frames: u64,
    /// Bytes so far.
    pub bytes: u64,
    /// What was lost so far.
    pub losses: Losses,
    /// The protocol, once it is known.
    pub protocol: Option<Protocol>,
    /// Whether the port is there.
    pub connected: bool,
    /// The newest wrench in N and N·m, where forces are wanted.
    pub wrench: Option<AxisValues<f64>>,
    /// What to send, so that boards stream as they did; nothing as a rule.
    pub commands: Vec<u8>,
}

/// A recording that has ended before its time. What arrived until then is in the files.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The source.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// A file.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// There is no frame from the port or file, for a reason.
    #[error("`{source_name}`: {problem}")]
    NoFrame { source_name: String, problem: NoFrame },
    /// The calibration.
    #[error(transparent)]
    Calibration(#[from] UnsuitableCalibration),
    /// A reference beside a board that sends wrenches of its own.
    #[error("the board sends wrenches, and the reference belongs beside readings")]
    ReferenceBesideWrenches,
    /// The low-pass of the forces.
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
