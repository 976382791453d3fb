//! A stream of frames to all readers, and its commands, one per line.

use std::str::FromStr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::sync::{Arc, Mutex};
use std::time::{SystemTime, UNIX_EPOCH};

use board_link::recording::{
    BoardFrame, LiveForces, Measured, RunningForces, Simultaneous, UnsuitableCalibration, row_flags,
};
use board_link::{RecordCommand, RecordError, Watcher};
use forces::{ForceError, RunningTare};

use crate::decimation::Decimator;
use crate::encoding::StreamRow;
use crate::latency::{Latency, LatencySummary};
use crate::readers::Readers;
use crate::summary::ReaderSummary;
use shell_data::lock::lock;
use shell_data::wrench::Axes;

/// Lowest row rate, Hz: for frames at 2 kHz, no lower low-pass can be computed in double precision.
pub const LEAST_RATE_HZ: f64 = 0.1;

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StreamCommand {
    Tare,
    Untare,
    Mark,
    /// Rows per second; `None` for all.
    Rate(Option<f64>),
}

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{0}` is no command; there are `tare`, `untare`, `mark`, `rate HZ` (from {LEAST_RATE_HZ} Hz) and `rate all`"
)]
pub struct UnknownCommand(String);

impl FromStr for StreamCommand {
    type Err = UnknownCommand;

    fn from_str(line: &str) -> Result<Self, UnknownCommand> {
        let unknown = || UnknownCommand(line.trim().to_owned());
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["tare"] => Ok(Self::Tare),
            ["untare"] => Ok(Self::Untare),
            ["mark"] => Ok(Self::Mark),
            ["rate", "all"] => Ok(Self::Rate(None)),
            ["rate", hz] => {
                let hz = hz.parse().ok().filter(|hz: &f64| hz.is_finite() && *hz >= LEAST_RATE_HZ);
                hz.map(|hz| Self::Rate(Some(hz))).ok_or_else(unknown)
            }
            _ => Err(unknown()),
        }
    }
}

#[derive(Debug, Default)]
pub struct FrameStream {
    simultaneous: Option<Simultaneous>,
    forces: Option<RunningForces>,
    axes: Axes,
    /// The first row with a new zero has the flag `tared`.
    tare: RunningTare,
    last_index: Option<i64>,
    /// Number of marks so far, and of marks that wait for a row.
    marks: (u32, u32),
    commands: Option<Receiver<StreamCommand>>,
    decimator: Option<Decimator>,
    readers: Readers,
    latency: Latency,
    frames: u64,
    sent: u64,
    newest: Option<i64>,
}

#[derive(Debug, Default)]
pub struct StreamOptions {
    pub forces: Option<LiveForces>,
    pub from_log: bool,
    /// True to align channels to a common time, as in `record`: frames wait for three more.
    pub one_time: bool,
    pub rate_hz: Option<f64>,
    pub commands: Option<Receiver<StreamCommand>>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct StreamSummary {
    pub frames: u64,
    pub rows: u64,
    pub readers: Vec<ReaderSummary>,
    pub latency: Option<LatencySummary>,
}

impl FrameStream {
    /// Fails with [`UnsuitableCalibration`] if the calibration has another number of channels.
    pub fn new(options: StreamOptions, readers: Readers) -> Result<Self, UnsuitableCalibration> {
        let forces = options.forces.map(RunningForces::new).transpose()?;
        let simultaneous = match (options.from_log, options.one_time) {
            (true, _) => None,
            (false, true) => Some(Simultaneous::new(false)),
            (false, false) => Some(Simultaneous::immediate()),
        };
        Ok(Self {
            simultaneous,
            axes: forces.as_ref().map_or(Axes::ALL, RunningForces::axes),
            forces,
            commands: options.commands,
            decimator: options.rate_hz.map(Decimator::new),
            readers,
            ..Self::default()
        })
    }

    /// Returns true if all readers have ended and no new one can connect.
    pub fn is_deserted(&self) -> bool {
        self.readers.are_gone()
    }

    /// Passes on newly arrived frames, and adds requested marks to `marks`. Fails with
    /// [`RecordError`] if no rows can be passed on.
    pub fn push(
        &mut self,
        frames: &[BoardFrame],
        marks: &mut Vec<RecordCommand>,
    ) -> Result<(), RecordError> {
        self.frames += frames.len() as u64;
        self.obey(frames, marks);
        self.pass(frames, false)
    }

    /// Sends the rows of frames; once `ended`, also rows that waited for later frames.
    fn pass(&mut self, frames: &[BoardFrame], ended: bool) -> Result<(), RecordError> {
        let mut rows = self.rows(frames, now_us(), ended)?;
        if let Some(decimator) = &mut self.decimator {
            rows = decimator.push(rows, ended).map_err(ForceError::from)?;
        }
        // Frames wait at the start until the board's timing is known.
        let is_first = self.sent == 0;
        rows.iter().for_each(|row| self.send(row, is_first));
        Ok(())
    }

    /// Returns the rows that are complete at `host_us`. With alignment, they belong to earlier frames.
    fn rows(
        &mut self,
        frames: &[BoardFrame],
        host_us: i64,
        ended: bool,
    ) -> Result<Vec<StreamRow>, RecordError> {
        let frames = match &mut self.simultaneous {
            Some(simultaneous) => simultaneous.take(frames.iter().cloned(), ended),
            None => frames.to_vec(),
        };
        if frames.is_empty() {
            return Ok(Vec::new());
        }
        let has_readings = |frame: &BoardFrame| frame.measured.readings().is_some();
        if self.forces.is_some() && !frames.iter().all(has_readings) {
            return Err(UnsuitableCalibration::Wrenches.into());
        }
        let forces = self.forces.as_mut().map(|forces| forces.of(&frames)).transpose()?;
        let errors = self.forces.as_ref().and_then(|forces| forces.standard_errors(&frames));
        let mut rows = Vec::with_capacity(frames.len());
        for (at, frame) in frames.iter().enumerate() {
            let force = forces.as_ref().map(|forces| &forces[at]);
            let is_late = self.last_index.is_some_and(|last| frame.index < last);
            let lost = self.last_index.is_some_and(|last| frame.index > last + 1);
            self.last_index = self.last_index.max(Some(frame.index));
            let mut flags = row_flags(frame, force, is_late);
            let (readings, own) = match frame.measured {
                Measured::Readings(readings) => (Some(readings), None),
                Measured::Wrench(wrench) => (None, Some(wrench)),
            };
            let wrench = force.map(|force| force.wrench).or(own);
            let wrench = wrench.map(|wrench| {
                if self.tare.push(wrench) {
                    flags.push("tared".to_owned());
                }
                // Without a tare the zero is 0, and the wrench keeps its exact bits.
                let zero = self.tare.zero;
                std::array::from_fn(|axis| wrench[axis] - zero[axis])
            });
            let (last, waiting) = self.marks;
            flags.extend((last - waiting + 1..=last).map(|number| format!("mark{number}")));
            self.marks.1 = 0;
            let standard_errors = errors.as_ref().map(|errors| errors.each_ref().map(|it| it[at]));
            let (&BoardFrame { time_us, index, .. }, flags) = (frame, flags.join(" "));
            // The time of a row is the time of its forces.
            let time_us = self.forces.as_ref().map_or(time_us, |of| of.moved_us(time_us));
            rows.push(StreamRow {
                time_us,
                index,
                host_us,
                readings,
                wrench,
                standard_errors,
                flags,
                lost,
            });
        }
        Ok(rows)
    }

    fn send(&mut self, row: &StreamRow, is_first: bool) {
        self.readers.send(row, self.axes);
        self.sent += 1;
        // Leave out the first rows and late frames, which the start and the radio have delayed.
        if !is_first && self.newest.is_some_and(|newest| row.index > newest) {
            self.latency.push(row.time_us, now_us());
        }
        self.newest = self.newest.max(Some(row.index));
    }

    fn obey(&mut self, frames: &[BoardFrame], marks: &mut Vec<RecordCommand>) {
        while let Some(Ok(command)) = self.commands.as_ref().map(Receiver::try_recv) {
            match command {
                StreamCommand::Tare => self.tare.begin(),
                StreamCommand::Untare => self.tare = Default::default(),
                StreamCommand::Rate(rate_hz) => self.decimator = rate_hz.map(Decimator::new),
                StreamCommand::Mark => {
                    self.marks = (self.marks.0 + 1, self.marks.1 + 1);
                    let (number, _) = self.marks;
                    let index = frames.first().map_or(0, |frame| frame.index);
                    marks.push(RecordCommand::Mark { index, number });
                }
            }
        }
    }

    /// Sends the waiting rows, and ends the stream; returns its summary. Fails with
    /// [`RecordError`], after all readers have ended.
    pub fn finish(mut self) -> Result<StreamSummary, RecordError> {
        let passed = self.pass(&[], true);
        let summary = StreamSummary {
            frames: self.frames,
            rows: self.sent,
            readers: self.readers.finish(),
            latency: self.latency.summary(),
        };
        passed.map(|()| summary)
    }
}

fn now_us() -> i64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(now.as_micros()).unwrap_or(i64::MAX)
}

#[derive(Debug)]
pub struct StreamWatcher {
    state: Arc<Mutex<StreamState>>,
    stop: Option<Arc<AtomicBool>>,
    beside: Option<Box<dyn Watcher>>,
    marks: Vec<RecordCommand>,
}

/// The stream, or the error that ended it; `None` after the result was taken.
type StreamState = Option<Result<Box<FrameStream>, RecordError>>;

#[derive(Clone, Debug)]
pub struct StreamHandle(Arc<Mutex<StreamState>>);

impl StreamWatcher {
    /// Creates a watcher that sets `stop` if the stream fails or has no readers left.
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
                // The first error is the one reported.
                let _ = stream.finish();
            }
        }
        drop(state);
        self.beside.iter_mut().for_each(|beside| beside.see(frames));
    }

    fn next_command(&mut self) -> Option<RecordCommand> {
        let mark = (!self.marks.is_empty()).then(|| self.marks.remove(0));
        mark.or_else(|| self.beside.as_mut()?.next_command())
    }
}

impl StreamHandle {
    /// Ends the stream; returns its summary, unless already taken. Fails with [`RecordError`] if
    /// the stream has failed.
    pub fn finish(&self) -> Result<Option<StreamSummary>, RecordError> {
        let stream = lock(&self.0).take().transpose()?;
        stream.map(|stream| stream.finish()).transpose()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_commands_or_refused() {
        assert_eq!("tare\n".parse(), Ok(StreamCommand::Tare));
        assert_eq!(" rate 12.5 ".parse(), Ok(StreamCommand::Rate(Some(12.5))));
        assert_eq!("rate all".parse(), Ok(StreamCommand::Rate(None)));
        for line in ["", "rate", "rate -1", "rate NaN", "rate 0", "rate 1e-6", "tare now", "Tare"] {
            assert!(line.parse::<StreamCommand>().is_err(), "{line}");
        }
    }
}
