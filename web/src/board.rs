//! A board at a serial port of the page, which owns the port and the clock. Input: bytes and the
//! user's orders. Output: pictures, pieces of logs, and bytes to send.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use board_link::recording::{LiveForces, PROTOCOLS, RunningForces};
use board_link::{
    EVERY_MODULE, LogSink, RecordError, RecordOptions, Recorder, Sinks, Uplink, board_text,
    serial_text,
};
use calibration_file::CalibrationFile;
use forces::ForceOptions;
use live_view::LiveDisplay;
use load_table::HungLoads;
use output_file::OutputError;
use serde::Deserialize;
use serde_json::{Value, json};
use shared_proto::{Command, Framing, Identity, Protocol};
use shell_data::lock::lock;
use shell_data::wrench::Axes;
use shellcal::workflow::live::{Feed, LiveAction, LiveSession, LogSeries, guide_through};

use crate::request::FileRef;
use crate::{Answer, Failure};

const WINDOW_S: f64 = 10.0;

#[derive(Deserialize)]
pub(crate) struct Begin {
    name: String,
    /// As for `--framing`; detected if `None`.
    framing: Option<String>,
    /// True to start the board's stream.
    starts: bool,
    /// True to write a log from the first byte on.
    records: bool,
    /// Number of board logs in the page so far; names of new logs continue the numbering.
    logs: usize,
    calibration: Option<FileRef>,
    /// Planned loads for the guide.
    plan: Option<FileRef>,
}

#[derive(Deserialize)]
struct BoardEvents {
    /// Time since the connection began, by a monotonic clock.
    elapsed_ms: f64,
    /// Time since then by the wall clock, which continues while a computer sleeps.
    arrival_ms: f64,
    order: Option<String>,
    draws: bool,
    ends: bool,
}

pub struct BoardSession {
    recorder: Recorder,
    session: LiveSession,
    feed: Feed,
    logs: PageLogs,
}

impl BoardSession {
    /// Begins a connection; the answer contains the first bytes to send.
    pub fn begin(request: &[u8], files: &[Arc<[u8]>]) -> (Option<Self>, Answer) {
        let begin = || serde_json::from_slice::<Begin>(request)?.run(files);
        match begin() {
            Ok((session, commands)) => (Some(session), json!({ "send": commands }).into()),
            Err(failure) => (None, failure.into()),
        }
    }

    /// Takes a turn as requested in JSON. The answer contains the bytes to send, a picture if
    /// requested, the board's identity, and the names of completed logs; its files are pieces of
    /// logs, to be appended to the log of that name. An error ends the connection: the board is
    /// told to stop, and the files keep the data received before.
    pub fn turn(&mut self, request: &[u8], bytes: &[u8]) -> Answer {
        let mut document = self.take(request, bytes).unwrap_or_else(|failure| {
            // Received data are kept; the first failure is the one reported.
            let _ = self.recorder.finish();
            let _ = self.recorder.close();
            let mut document = Answer::from(failure).document;
            document["send"] = json!(self.recorder.last_commands());
            document
        });
        let identities: Vec<Value> = self.recorder.identities().map(in_words).collect();
        let PageState { pieces, ended } = std::mem::take(&mut *lock(&self.logs.0));
        document["boards"] = Value::Array(identities);
        document["ended"] = json!(ended);
        Answer { document, files: pieces }
    }

    fn take(&mut self, request: &[u8], bytes: &[u8]) -> Result<Value, Failure> {
        let turn: BoardEvents = serde_json::from_slice(request)?;
        let [elapsed, arrival] = [turn.elapsed_ms, turn.arrival_ms].map(duration);
        let mut commands = Vec::new();
        self.recorder.take(bytes, elapsed, Some(arrival))?;
        if let Some(action) = turn.order.as_deref().and_then(LiveAction::named) {
            self.session.obey(action);
        }
        if let Some(progress) = self.recorder.tend(elapsed, Some(arrival))? {
            commands.clone_from(&progress.commands);
            self.feed.state().progress = Some(progress);
        }
        if turn.ends {
            commands.extend(self.recorder.last_commands());
            // Labels loads that were held until the end.
            self.session.advance(elapsed, true).map_err(RecordError::from)?;
            self.recorder.finish()?;
            let recorded = self.recorder.recorded(elapsed);
            self.recorder.close()?;
            return Ok(json!({ "send": commands, "recorded": recorded }));
        }
        self.session.advance(elapsed, false).map_err(RecordError::from)?;
        let shown = turn.draws.then(|| self.session.shown());
        Ok(json!({ "send": commands, "shown": shown }))
    }
}

