//! Frames in, rows to all readers.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::sync::{Arc, Mutex};
use std::time::{SystemTime, UNIX_EPOCH};

use board_link::recording::{BoardFrame, LiveForces, UnsuitableCalibration};
use board_link::{RecordCommand, RecordError, Watcher};

use crate::command::StreamCommand;
use crate::decimation::Decimator;
use crate::encoding::{RowEncoder, StreamFormat};
use crate::latency::{Latency, LatencySummary};
use crate::readers::{ReaderSummary, Readers};
use crate::rows::{FrameRows, StreamRow};
use shell_data::lock::lock;

/// What passes frames on.
#[derive(Debug)]
pub struct FrameStream {
    rows: FrameRows,
    format: StreamFormat,
    commands: Option<Receiver<StreamCommand>>,
    decimator: Option<Decimator>,
    encoder: Option<RowEncoder>,
    readers: Readers,
    latency: Latency,
    frames: u64,
    sent: u64,
    newest: Option<i64>,
}

/// How a stream is made.
#[derive(Debug, Default)]
pub struct StreamOptions {
    /// For forces beside the readings.
    pub forces: Option<LiveForces>,
    /// Frames come from a log: their times and readings are as they are to be.
    pub from_log: bool,
    /// Channels are brought to one time, as `record` does; every frame waits for three after it.
    pub one_time: bool,
    /// How rows are written.
    pub format: StreamFormat,
    /// Rows per second, at most.
    pub rate_hz: Option<f64>,
    /// What users want while it runs.
    pub commands: Option<Receiver<StreamCommand>>,
}

/// What a whole stream was.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamSummary {
    /// Frames that came.
    pub frames: u64,
    /// Rows that were made of them.
    pub rows: u64,
    /// What came of its readers.
    pub readers: Vec<ReaderSummary>,
    /// How late rows were handed over.
    pub latency: Option<LatencySummary>,
}

impl FrameStream {
    /// Nothing has come yet.
    ///
    /// # Errors
    /// [`UnsuitableCalibration`] if it is for another number of channels.
    pub fn new(options: StreamOptions, readers: Readers) -> Result<Self, UnsuitableCalibration> {
        Ok(Self {
            rows: FrameRows::new(options.forces, options.from_log, options.one_time)?,
            format: options.format,
            commands: options.commands,
            decimator: options.rate_hz.map(Decimator::new),
            encoder: None,
            readers,
            latency: Latency::default(),
            frames: 0,
            sent: 0,
            newest: None,
        })
    }

    /// Whether all readers are gone and none can connect.
    pub fn is_deserted(&self) -> bool {
        self.readers.are_gone()
    }

    /// Passes frames on that have just arrived. Marks that were asked for are added to `marks`.
    ///
    /// # Errors
    /// [`RecordError`]: nothing can be passed on.
    pub fn push(
        &mut self,
        frames: &[BoardFrame],
        marks: &mut Vec<RecordCommand>,
    ) -> Result<(), RecordError> {
        self.frames += frames.len() as u64;
        self.obey(frames, marks);
        let mut rows = self.rows.of(frames, now_us())?;
        if let Some(decimator) = &mut self.decimator {
            rows = decimator.push(rows);
        }
        // Frames wait at the start, until it is known how they are sent.
        let is_first = self.sent == 0;
        rows.iter().for_each(|row| self.send(row, is_first));
        self.readers.flush();
        Ok(())
    }

    fn send(&mut self, row: &StreamRow, is_first: bool) {
        let (format, axes) = (self.format, self.rows.axes);
        let encoder = self.encoder.get_or_insert_with(|| RowEncoder::new(format, axes, row));
        self.readers.send(&encoder.begin(row), encoder);
        self.sent += 1;
        // What the radio delayed is not the stream's doing.
        if !is_first && self.newest.is_some_and(|newest| row.index > newest) {
            self.latency.push(row.time_us, now_us());
        }
        self.newest = self.newest.max(Some(row.index));
    }

    fn obey(&mut self, frames: &[BoardFrame], marks: &mut Vec<RecordCommand>) {
        while let Some(Ok(command)) = self.commands.as_ref().map(Receiver::try_recv) {
            match command {
                StreamCommand::Tare => self.rows.tare.begin(),
                StreamCommand::Untare => self.rows.tare = Default::default(),
                StreamCommand::Rate(rate_hz) => self.decimator = rate_hz.map(Decimator::new),
                StreamCommand::Mark => {
                    let number = self.rows.mark();
                    let index = frames.first().map_or(0, |frame| frame.index);
                    marks.push(RecordCommand::Mark { index, number });
                }
            }
        }
    }

    /// Ends it: what it was.
    pub fn finish(self) -> StreamSummary {
        StreamSummary {
            frames: self.frames,
            rows: self.sent,
            readers: self.readers.finish(),
            latency: self.latency.summary(),
        }
    }
}

/// µs since 1970.
fn now_us() -> i64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(now.as_micros()).unwrap_or(i64::MAX)
}

/// A stream that looks on while a recording is made, beside another watcher.
#[derive(Debug)]
pub struct StreamWatcher {
    state: Arc<Mutex<StreamState>>,
    stop: Option<Arc<AtomicBool>>,
    beside: Option<Box<dyn Watcher>>,
    marks: Vec<RecordCommand>,
}

/// A running stream, or the error that ended it; `None` once that has been taken.
type StreamState = Option<Result<Box<FrameStream>, RecordError>>;

/// The end of a stream that its maker keeps.
#[derive(Clone, Debug)]
pub struct StreamHandle(Arc<Mutex<StreamState>>);

impl StreamWatcher {
    /// Lets `stream` look on. Where it cannot go on, or nobody is left to read it, `stop` is set, if it is to
    /// end the recording.
    pub fn new(
        stream: FrameStream,
        beside: Option<Box<dyn Watcher>>,
        stop: Option<Arc<AtomicBool>>,
    ) -> (Self, StreamHandle) {
        let state = Arc::new(Mutex::new(Some(Ok(Box::new(stream)))));
        let handle = StreamHandle(Arc::clone(&state));
        (Self { state, stop, beside, marks: Vec::new() }, handle)
    }
}

impl Watcher for StreamWatcher {
    fn see(&mut self, frames: &[BoardFrame]) {
        let mut state = lock(&self.state);
        if let Some(Ok(stream)) = &mut *state {
            let pushed = stream.push(frames, &mut self.marks);
            if let Some(stop) = &self.stop
                && (pushed.is_err() || stream.is_deserted())
            {
                stop.store(true, Ordering::Relaxed);
            }
            if let Err(error) = pushed
                && let Some(Ok(stream)) = state.replace(Err(error))
            {
                stream.finish();
            }
        }
        drop(state);
        self.beside.iter_mut().for_each(|beside| beside.see(frames));
    }

    fn next_command(&mut self) -> Option<RecordCommand> {
        self.marks.pop().or_else(|| self.beside.as_mut()?.next_command())
    }
}

impl StreamHandle {
    /// Ends the stream: what it was; `None` if that is known already.
    ///
    /// # Errors
    /// [`RecordError`]: why it has ended before.
    pub fn finish(&self) -> Result<Option<StreamSummary>, RecordError> {
        let stream = lock(&self.0).take().transpose()?;
        Ok(stream.map(|stream| stream.finish()))
    }
}
