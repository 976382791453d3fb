//! Recording: bytes from a source into a log and a raw file.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use serde::Serialize;
use shared_proto::{Boot, Command, Protocol};

use super::source::Input;
use super::{Journal, LinkError, Source, Uplink};
use crate::output::OutputError;
use crate::recording::{
    BoardFrame, LiveForces, Losses, NoFrame, Reception, Recognised, Recognition, RowWriter,
    UnsuitableCalibration, protocol_name,
};
use shell_data::wrench::PerAxis;

/// How long frames wait for those that overtook them before they are written. A kill loses as much,
/// and what the recognition of the protocol holds at the start.
const FLUSH: Duration = Duration::from_millis(400);

/// Most frames that wait, which bounds memory in a replay.
const BATCH: usize = 4096;

/// How a recording is made.
#[derive(Clone, Debug, Default)]
pub struct RecordOptions {
    /// The protocol, if it is not to be recognised.
    pub protocol: Option<Protocol>,
    /// For forces beside the readings.
    pub forces: Option<LiveForces>,
    /// When to end.
    pub duration: Option<Duration>,
    /// Tells the board to start streaming, and to stop at the end.
    pub start: Option<Uplink>,
}

/// Where a recording goes.
#[derive(Debug, Default)]
pub struct Sinks {
    /// The log.
    pub log: Option<Journal>,
    /// The bytes as they arrive.
    pub raw: Option<Journal>,
    /// Who looks on.
    pub watcher: Option<Box<dyn Watcher>>,
}

/// Looks on while a recording is made. It is called on the thread that records, so it must not wait.
pub trait Watcher: std::fmt::Debug {
    /// Frames that have just arrived, in the order in which they did.
    fn see(&mut self, frames: &[BoardFrame]);

    /// What is to happen to the log from now on; asked about twice a second, until there is nothing more.
    fn wish(&mut self) -> Option<Wish> {
        None
    }
}

/// What a watcher wants.
#[derive(Debug)]
pub enum Wish {
    /// A new log, in place of one that is being written.
    Record(Journal),
    /// No log.
    Rest,
    /// A flag on the first row, from the frame of this index on, that has not been written.
    Mark {
        /// The frame.
        index: i64,
        /// The number of the mark.
        number: u32,
    },
}

/// How a recording is going.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
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
    pub wrench: Option<PerAxis<f64>>,
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
}

/// A recording that has ended before its time. What arrived until then is in the files.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordError {
    /// The source.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// A file.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The bytes.
    #[error("`{source_name}`: {problem}")]
    NoFrame {
        /// The port or file.
        source_name: String,
        /// What is wrong.
        problem: NoFrame,
    },
    /// Not a single byte has come.
    #[error("nothing arrived from `{source_name}`")]
    Silence {
        /// The port or file.
        source_name: String,
    },
    /// Packets, but none with readings or forces.
    #[error("`{source_name}`: the board is there, but sends no frames")]
    NotStreaming {
        /// The port or file.
        source_name: String,
    },
    /// The calibration.
    #[error(transparent)]
    Calibration(#[from] UnsuitableCalibration),
    /// The low-pass of the forces.
    #[error(transparent)]
    Forces(#[from] crate::forces::ForceError),
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
    observe: &mut dyn FnMut(&Progress),
) -> Result<Recorded, RecordError> {
    let mut session = Session {
        stage: Stage::Recognising(Recognition::new(options.protocol)),
        options,
        log: sinks.log,
        raw: sinks.raw,
        watcher: sinks.watcher,
        marks: Vec::new(),
        rows: None,
        batch: Vec::new(),
        frames: 0,
        bytes: 0,
        other_content: 0,
        extent_us: None,
    };
    let ran = session.run(source, stop, observe);
    if let Some(uplink) = &options.start {
        // Nobody waits for the answer, so once more in case the first is lost.
        for number in 0..2 {
            source.send(&uplink.encode(number, None, Command::Stop));
        }
    }
    // Whatever has happened: what has arrived is kept.
    let finished = match ran {
        Ok(()) => session.finish(source),
        Err(error) => Err(session.finish(source).err().filter(is_about_files).unwrap_or(error)),
    };
    let recorded = session.recorded(source);
    let raw = session.raw.map_or(Ok(()), Journal::close);
    let log = session.log.map_or(Ok(()), Journal::close);
    finished?;
    log?;
    raw?;
    Ok(recorded)
}

fn is_about_files(error: &RecordError) -> bool {
    matches!(error, RecordError::Output(_))
}

/// A recording that is going on.
struct Session<'a> {
    stage: Stage,
    options: &'a RecordOptions,
    log: Option<Journal>,
    raw: Option<Journal>,
    watcher: Option<Box<dyn Watcher>>,
    /// Marks that are not in the log yet.
    marks: Vec<(i64, u32)>,
    /// Made for the first frame, which tells the columns.
    rows: Option<RowWriter>,
    batch: Vec<BoardFrame>,
    frames: u64,
    bytes: u64,
    other_content: u64,
    /// Earliest and latest time of a frame.
    extent_us: Option<(i64, i64)>,
}

