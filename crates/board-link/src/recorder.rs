//! The core of a recording, without port and clock: [`record`](super::record()) or a web page feeds
//! it.

use std::time::{Duration, Instant};

use serde::Serialize;
use shared_proto::{Boot, Command, Identity, Protocol};

use super::board_log::{BoardLog, RecordedBoard};
use super::capture;
use super::record_options::{
    RecordCommand, RecordError, RecordOptions, RecordingProgress, Watcher,
};
use super::resume::commands;
use super::{LinkError, LogSink};
use crate::recording::{
    Annotations, BoardSource, Boards, HeardBoard, Losses, NoFrame, Recognition, RecordedReference,
    ReferenceBeside, ReferenceInput, other_version, protocol_name,
};

/// Time for which frames wait for earlier ones that may arrive late. A kill loses these frames and, at the start, the
/// bytes held for the detection of the protocol.
const FLUSH: Duration = Duration::from_millis(400);

/// Maximum number of waiting frames; bounds memory in a replay.
const BATCH: usize = 4096;

#[derive(Debug, Default)]
pub struct Sinks {
    /// The log of the first board. Logs of others are created next to it.
    pub log: Option<Box<dyn LogSink>>,
    /// The bytes as they arrive, with their times ([`CaptureReader`](super::CaptureReader)).
    pub raw: Option<Box<dyn LogSink>>,
    pub watcher: Option<Box<dyn Watcher>>,
    /// A reference sensor, whose forces go to the first board's log.
    pub reference: Option<ReferenceInput>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Recorded {
    pub framing: Option<&'static str>,
    pub frames: u64,
    pub bytes: u64,
    /// The board's time from the first frame to the last, s.
    pub board_time_s: f64,
    pub elapsed_s: f64,
    #[serde(flatten)]
    pub losses: Losses,
    /// Frames left out because they hold wrenches but the first frame held readings, or vice versa.
    pub other_content: u64,
    pub reconnections: u64,
    #[serde(skip)]
    pub boot: Option<Boot>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference: Option<RecordedReference>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub boards: Vec<RecordedBoard>,
}

#[derive(Debug, Default)]
pub struct Recorder {
    name: String,
    recognition: Recognition,
    receiving: Option<(Protocol, Boards)>,
    options: RecordOptions,
    sinks: Sinks,
    reference: Option<ReferenceBeside>,
    now: Duration,
    shown: usize,
    annotations: Annotations,
    /// Logs in order of the boards' first frames.
    logs: Vec<BoardLog>,
    bytes: u64,
    flushed_at: Duration,
    observed: u64,
}

impl Recorder {
    pub fn new(name: &str, sinks: Sinks, options: RecordOptions) -> Self {
        let recognition = Recognition::new(options.protocol);
        Self { name: name.to_owned(), recognition, options, sinks, ..Self::default() }
    }

    pub(crate) fn start_reference(&mut self, epoch: Instant) {
        let input = self.sinks.reference.take();
        self.reference = input.map(|input| ReferenceBeside::new(input, epoch));
    }

    /// Returns the bytes to send so that every board streams; none without [`RecordOptions::start`].
    pub fn commands(&mut self, arrival: Option<Duration>) -> Vec<u8> {
        let Some(uplink) = &self.options.start else { return Vec::new() };
        let heard = self.receiving.as_mut().map_or(&mut [][..], |(_, boards)| &mut boards.heard);
        commands(uplink, heard, arrival.unwrap_or_default())
    }

    pub fn last_commands(&self) -> Vec<u8> {
        let Some(uplink) = &self.options.start else { return Vec::new() };
        // Sent twice in case the first is lost.
        (0..2).flat_map(|number| uplink.encode(number, None, Command::Stop)).collect()
    }

    pub fn identities(&self) -> impl Iterator<Item = Identity> {
        heard(&self.receiving).iter().filter_map(|board| board.reception.identity)
    }

