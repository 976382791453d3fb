//! `shellcal live`: forces as they come, in the terminal or in a browser.

mod browser;
mod canvas;
mod cells;
mod guide_screen;
mod log_files;
mod screen;
mod view;

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use board_link::recording::{LiveForces, PROTOCOLS};
use board_link::{LogSink, RecordOptions, RecordingProgress, Sinks, Source, Watcher, record};
use frame_stream::StreamOptions;
use live_view::{Guide, LiveModel};
use log_file::Log;
use serde_json::json;
use shared_proto::Protocol;
use shell_data::wrench::Axes;
use shellcal::workflow::live::{Feed, LiveRows, LiveSession, LogSeries, guide_through, play};

use super::choices::one_of;
use super::live_forces::LiveForceArgs;
use super::mapping::MappingArgs;
use super::ports::is_port;
use super::record::parse_duration;
use super::serial::SerialArgs;
use super::stream::speed;
use super::streaming::{self, StreamToArgs};
use crate::files::{InputPath, OutputPath};
use crate::printer::Printer;
use crate::signals;
use log_files::{LogFiles, Until};
use view::Appearance;

const EXAMPLES: &str = "\
Examples:
  shellcal live /dev/ttyUSB0 --start --calibration calibration.json
  shellcal live run3.csv --calibration calibration.json --speed 4
  shellcal live /dev/ttyUSB0 --start --calibration calibration.json --serve
  shellcal live /dev/ttyUSB0 --start --plan plan.csv -o session.csv

Keys: t and T tare and untare what is shown, space pauses, + and - zoom in time, m marks a moment,
r starts and ends a recording, n goes on to the next planned load, b goes back, q ends";

#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct LiveArgs {
    /// Serial port, or a log to play; `shellcal ports` lists the ports
    #[arg(value_name = "PORT|LOG")]
    name: InputPath,

    #[command(flatten)]
    forces: LiveForceArgs,

    #[command(flatten)]
    stream: StreamToArgs,

    /// Record from the start; `r` ends it, and begins a next log with a number in its name
    #[arg(long, short, value_name = "LOG")]
    output: Option<OutputPath>,

    /// Replace the log if it is there
    #[arg(long, requires = "output")]
    overwrite: bool,

    /// Guide through the loads of a table, as `shellcal plan --output` writes it: the next load in large type, whether
    /// it is held still; rows of a load that was held for 2 s get its label in a column `group` of the log
    #[arg(long, value_name = "PLAN.csv")]
    plan: Option<InputPath>,

    /// Tell the board to start streaming, and to stop at the end
    #[arg(long)]
    start: bool,

    /// Span of time that is shown, s
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    window: f64,

    /// How many times as fast a log is played
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = speed())]
    speed: f64,

    /// End after so many seconds
    #[arg(long, value_name = "S", value_parser = parse_duration)]
    duration: Option<Duration>,

    /// Show it in a browser, not in the terminal, at the address that is printed; at 127.0.0.1 unless told
    /// otherwise, on a free port where that is 0
    #[arg(
        long,
        value_name = "IP:PORT",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = browser::LOOPBACK
    )]
    serve: Option<SocketAddr>,

    /// Draw with ASCII [default: where the locale is not UTF-8]
    #[arg(long, conflicts_with = "serve")]
    ascii: bool,

    /// How the bytes are framed; recognised unless given
    #[arg(long, value_name = "FRAMING", value_parser = one_of(&PROTOCOLS))]
    framing: Option<Protocol>,

    #[command(flatten)]
    serial: SerialArgs,

    #[command(flatten)]
    mapping: MappingArgs,
}

