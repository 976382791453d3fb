//! Recording: bytes from a source into a log and a raw file.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use serde::Serialize;
use shared_proto::{Boot, Command, Protocol};

use super::board_log::RecordedBoard;
use super::record_error::RecordError;
use super::record_options::RecordOptions;
use super::recorder::{Due, Recorder};
use super::source::SourceInput;
use super::{LogSink, Source};
use crate::recording::{BoardFrame, FrameLabel, Losses};
use shell_data::wrench::AxisValues;

/// Where a recording goes.
#[derive(Debug, Default)]
pub struct Sinks {
    /// The log; where several boards are heard, of the first of them. Those of others are made beside it.
    pub log: Option<Box<dyn LogSink>>,
    /// The bytes as they arrive.
    pub raw: Option<Box<dyn LogSink>>,
    /// Who looks on.
    pub watcher: Option<Box<dyn Watcher>>,
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

/// Nobody looks on.
#[derive(Clone, Copy, Debug, Default)]
pub struct Unwatched;

impl Watcher for Unwatched {
    fn see(&mut self, _: &[BoardFrame]) {}
}

/// What a watcher wants.
#[derive(Debug)]
pub enum RecordCommand {
    /// A new log, in place of those that are being written; of several boards of the first, others beside it.
    Record(Box<dyn LogSink>),
    /// No log.
    StopLog,
    /// A flag on the first row, from the frame of this index on, that has not been written.
    Mark {
        /// The frame.
        index: i64,
        /// The number of the mark.
        number: u32,
    },
    /// A label for the rows of a stretch of the first board that have not been written.
    Label(FrameLabel),
    /// Frames of the first board before the one of this index get no label any more.
    Settled(i64),
}

/// How a recording is going.
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
    /// Frames that wait to be written.
    pub waiting: usize,
    /// What was lost so far.
    pub losses: Losses,
    /// The protocol, once it is known.
    pub protocol: Option<Protocol>,
    /// Whether the port is there.
    pub connected: bool,
    /// The newest wrench in N and N·m, where forces are wanted.
    pub wrench: Option<AxisValues<f64>>,
}

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

/// Records until the source ends, the time is over or `stop` is set; `observe` is told about twice
/// a second how it goes.
///
/// Every frame that arrived is in the log when this returns, with an error as without.
///
/// # Errors
/// [`RecordError`].
pub fn record(
    source: &mut Source,
    sinks: Sinks,
    options: &RecordOptions,
    stop: &AtomicBool,
    observe: &mut dyn FnMut(&RecordingProgress),
) -> Result<Recorded, RecordError> {
    let mut recorder = Recorder::new(source.name(), sinks, options.clone());
    let ran = run(&mut recorder, source, options.duration, stop, observe);
    if let Some(uplink) = &options.start {
        // Nobody waits for the answer, so once more in case the first is lost.
        for number in 0..2 {
            source.send(&uplink.encode(number, None, Command::Stop));
        }
    }
    // Whatever has happened: what has arrived is kept.
    let finished = match ran {
        Ok(()) => recorder.finish(),
        Err(error) => Err(recorder.finish().err().filter(is_about_files).unwrap_or(error)),
    };
    let mut recorded = recorder.recorded(source.elapsed());
    recorded.reconnections = source.reconnections;
    let closed = recorder.close();
    finished?;
    closed?;
    Ok(recorded)
}

fn is_about_files(error: &RecordError) -> bool {
    matches!(error, RecordError::Output(_))
}

fn run(
    recorder: &mut Recorder,
    source: &mut Source,
    duration: Option<Duration>,
    stop: &AtomicBool,
    observe: &mut dyn FnMut(&RecordingProgress),
) -> Result<(), RecordError> {
    let mut buffer = vec![0; 1 << 14];
    let commands = recorder.commands(source.arrival());
    source.send(&commands);
    loop {
        let elapsed = source.elapsed();
        if stop.load(Ordering::Relaxed) || duration.is_some_and(|end| elapsed >= end) {
            return Ok(());
        }
        let bytes = match source.read(&mut buffer)? {
            SourceInput::Bytes(count) => &buffer[..count],
            SourceInput::Nothing => &[],
            SourceInput::End => return Ok(()),
        };
        let (now, arrival) = (source.elapsed(), source.arrival());
        recorder.take(bytes, now, arrival)?;
        if let Some(Due { mut progress, commands }) = recorder.tend(now, arrival)? {
            source.send(&commands);
            progress.connected = source.is_connected();
            observe(&progress);
        }
    }
}