    /// Writes the data due at `now`, a time since the start. Returns the progress about twice a second.
    pub fn tend(
        &mut self,
        now: Duration,
        arrival: Option<Duration>,
    ) -> Result<Option<RecordingProgress>, RecordError> {
        self.now = now;
        let wrench = self.reference.as_mut().and_then(ReferenceBeside::listen);
        if let (Some(watcher), Some(wrench)) = (&mut self.sinks.watcher, wrench) {
            watcher.see_reference(wrench);
        }
        let since = now.saturating_sub(self.flushed_at);
        if since < FLUSH {
            if self.waiting() >= BATCH {
                self.flush()?;
            }
            return Ok(None);
        }
        self.flushed_at = now;
        self.follow()?;
        self.flush()?;
        let frames = self.frames();
        let rate_hz = (frames - self.observed) as f64 / since.as_secs_f64();
        self.observed = frames;
        let (protocol, losses) = self.state();
        let rows = self.logs.first().and_then(|log| log.rows.as_ref());
        Ok(Some(RecordingProgress {
            elapsed: now,
            rate_hz,
            frames,
            bytes: self.bytes,
            losses: losses.unwrap_or_default(),
            protocol,
            connected: true,
            wrench: rows.and_then(|rows| rows.forces.as_ref()?.newest()),
            commands: self.commands(arrival),
        }))
    }

    /// Takes bytes that arrived at `now`, a time since the start, and were sent about at `arrival`.
    /// Fails with [`RecordError::NoFrame`] once frames are unlikely to come.
    pub fn take(
        &mut self,
        bytes: &[u8],
        now: Duration,
        arrival: Option<Duration>,
    ) -> Result<(), RecordError> {
        let piece = |is_first| capture::piece(bytes, arrival, is_first);
        let is_first = self.bytes == 0;
        let kept = self.sinks.raw.as_mut().map_or(Ok(()), |raw| raw.append(&piece(is_first)));
        self.bytes += bytes.len() as u64;
        self.now = now;
        if let Some((protocol, boards)) = &mut self.receiving {
            boards.feed(bytes, arrival);
            *protocol = boards.protocol();
            self.show();
        } else {
            let recognised = self.recognition.feed(bytes, now);
            self.recognised(recognised)?;
        }
        Ok(kept?)
    }

    fn recognised(
        &mut self,
        recognised: Result<Option<(Protocol, Vec<u8>)>, NoFrame>,
    ) -> Result<(), RecordError> {
        if let Some((protocol, bytes)) = recognised.map_err(|problem| self.no_frame(problem))? {
            if let Some(version) = other_version(protocol, &bytes) {
                return Err(LinkError::OtherVersion(version).into());
            }
            let mut boards = Boards::new(protocol);
            boards.feed(&bytes, None);
            self.receiving = Some((boards.protocol(), boards));
            self.show();
        }
        Ok(())
    }

    fn no_frame(&self, problem: NoFrame) -> RecordError {
        RecordError::NoFrame { source_name: self.name.clone(), problem }
    }

    fn show(&mut self) {
        if self.sinks.watcher.is_none() && self.reference.is_none() {
            return;
        }
        let first = self.logs.first().map(|log| log.sender);
        let is_first = |board: &&HeardBoard| match first {
            Some(sender) => board.sender == sender,
            None => !board.frames.is_empty(),
        };
        let waiting = heard(&self.receiving).iter().find(is_first);
        let waiting = waiting.map_or(&[][..], |board| &board.frames);
        if let new @ [_, ..] = &waiting[self.shown..] {
            if let Some(reference) = &mut self.reference {
                reference.see(new, self.now.as_secs_f64());
            }
            self.sinks.watcher.iter_mut().for_each(|watcher| watcher.see(new));
        }
        self.shown = waiting.len();
    }