impl LiveArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        let forces = self.forces.read(printer)?;
        let ranges = forces.as_ref().and_then(|forces| forces.calibration.valid_range.clone());
        let rows = LiveRows::new(forces.clone())?;
        let stop = signals::stop_flag()?;
        let (feed, done) = (Feed::default(), Arc::new(AtomicBool::new(false)));
        let name = self.name.display().to_string();
        let is_port = is_port(&self.name);
        let mut logs = self.logs(is_port)?;
        let guide = self.guide(is_port)?;
        // What cannot work is said before the screen is taken.
        let (forces_of_stream, from_log) = (forces.clone(), !is_port);
        let stream =
            StreamOptions { forces: forces_of_stream, from_log, ..StreamOptions::default() };
        let view = Box::new(feed.clone());
        let (watcher, streamed) = self.stream.watch(printer, stream, Some(view))?;
        let browser = self.serve.map(browser::start).transpose()?;
        if browser.is_none() {
            view::require_terminal()?;
        }
        let first =
            logs.as_mut().filter(|_| self.output.is_some()).map(LogSeries::begin).transpose()?;
        let calibrated = forces.as_ref().map(|forces| forces.calibration.axes);
        let (source, recorded) = match is_port {
            true => (self.record(&name, forces, first, watcher, &feed, &done)?, Axes::ALL),
            false => self.play(watcher, &feed, &done)?,
        };
        // Without a calibration a wrench is the board's or the log's own.
        let axes = calibrated.unwrap_or(recorded);
        let model = LiveModel::new(ranges, self.window, axes);
        let mut session = LiveSession::new(model, guide, rows, feed, logs, name);
        let until = Until {
            is_stopped: &|| stop.load(Ordering::Relaxed) || done.load(Ordering::Relaxed),
            is_over: &|| source.is_finished(),
            started: Instant::now(),
            duration: self.duration,
        };
        let shown = match browser {
            Some((server, address)) => announce(printer, server.address(), &address)
                .and_then(|()| browser::run(&mut session, server, &until)),
            None => {
                let is_ascii = self.ascii || !view::is_utf8();
                let look = Appearance { is_ascii, color: printer.is_colored() };
                view::run(&mut session, look, &until)
            }
        };
        done.store(true, Ordering::Relaxed);
        let ended =
            source.join().unwrap_or_else(|_| Err(anyhow::anyhow!("the recording panicked")));
        shown?;
        streaming::finish(printer, streamed.as_ref())?;
        for line in session.report() {
            match printer.json() {
                true => printer.note(line),
                false => printer.line(line)?,
            }
        }
        ended
    }

    /// The logs that are written; `None` where nothing can be recorded.
    fn logs(&self, is_port: bool) -> anyhow::Result<Option<LogSeries>> {
        match (is_port, &self.output) {
            (true, path) => {
                let path = path.as_ref().map(|path| path.to_path_buf());
                let files = LogFiles { path, overwrite: self.overwrite };
                Ok(Some(LogSeries::new(Box::new(files))))
            }
            (false, None) => Ok(None),
            (false, Some(_)) => anyhow::bail!("a log that is played is not recorded again"),
        }
    }

    /// The guide through a plan.
    fn guide(&self, is_port: bool) -> anyhow::Result<Option<Guide>> {
        let Some(path) = &self.plan else { return Ok(None) };
        anyhow::ensure!(
            !is_port || self.output.is_some(),
            "`--plan` labels the rows of a log: name one with `--output`"
        );
        let table = super::plan::read_table(path)?;
        Ok(Some(guide_through(&table)))
    }

    /// Records on a thread of its own, whatever the view does.
    fn record(
        &self,
        port: &str,
        forces: Option<LiveForces>,
        log: Option<Box<dyn LogSink>>,
        watcher: Option<Box<dyn Watcher>>,
        feed: &Feed,
        done: &Arc<AtomicBool>,
    ) -> anyhow::Result<RunningSource> {
        let options = RecordOptions {
            protocol: self.framing,
            forces,
            start: self.start.then(|| self.serial.uplink(self.framing)).transpose()?,
            labels: self.plan.is_some(),
            ..RecordOptions::default()
        };
        let mut source = Source::port(self.serial.port(port), true)?;
        let feed = feed.clone();
        spawn("record", done, move |done| {
            let sinks = Sinks { log, raw: None, watcher };
            let mut tell = |it: &RecordingProgress| feed.state().progress = Some(it.clone());
            record(&mut source, sinks, &options, done, &mut tell)?;
            Ok(())
        })
    }

    fn play(
        &self,
        mut watcher: Option<Box<dyn Watcher>>,
        feed: &Feed,
        done: &Arc<AtomicBool>,
    ) -> anyhow::Result<(RunningSource, Axes)> {
        let log = Log::open(&self.name, &self.mapping.mapping())?;
        let (wants_readings, axes) = (self.forces.is_given(), log.axes());
        let read = self.mapping.read_options();
        let (feed, speed) = (feed.clone(), self.speed);
        let source = spawn("play", done, move |done| {
            let is_held = || feed.state().is_held;
            let mut see = |frames: &_| watcher.iter_mut().for_each(|it| it.see(frames));
            play(&log, &read, wants_readings, speed, &is_held, done, &mut see)?;
            Ok(())
        })?;
        Ok((source, axes))
    }
}

/// Says where to look, and what others who can may do.
fn announce(printer: &Printer, at: SocketAddr, address: &str) -> anyhow::Result<()> {
    if !at.ip().is_loopback() {
        printer.warning(
            "other machines reach this view, and what is sent is not encrypted: whoever has its address can look on \
             and end a recording",
        );
    }
    match printer.json() {
        true => printer.document(&json!({ "address": address })),
        false => {
            printer.line(format!("live at {address}"))?;
            printer.line("Ctrl-C ends it")
        }
    }
}

type RunningSource = thread::JoinHandle<anyhow::Result<()>>;

/// Runs a source on a thread of this name. One that fails ends the view, which would hide why.
fn spawn(
    name: &str,
    done: &Arc<AtomicBool>,
    source: impl FnOnce(&AtomicBool) -> anyhow::Result<()> + Send + 'static,
) -> anyhow::Result<RunningSource> {
    let done = Arc::clone(done);
    let run = move || {
        let ended = source(&done);
        done.fetch_or(ended.is_err(), Ordering::Relaxed);
        ended
    };
    Ok(thread::Builder::new().name(name.to_owned()).spawn(run)?)
}
