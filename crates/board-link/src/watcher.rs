//! Who looks on while a recording is made, and what they may want of it.

use std::time::Duration;

use shared_proto::Protocol;

use super::LogSink;
use crate::recording::{BoardFrame, Losses};
use shell_data::block::FrameLabel;
use shell_data::wrench::AxisValues;

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