    fn flush(&mut self) -> Result<(), RecordError> {
        self.show();
        self.shown = 0;
        let Some((protocol, mut boards)) = self.receiving.take() else { return Ok(()) };
        let is_numbered = matches!(protocol, Protocol::Packets(_));
        let with_frames = boards.heard.iter_mut().filter(|board| !board.frames.is_empty());
        // One log that fails does not stop the others.
        let written: Vec<_> = with_frames.map(|board| self.write(board, is_numbered)).collect();
        self.receiving = Some((protocol, boards));
        written.into_iter().collect()
    }

    /// Writes a board's frames to its log, and creates the log for the first.
    fn write(&mut self, board: &mut HeardBoard, is_numbered: bool) -> Result<(), RecordError> {
        let sender = board.sender;
        let known = self.logs.iter().position(|log| log.sender == sender);
        let at = known.unwrap_or(self.logs.len());
        if known.is_none() {
            let log = log_of(&mut self.sinks.log, &self.logs, sender)?;
            let waits = self.options.labels && self.logs.is_empty();
            let annotations = std::mem::take(&mut self.annotations);
            let new = BoardLog { sender, log, waits, annotations, ..BoardLog::default() };
            self.logs.push(new);
        }
        // A calibration belongs to one sensor: the first board's.
        let forces = self.options.forces.as_ref().filter(|_| at == 0);
        let reference = self.reference.as_mut().filter(|_| at == 0);
        let beside = (reference, self.now.as_secs_f64());
        self.logs[at].write(&mut board.frames, is_numbered, (forces, &self.options), beside)
    }

    /// Executes the watcher's commands. Frames that arrived before a command go to the old log.
    fn follow(&mut self) -> Result<(), RecordError> {
        while let Some(command) =
            self.sinks.watcher.as_mut().and_then(|watcher| watcher.next_command())
        {
            let first = self.logs.first_mut();
            let annotations = first.map_or(&mut self.annotations, |log| &mut log.annotations);
            let next = match command {
                RecordCommand::Mark { index, number } => {
                    annotations.marks.push_back((index, number));
                    continue;
                }
                RecordCommand::Label(label) => {
                    annotations.labels.push(label);
                    continue;
                }
                RecordCommand::Settled(index) => {
                    annotations.settled = Some(index);
                    continue;
                }
                RecordCommand::Record(writer) => Some(writer),
                RecordCommand::StopLog => None,
            };
            self.flush()?;
            for (at, log) in self.logs.iter_mut().enumerate() {
                log.close(self.reference.as_mut().filter(|_| at == 0))?;
            }
            if let Some(log) = self.sinks.log.take() {
                log.close()?;
            }
            self.sinks.log = next;
            for at in 0..self.logs.len() {
                self.logs[at].log = log_of(&mut self.sinks.log, &self.logs, self.logs[at].sender)?;
            }
        }
        Ok(())
    }

    /// Decodes the remaining data, and writes all frames. Fails with [`RecordError`], after
    /// everything that can be written is written.
    pub fn finish(&mut self) -> Result<(), RecordError> {
        let recognised = self.recognition.finish();
        let recognised = self.recognised(recognised);
        if let Some((_, boards)) = &mut self.receiving {
            boards.finish();
        }
        // Includes marks and labels from just before the end.
        let written = [self.follow(), self.flush()];
        if let Some(reference) = &mut self.reference {
            reference.listen();
        }
        let mut reference = self.reference.as_mut();
        let finished: Vec<_> =
            self.logs.iter_mut().map(|log| log.finish(reference.take())).collect();
        let all = written.into_iter().chain(finished).chain([recognised]);
        all.collect::<Result<(), _>>()?;
        match (self.bytes, self.frames()) {
            (0, _) => Err(self.no_frame(NoFrame::Silence)),
            (_, 0) => Err(self.no_frame(NoFrame::NotStreaming)),
            _ => Ok(()),
        }
    }

    fn frames(&self) -> u64 {
        self.logs.iter().map(|log| log.frames).sum::<u64>() + self.waiting() as u64
    }

