//! Recording: bytes from a source into a log and a raw file.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use serde::Serialize;
use shared_proto::{Boot, Protocol};

use super::board_log::RecordedBoard;
use super::record_error::RecordError;
use super::recorder::{Due, Recorder, Sinks};
use super::source::SourceInput;
use super::watcher::RecordingProgress;
use super::{Source, Uplink};
use crate::recording::{LiveForces, Losses};

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
    /// Stretches are labelled while they are recorded ([`RecordCommand::Label`](super::RecordCommand::Label)): there is a
    /// column for the labels, and rows of the first board wait until they are
    /// [settled](super::RecordCommand::Settled), so that a stretch may have begun when it is found.
    pub labels: bool,
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
    source.send(&recorder.last_commands());
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
