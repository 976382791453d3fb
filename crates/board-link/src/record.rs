//! Recording: bytes from a source into a log and a raw file.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use serde::Serialize;
use shared_proto::{Boot, Command, Protocol};

use super::append_writer::LogFolder;
use super::board_log::{BoardLog, RecordedBoard};
use super::record_error::RecordError;
use super::record_options::RecordOptions;
use super::resume::StartedBoards;
use super::source::SourceInput;
use super::{AppendWriter, Source};
use crate::recording::{
    BoardFrame, BoardSource, Boards, FrameLabel, HeardBoard, Losses, NoFrame, RecognisedProtocol,
    Recognition, protocol_name,
};
use shell_data::wrench::AxisValues;

/// How long frames wait for those that overtook them before they are written. A kill loses as much,
/// and what the recognition of the protocol holds at the start.
const FLUSH: Duration = Duration::from_millis(400);

/// Most frames that wait, which bounds memory in a replay.
const BATCH: usize = 4096;

/// Where a recording goes.
#[derive(Debug, Default)]
pub struct Sinks {
    /// The log; where several boards are heard, of the first of them. Those of others are made beside it.
    pub log: Option<AppendWriter>,
    /// The bytes as they arrive.
    pub raw: Option<AppendWriter>,
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
    Record(AppendWriter),
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
    let mut session = RecordSession::new(sinks, options);
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
    let raw = session.raw.map_or(Ok(()), AppendWriter::close);
    let logs = session.logs.into_iter().filter_map(|board| board.log).chain(session.log);
    // All are closed, whatever becomes of one.
    let logs: Vec<_> = logs.map(AppendWriter::close).collect();
    finished?;
    logs.into_iter().collect::<Result<(), _>>()?;
    raw?;
    Ok(recorded)
}

fn is_about_files(error: &RecordError) -> bool {
    matches!(error, RecordError::Output(_))
}

/// The log of the next board: the one that was asked for, then others beside it.
fn log_of(
    first: &mut Option<AppendWriter>,
    place: Option<&LogFolder>,
    sender: BoardSource,
) -> Result<Option<AppendWriter>, RecordError> {
    match (first.take(), place) {
        (Some(log), _) => Ok(Some(log)),
        (None, Some(place)) => Ok(Some(place.beside(&sender.text())?)),
        (None, None) => Ok(None),
    }
}

/// A recording that is going on.
struct RecordSession<'a> {
    stage: RecordStage,
    options: &'a RecordOptions,
    /// For the first board.
    log: Option<AppendWriter>,
    /// Where logs of other boards are made.
    log_place: Option<LogFolder>,
    raw: Option<AppendWriter>,
    watcher: Option<Box<dyn Watcher>>,
    /// Waiting frames of the first board that the watcher has seen.
    shown: usize,
    /// Marks that the first board's log has not got yet.
    marks: Vec<(i64, u32)>,
    /// Labels that are still to be written.
    labels: Vec<FrameLabel>,
    /// The index of the first frame that may still be labelled.
    settled: Option<i64>,
    /// One for each board that has sent frames, in the order in which they began.
    logs: Vec<BoardLog>,
    started: StartedBoards,
    bytes: u64,
}

enum RecordStage {
    Recognising(Recognition),
    Receiving(Protocol, Box<Boards>),
}

impl<'a> RecordSession<'a> {
    fn new(sinks: Sinks, options: &'a RecordOptions) -> Self {
        Self {
            stage: RecordStage::Recognising(Recognition::new(options.protocol)),
            options,
            log_place: sinks.log.as_ref().map(AppendWriter::place),
            log: sinks.log,
            raw: sinks.raw,
            watcher: sinks.watcher,
            shown: 0,
            marks: Vec::new(),
            labels: Vec::new(),
            settled: None,
            logs: Vec::new(),
            started: StartedBoards::default(),
            bytes: 0,
        }
    }