impl Begin {
    fn run(self, files: &[Arc<[u8]>]) -> Result<(BoardSession, Vec<u8>), Failure> {
        let protocol = self.framing.as_deref().map(protocol_named).transpose()?;
        let framing = protocol.map_or(Some(Framing::Cobs), Protocol::framing);
        let uplink = framing.map(|framing| Uplink { framing, to: EVERY_MODULE });
        let calibration = self.calibration.map(|file| file.parsed(files, CalibrationFile::parse));
        let forces =
            calibration.transpose()?.map(|CalibrationFile { calibration, .. }| LiveForces {
                calibration,
                options: ForceOptions::default().with_delay(true),
                trained: None,
                tare_doubt: Default::default(),
            });
        let parse = |bytes: &[u8]| HungLoads::parse(&String::from_utf8_lossy(bytes));
        let plan = self.plan.map(|file| file.parsed(files, parse)).transpose()?;
        let ranges = forces.as_ref().and_then(|forces| forces.calibration.valid_range.clone());
        let axes = forces.as_ref().map_or(Axes::ALL, |forces| forces.calibration.axes);
        let (logs, made_before) = (PageLogs::default(), self.logs);
        let maker = logs.clone();
        let next_log = move |made| Ok(maker.numbered(made_before + made));
        let mut series = LogSeries::new(Box::new(next_log));
        let log = self.records.then(|| series.begin()).transpose()?;
        let running = forces.clone().map(RunningForces::new).transpose();
        let (feed, running) = (Feed::default(), running.map_err(RecordError::from)?);
        let options = RecordOptions {
            protocol,
            forces,
            start: uplink.filter(|_| self.starts),
            labels: plan.is_some(),
            ..RecordOptions::default()
        };
        let sinks = Sinks { log, watcher: Some(Box::new(feed.clone())), ..Sinks::default() };
        let mut recorder = Recorder::new(&self.name, sinks, options);
        let mut commands = recorder.commands(None);
        let identify = |uplink: Uplink| uplink.encode(0, None, Command::Identify);
        commands.extend(uplink.map(identify).unwrap_or_default());
        let display = LiveDisplay::new(ranges, WINDOW_S, axes);
        let (guide, feed_end) = (plan.as_ref().map(guide_through), feed.clone());
        let session = LiveSession::new(display, guide, running, feed_end, Some(series), self.name);
        Ok((BoardSession { recorder, session, feed, logs }, commands))
    }
}

fn protocol_named(name: &str) -> Result<Protocol, Failure> {
    let known = PROTOCOLS.iter().find(|(known, ..)| *known == name);
    known
        .map(|(.., protocol)| *protocol)
        .ok_or_else(|| format!("there is no framing `{name}`").into())
}

fn in_words(identity: Identity) -> Value {
    let [major, minor, patch] = identity.firmware;
    json!({
        "board": board_text(identity.board),
        "firmware": format!("{major}.{minor}.{patch}"),
        "serial": serial_text(&identity.serial),
    })
}

fn duration(ms: f64) -> Duration {
    Duration::try_from_secs_f64(ms / 1e3).unwrap_or_default()
}

#[derive(Clone, Debug, Default)]
struct PageLogs(Arc<Mutex<PageState>>);

#[derive(Debug, Default)]
struct PageState {
    pieces: Vec<(String, Vec<u8>)>,
    ended: Vec<String>,
}

#[derive(Debug)]
struct PageLog {
    path: PathBuf,
    is_empty: bool,
    logs: PageLogs,
}

impl PageLogs {
    fn log(&self, name: String) -> Box<dyn LogSink> {
        let (path, logs) = (PathBuf::from(name), self.clone());
        Box::new(PageLog { path, is_empty: true, logs })
    }

    /// Creates a log after `made` others.
    fn numbered(&self, made: usize) -> Box<dyn LogSink> {
        self.log(match made {
            0 => "board.csv".to_owned(),
            made => format!("board-{}.csv", made + 1),
        })
    }
}

impl LogSink for PageLog {
    fn append(&mut self, piece: &[u8]) -> Result<(), OutputError> {
        if !piece.is_empty() {
            self.is_empty = false;
            let piece = (self.path.display().to_string(), piece.to_vec());
            lock(&self.logs.0).pieces.push(piece);
        }
        Ok(())
    }

    fn close(self: Box<Self>) -> Result<(), OutputError> {
        if !self.is_empty {
            lock(&self.logs.0).ended.push(self.path.display().to_string());
        }
        Ok(())
    }

    fn path(&self) -> &Path {
        &self.path
    }

    fn beside(&self, board: &str) -> Result<Box<dyn LogSink>, OutputError> {
        let stem = self.path.file_stem().unwrap_or_default().to_string_lossy();
        Ok(self.logs.log(format!("{stem}-{board}.csv")))
    }
}