    fn waiting(&self) -> usize {
        heard(&self.receiving).iter().map(|board| board.frames.len()).sum()
    }

    fn state(&self) -> (Option<Protocol>, Option<Losses>) {
        self.receiving.as_ref().map(|(protocol, boards)| (*protocol, boards.losses())).unzip()
    }

    pub fn recorded(&self, elapsed: Duration) -> Recorded {
        let (protocol, losses) = self.state();
        let longest_us = self.logs.iter().map(BoardLog::board_time_us).max().unwrap_or(0);
        Recorded {
            framing: protocol.map(protocol_name),
            frames: self.frames(),
            bytes: self.bytes,
            board_time_s: longest_us as f64 / 1e6,
            elapsed_s: elapsed.as_secs_f64(),
            losses: losses.unwrap_or_default(),
            other_content: self.logs.iter().map(|log| log.other_content).sum(),
            reconnections: 0,
            reference: self.reference.as_ref().map(ReferenceBeside::recorded),
            boot: heard(&self.receiving).iter().find_map(|board| board.reception.boot),
            boards: match (&self.logs[..], &self.receiving) {
                (several @ [_, _, ..], Some((_, boards))) => {
                    several.iter().map(|log| log.recorded(boards.losses_of(log.sender))).collect()
                }
                _ => Vec::new(),
            },
        }
    }

    /// Closes all files, even if closing one fails.
    pub fn close(&mut self) -> Result<(), RecordError> {
        let logs = self.logs.iter_mut().filter_map(|board| board.log.take());
        let sinks = logs.chain(self.sinks.log.take()).chain(self.sinks.raw.take());
        let closed: Vec<_> = sinks.map(|sink| sink.close()).collect();
        Ok(closed.into_iter().collect::<Result<(), _>>()?)
    }
}

fn heard(receiving: &Option<(Protocol, Boards)>) -> &[HeardBoard] {
    receiving.as_ref().map_or(&[], |(_, boards)| &boards.heard)
}

/// Creates the next board's log: the requested log for the first board, logs next to it for others.
fn log_of(
    first: &mut Option<Box<dyn LogSink>>,
    logs: &[BoardLog],
    sender: BoardSource,
) -> Result<Option<Box<dyn LogSink>>, RecordError> {
    match (first.take(), logs.first().and_then(|board| board.log.as_ref())) {
        (Some(log), _) => Ok(Some(log)),
        (None, Some(log)) => Ok(Some(log.beside(&sender.text())?)),
        (None, None) => Ok(None),
    }
}

#[cfg(test)]
mod tests {
    use super::super::board_log::MOST_WAITING;
    use super::super::{AppendWriter, Source, record};
    use super::*;
    use crate::recording::BoardFrame;
    use output_file::OutputError;
    use shared_proto::{Packet, PacketOrigin, Sample, Values};
    use shell_data::block::FrameLabel;
    use std::collections::VecDeque;
    use std::path::Path;
    use std::sync::atomic::AtomicBool;

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
    fn late_labels_are_written() {
        let dir = tempfile::tempdir().unwrap();
        let log = dir.path().join("log.csv");
        let options = RecordOptions { labels: true, ..RecordOptions::default() };
        let writer = AppendWriter::create(&log, false).unwrap();
        let sinks = Sinks { log: Some(Box::new(writer)), ..Sinks::default() };
        let mut session = Recorder::new("port", sinks, options);
        let rows = || std::fs::read_to_string(&log).unwrap().lines().skip(1).count();
        session.take(&bytes_of(0..1000), Duration::ZERO, None).unwrap();
        session.flush().unwrap();
        assert_eq!(rows(), 0, "all may still be labelled");
        session.sinks.watcher = wants([RecordCommand::Settled(400)]);
        session.follow().unwrap();
        session.take(&bytes_of(1000..1500), Duration::ZERO, None).unwrap();
        session.flush().unwrap();
        // The last rows wait for the few frames that alignment needs.
        assert!((390..=400).contains(&rows()), "{} rows", rows());
        let label = FrameLabel { from: 400, until: 499, group: "ahead".to_owned() };
        session.sinks.watcher = wants([RecordCommand::Label(label), RecordCommand::StopLog]);
        session.follow().unwrap();
        let text = std::fs::read_to_string(&log).unwrap();
        assert_eq!(text.lines().filter(|line| line.contains("ahead")).count(), 100);
        assert!(rows() >= 1400, "{} rows", rows());
    }