    fn run(
        &mut self,
        source: &mut Source,
        stop: &AtomicBool,
        observe: &mut dyn FnMut(&RecordingProgress),
    ) -> Result<(), RecordError> {
        let mut buffer = vec![0; 1 << 14];
        let (mut flushed_at, mut observed) = (Duration::ZERO, 0);
        self.keep_streaming(source);
        loop {
            let elapsed = source.elapsed();
            if stop.load(Ordering::Relaxed)
                || self.options.duration.is_some_and(|end| elapsed >= end)
            {
                return Ok(());
            }
            let bytes = match source.read(&mut buffer)? {
                SourceInput::Bytes(count) => &buffer[..count],
                SourceInput::Nothing => &[],
                SourceInput::End => return Ok(()),
            };
            let now = source.elapsed();
            self.take(bytes, now, source)?;
            let since = now.saturating_sub(flushed_at);
            if since >= FLUSH {
                flushed_at = now;
                self.follow()?;
                self.flush()?;
                let frames = self.frames();
                self.keep_streaming(source);
                let rate_hz = (frames - observed) as f64 / since.as_secs_f64();
                observed = frames;
                observe(&self.progress(source, rate_hz));
            } else if self.waiting() >= BATCH || self.raw_waiting() >= 1 << 20 {
                self.flush()?;
            }
        }
    }