enum Stage {
    Recognising(Recognition),
    Receiving(Protocol, Box<Reception>),
}

impl Session<'_> {
    fn run(
        &mut self,
        source: &mut Source,
        stop: &AtomicBool,
        observe: &mut dyn FnMut(&Progress),
    ) -> Result<(), RecordError> {
        let mut buffer = vec![0; 1 << 14];
        let (mut flushed_at, mut observed) = (Duration::ZERO, 0);
        self.start_board(source);
        loop {
            let elapsed = source.elapsed();
            if stop.load(Ordering::Relaxed)
                || self.options.duration.is_some_and(|end| elapsed >= end)
            {
                return Ok(());
            }
            let bytes = match source.read(&mut buffer)? {
                Input::Bytes(count) => &buffer[..count],
                Input::Nothing => &[],
                Input::End => return Ok(()),
            };
            let now = source.elapsed();
            self.take(bytes, now, source)?;
            let since = now.saturating_sub(flushed_at);
            if since >= FLUSH {
                flushed_at = now;
                self.follow()?;
                self.flush()?;
                if self.frames == 0 {
                    self.start_board(source);
                }
                let rate_hz = (self.frames - observed) as f64 / since.as_secs_f64();
                observed = self.frames;
                observe(&self.progress(source, rate_hz));
            } else if self.batch.len() >= BATCH || self.raw_waiting() >= 1 << 20 {
                self.flush()?;
            }
        }
    }

    fn start_board(&self, source: &mut Source) {
        if let Some(uplink) = &self.options.start {
            source.send(&uplink.encode(0, None, Command::Start));
        }
    }

    fn raw_waiting(&mut self) -> usize {
        self.raw.as_mut().map_or(0, |raw| raw.pending().len())
    }

    fn take(&mut self, bytes: &[u8], now: Duration, source: &Source) -> Result<(), RecordError> {
        self.bytes += bytes.len() as u64;
        if let Some(raw) = &mut self.raw {
            raw.pending().extend_from_slice(bytes);
        }
        match &mut self.stage {
            Stage::Receiving(_, reception) => {
                let before = self.batch.len();
                if let Some(arrival) = source.arrival() {
                    reception.arrived_at(arrival);
                }
                reception.feed(bytes, &mut self.batch);
                self.count(before);
                Ok(())
            }
            Stage::Recognising(recognition) => {
                let recognised = recognition.feed(bytes, now);
                self.recognised(recognised, source)
            }
        }
    }

    fn recognised(
        &mut self,
        recognised: Result<Option<Recognised>, NoFrame>,
        source: &Source,
    ) -> Result<(), RecordError> {
        let source_name = || source.name().to_owned();
        let recognised = recognised
            .map_err(|problem| RecordError::NoFrame { source_name: source_name(), problem })?;
        if let Some(Recognised { protocol, bytes }) = recognised {
            let mut reception = Box::new(Reception::new(protocol));
            reception.feed(&bytes, &mut self.batch);
            self.stage = Stage::Receiving(protocol, reception);
            self.count(0);
        }
        Ok(())
    }

    /// Counts the frames of the batch from `start` on, and shows them.
    fn count(&mut self, start: usize) {
        if let (Some(watcher), true) = (&mut self.watcher, start < self.batch.len()) {
            watcher.see(&self.batch[start..]);
        }
        for frame in &self.batch[start..] {
            self.frames += 1;
            let (first, last) = self.extent_us.unwrap_or((frame.time_us, frame.time_us));
            self.extent_us = Some((first.min(frame.time_us), last.max(frame.time_us)));
        }
    }

    /// Writes what waits.
    fn flush(&mut self) -> Result<(), RecordError> {
        if let Some(raw) = &mut self.raw {
            raw.flush()?;
        }
        let (Some(log), Some(first)) = (&mut self.log, self.batch.first()) else {
            self.batch.clear();
            // What nobody records is marked on the screen only.
            if self.log.is_none() {
                self.marks.clear();
            }
            return Ok(());
        };
        if self.rows.is_none() {
            let numbered = matches!(self.stage, Stage::Receiving(Protocol::Packets(_), _));
            let rows = RowWriter::new(first.content(numbered), self.options.forces.clone())?;
            log.pending().extend_from_slice(rows.header().as_bytes());
            self.rows = Some(rows);
        }
        if let Some(rows) = &mut self.rows {
            self.marks.drain(..).for_each(|(index, number)| rows.mark(index, number));
            rows.write(&mut self.batch, log.pending())?;
            self.other_content = rows.other_content;
        }
        log.flush()?;
        Ok(())
    }

    /// Does what the watcher wants. A log ends with all that was seen before that.
    fn follow(&mut self) -> Result<(), RecordError> {
        while let Some(wish) = self.watcher.as_mut().and_then(|watcher| watcher.wish()) {
            let next = match wish {
                Wish::Mark { index, number } => {
                    self.marks.push((index, number));
                    continue;
                }
                Wish::Record(journal) => Some(journal),
                Wish::Rest => None,
            };
            self.flush()?;
            self.rows = None;
            if let Some(log) = std::mem::replace(&mut self.log, next) {
                log.close()?;
            }
        }
        Ok(())
    }

    /// Takes what the end of the stream gives free, and writes all.
    fn finish(&mut self, source: &Source) -> Result<(), RecordError> {
        let recognised = match &mut self.stage {
            Stage::Receiving(..) => Ok(()),
            Stage::Recognising(recognition) => {
                let recognised = recognition.finish();
                self.recognised(recognised, source)
            }
        };
        if let Stage::Receiving(_, reception) = &mut self.stage {
            let before = self.batch.len();
            reception.finish(&mut self.batch);
            self.count(before);
        }
        self.flush()?;
        recognised?;
        let source_name = || source.name().to_owned();
        match (self.bytes, self.frames) {
            (0, _) => Err(RecordError::Silence { source_name: source_name() }),
            (_, 0) => Err(RecordError::NotStreaming { source_name: source_name() }),
            _ => Ok(()),
        }
    }

    fn progress(&self, source: &Source, rate_hz: f64) -> Progress {
        let (protocol, losses) = self.state();
        Progress {
            elapsed: source.elapsed(),
            rate_hz,
            frames: self.frames,
            bytes: self.bytes,
            waiting: self.batch.len(),
            losses,
            protocol,
            connected: source.is_connected(),
            wrench: self.rows.as_ref().and_then(RowWriter::newest_wrench),
        }
    }

    fn state(&self) -> (Option<Protocol>, Losses) {
        match &self.stage {
            Stage::Recognising(_) => (None, Losses::default()),
            Stage::Receiving(protocol, reception) => (Some(*protocol), reception.losses()),
        }
    }

    fn recorded(&self, source: &Source) -> Recorded {
        let (protocol, losses) = self.state();
        let (first_us, last_us) = self.extent_us.unwrap_or((0, 0));
        Recorded {
            framing: protocol.map(protocol_name),
            frames: self.frames,
            bytes: self.bytes,
            board_time_s: (last_us - first_us) as f64 / 1e6,
            elapsed_s: source.elapsed().as_secs_f64(),
            losses,
            other_content: self.other_content,
            reconnections: source.reconnections,
            boot: match &self.stage {
                Stage::Recognising(_) => None,
                Stage::Receiving(_, reception) => reception.boot(),
            },
        }
    }
}