    #[derive(Debug)]
    struct FullLog(std::path::PathBuf);

    impl LogSink for FullLog {
        fn append(&mut self, _: &[u8]) -> Result<(), OutputError> {
            Err(OutputError::failed(&self.0, std::io::ErrorKind::StorageFull.into()))
        }

        fn close(self: Box<Self>) -> Result<(), OutputError> {
            Ok(())
        }

        fn path(&self) -> &Path {
            &self.0
        }

        fn beside(&self, _: &str) -> Result<Box<dyn LogSink>, OutputError> {
            Ok(Box::new(AppendWriter::create(&self.0, false)?))
        }
    }

    #[test]
    fn a_log_that_fails_leaves_those_of_other_boards_complete() {
        let dir = tempfile::tempdir().unwrap();
        let log = dir.path().join("second.csv");
        let sinks = Sinks { log: Some(Box::new(FullLog(log.clone()))), ..Sinks::default() };
        let mut session = Recorder::new("port", sinks, RecordOptions::default());
        let frame = |sequence: u16, board| {
            let clock_us = u32::from(sequence) * 10_000;
            let values = Values::Readings([board; 8]);
            let sample = Sample { sequence, clock_us, values, saturated: 0, dropped: 0 };
            Packet::Sample(sample).encode_from(PacketOrigin { board, start: 1 }).to_vec()
        };
        let bytes: Vec<u8> = (0..500).flat_map(|n| [frame(n, 7), frame(n, 9)].concat()).collect();
        session.take(&bytes, Duration::ZERO, None).unwrap();
        let error = session.finish().unwrap_err();
        assert!(matches!(error, RecordError::Output(_)), "{error}");
        session.close().unwrap();
        assert_eq!(std::fs::read_to_string(log).unwrap().lines().count(), 501);
    }

    /// A kill loses at most the last second. At the start, frames wait up to 1.2 s for the board's timing.
    #[test]
    fn frames_are_written_within_a_second() {
        let dir = tempfile::tempdir().unwrap();
        let log = dir.path().join("log.csv");
        let writer = AppendWriter::create(&log, false).unwrap();
        let sinks = Sinks { log: Some(Box::new(writer)), ..Sinks::default() };
        let mut session = Recorder::new("port", sinks, RecordOptions::default());
        let rows = || std::fs::read_to_string(&log).unwrap().lines().skip(1).count();
        for frame in 0..1000 {
            let now = Duration::from_millis(10 * u64::from(frame));
            session.take(&bytes_of(frame..frame + 1), now, None).unwrap();
            session.tend(now, None).unwrap();
            let due = if frame < 220 { 0 } else { usize::from(frame) - 99 };
            assert!(rows() >= due, "{} rows at {now:?}", rows());
        }
    }

    #[test]
    fn unsettled_frames_are_written_after_a_timeout() {
        let dir = tempfile::tempdir().unwrap();
        let (capture, log) = (dir.path().join("capture"), dir.path().join("log.csv"));
        std::fs::write(&capture, bytes_of(0..10_000)).unwrap();
        let options = RecordOptions { labels: true, ..RecordOptions::default() };
        let label = FrameLabel { from: 0, until: 9_999, group: "late".to_owned() };
        let sinks = Sinks {
            log: Some(Box::new(AppendWriter::create(&log, false).unwrap())),
            raw: None,
            reference: None,
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