    fn keep_streaming(&mut self, source: &mut Source) {
        let Some(uplink) = &self.options.start else { return };
        let heard = match &self.stage {
            RecordStage::Recognising(_) => &[],
            RecordStage::Receiving(_, boards) => boards.heard(),
        };
        let now = source.arrival().unwrap_or_default();
        source.send(&self.started.commands(uplink, heard, now));
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
            RecordStage::Receiving(_, boards) => {
                if let Some(arrival) = source.arrival() {
                    boards.arrived_at(arrival);
                }
                boards.feed(bytes);
                self.show();
                Ok(())
            }
            RecordStage::Recognising(recognition) => {
                let recognised = recognition.feed(bytes, now);
                self.recognised(recognised, source)
            }
        }
    }

    fn recognised(
        &mut self,
        recognised: Result<Option<RecognisedProtocol>, NoFrame>,
        source: &Source,
    ) -> Result<(), RecordError> {
        let source_name = || source.name().to_owned();
        let recognised = recognised
            .map_err(|problem| RecordError::NoFrame { source_name: source_name(), problem })?;
        if let Some(RecognisedProtocol { protocol, bytes }) = recognised {
            let mut boards = Box::new(Boards::new(protocol));
            boards.feed(&bytes);
            self.stage = RecordStage::Receiving(protocol, boards);
            self.show();
        }
        Ok(())
    }

    /// Shows the watcher what has arrived of the first board.
    fn show(&mut self) {
        let (Some(watcher), RecordStage::Receiving(_, boards)) = (&mut self.watcher, &self.stage)
        else {
            return;
        };
        let first = self.logs.first().map(|log| log.sender);
        let is_first = |board: &&HeardBoard| match first {
            Some(sender) => board.sender == sender,
            None => !board.frames.is_empty(),
        };
        let waiting = boards.heard().iter().find(is_first).map_or(&[][..], |board| &board.frames);
        if let new @ [_, ..] = &waiting[self.shown..] {
            watcher.see(new);
        }
        self.shown = waiting.len();
    }

    /// Writes what waits.
    fn flush(&mut self) -> Result<(), RecordError> {
        if let Some(raw) = &mut self.raw {
            raw.flush()?;
        }
        self.show();
        self.shown = 0;
        let RecordStage::Receiving(protocol, boards) = &mut self.stage else { return Ok(()) };
        let numbered = matches!(protocol, Protocol::Packets(_));
        // Also where no frame has come since: those that wait for a label may be written next.
        if let Some(first) = self.logs.first_mut() {
            first.mark(self.marks.drain(..));
            first.label(self.labels.drain(..));
            first.settle(self.settled);
        }
        for board in boards.heard_mut().iter_mut().filter(|board| !board.frames.is_empty()) {
            let found = self.logs.iter().position(|log| log.sender == board.sender);
            let at = match found {
                Some(at) => at,
                None => {
                    let log = log_of(&mut self.log, self.log_place.as_ref(), board.sender)?;
                    let waits = self.options.labels && self.logs.is_empty();
                    self.logs.push(BoardLog::new(board.sender, log, waits));
                    self.logs.len() - 1
                }
            };
            self.logs[at].write(&mut board.frames, numbered, self.options)?;
        }
        Ok(())
    }

    /// Does what the watcher wants. A log ends with all that was seen before that.
    fn follow(&mut self) -> Result<(), RecordError> {
        while let Some(command) = self.watcher.as_mut().and_then(|watcher| watcher.next_command()) {
            let next = match command {
                RecordCommand::Mark { index, number } => {
                    self.marks.push((index, number));
                    continue;
                }
                RecordCommand::Label(label) => {
                    self.labels.push(label);
                    continue;
                }
                RecordCommand::Settled(index) => {
                    self.settled = Some(index);
                    continue;
                }
                RecordCommand::Record(writer) => Some(writer),
                RecordCommand::StopLog => None,
            };
            self.flush()?;
            self.logs.iter_mut().try_for_each(BoardLog::close)?;
            if let Some(log) = self.log.take() {
                log.close()?;
            }
            self.log_place = next.as_ref().map(AppendWriter::place);
            self.log = next;
            for board in &mut self.logs {
                board.log = log_of(&mut self.log, self.log_place.as_ref(), board.sender)?;
            }
        }
        Ok(())
    }

    /// Takes what the end of the stream gives free, and writes all.
    fn finish(&mut self, source: &Source) -> Result<(), RecordError> {
        let recognised = match &mut self.stage {
            RecordStage::Receiving(..) => Ok(()),
            RecordStage::Recognising(recognition) => {
                let recognised = recognition.finish();
                self.recognised(recognised, source)
            }
        };
        if let RecordStage::Receiving(_, boards) = &mut self.stage {
            boards.finish();
        }
        // Marks and labels that were set just before the end.
        let followed = self.follow();
        self.flush()?;
        self.logs.iter_mut().try_for_each(BoardLog::finish)?;
        followed?;
        recognised?;
        let source_name = || source.name().to_owned();
        match (self.bytes, self.frames()) {
            (0, _) => Err(RecordError::Silence { source_name: source_name() }),
            (_, 0) => Err(RecordError::NotStreaming { source_name: source_name() }),
            _ => Ok(()),
        }
    }

    /// Frames of all boards so far.
    fn frames(&self) -> u64 {
        self.logs.iter().map(|log| log.frames).sum::<u64>() + self.waiting() as u64
    }

    fn waiting(&self) -> usize {
        match &self.stage {
            RecordStage::Recognising(_) => 0,
            RecordStage::Receiving(_, boards) => {
                boards.heard().iter().map(|board| board.frames.len()).sum()
            }
        }
    }

    fn progress(&self, source: &Source, rate_hz: f64) -> RecordingProgress {
        let (protocol, losses) = self.state();
        RecordingProgress {
            elapsed: source.elapsed(),
            rate_hz,
            frames: self.frames(),
            bytes: self.bytes,
            waiting: self.waiting(),
            losses,
            protocol,
            connected: source.is_connected(),
            wrench: self.logs.first().and_then(BoardLog::newest_wrench),
        }
    }

    fn state(&self) -> (Option<Protocol>, Losses) {
        match &self.stage {
            RecordStage::Recognising(_) => (None, Losses::default()),
            RecordStage::Receiving(protocol, boards) => (Some(*protocol), boards.losses()),
        }
    }

    fn heard(&self) -> &[HeardBoard] {
        match &self.stage {
            RecordStage::Recognising(_) => &[],
            RecordStage::Receiving(_, boards) => boards.heard(),
        }
    }

    fn losses_of(&self, sender: BoardSource) -> Losses {
        match &self.stage {
            RecordStage::Recognising(_) => Losses::default(),
            RecordStage::Receiving(_, boards) => boards.losses_of(sender),
        }
    }

    fn recorded(&self, source: &Source) -> Recorded {
        let (protocol, losses) = self.state();
        let longest_us = self.logs.iter().map(BoardLog::board_time_us).max().unwrap_or(0);
        Recorded {
            framing: protocol.map(protocol_name),
            frames: self.frames(),
            bytes: self.bytes,
            board_time_s: longest_us as f64 / 1e6,
            elapsed_s: source.elapsed().as_secs_f64(),
            losses,
            other_content: self.logs.iter().map(BoardLog::other_content).sum(),
            reconnections: source.reconnections,
            boot: self.heard().iter().find_map(|board| board.reception().boot()),
            boards: match &self.logs[..] {
                [] | [_] => Vec::new(),
                several => {
                    several.iter().map(|log| log.recorded(self.losses_of(log.sender))).collect()
                }
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::board_log::MOST_WAITING;
    use super::*;
    use shared_proto::{Packet, Sample, Values};
    use std::collections::VecDeque;

    /// A watcher that wants these things.
    #[derive(Debug)]
    struct Wants(VecDeque<RecordCommand>);

    impl Watcher for Wants {
        fn see(&mut self, _: &[BoardFrame]) {}

        fn next_command(&mut self) -> Option<RecordCommand> {
            self.0.pop_front()
        }
    }

    fn wants(commands: impl IntoIterator<Item = RecordCommand>) -> Option<Box<dyn Watcher>> {
        Some(Box::new(Wants(commands.into_iter().collect())))
    }

    /// Frames of a board at 100 Hz.
    fn bytes_of(frames: std::ops::Range<u16>) -> Vec<u8> {
        let sample = |sequence: u16| Sample {
            sequence,
            clock_us: u32::from(sequence) * 10_000,
            values: Values::Readings([sequence; 8]),
            saturated: 0,
            dropped: 0,
        };
        frames.flat_map(|n| Packet::Sample(sample(n)).encode().to_vec()).collect()
    }

    #[test]
    fn a_label_is_written_however_late_it_comes() {
        let dir = tempfile::tempdir().unwrap();
        let (capture, log) = (dir.path().join("capture"), dir.path().join("log.csv"));
        std::fs::write(&capture, bytes_of(0..2000)).unwrap();
        let source = Source::replay(&capture).unwrap();
        let options = RecordOptions { labels: true, ..RecordOptions::default() };
        let writer = AppendWriter::create(&log, false).unwrap();
        let mut session =
            RecordSession::new(Sinks { log: Some(writer), ..Sinks::default() }, &options);
        let rows = || std::fs::read_to_string(&log).unwrap().lines().skip(1).count();
        session.take(&bytes_of(0..1000), Duration::ZERO, &source).unwrap();
        session.flush().unwrap();
        assert_eq!(rows(), 0, "all may still be labelled");
        session.watcher = wants([RecordCommand::Settled(400)]);
        session.follow().unwrap();
        session.take(&bytes_of(1000..1500), Duration::ZERO, &source).unwrap();
        session.flush().unwrap();
        // The rows themselves wait for the few frames after them, whose channels they are brought to one time with.
        assert!((390..=400).contains(&rows()), "{} rows", rows());
        // Eleven seconds late, and no frame comes after it.
        let label = FrameLabel { from: 400, until: 499, group: "ahead".to_owned() };
        session.watcher = wants([RecordCommand::Label(label), RecordCommand::StopLog]);
        session.follow().unwrap();
        let text = std::fs::read_to_string(&log).unwrap();
        assert_eq!(text.lines().filter(|line| line.contains("ahead")).count(), 100);
        assert!(rows() >= 1400, "{} rows", rows());
    }

    #[test]
    fn frames_that_nobody_settles_do_not_wait_for_ever() {
        let dir = tempfile::tempdir().unwrap();
        let (capture, log) = (dir.path().join("capture"), dir.path().join("log.csv"));
        std::fs::write(&capture, bytes_of(0..10_000)).unwrap();
        let options = RecordOptions { labels: true, ..RecordOptions::default() };
        let label = FrameLabel { from: 0, until: 9_999, group: "late".to_owned() };
        let sinks = Sinks {
            log: Some(AppendWriter::create(&log, false).unwrap()),
            raw: None,
            watcher: wants([RecordCommand::Label(label)]),
        };
        let mut source = Source::replay(&capture).unwrap();
        record(&mut source, sinks, &options, &AtomicBool::new(false), &mut |_| {}).unwrap();
        let text = std::fs::read_to_string(&log).unwrap();
        let labelled = text.lines().filter(|line| line.contains("late")).count();
        assert_eq!(text.lines().count(), 10_001);
        assert!((MOST_WAITING..10_000).contains(&labelled), "{labelled} rows");
    }
}
