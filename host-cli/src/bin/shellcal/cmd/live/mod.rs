//! `shellcal live`: forces as they arrive, in the terminal or in a browser.

mod cells;
mod guide_screen;
mod screen;
mod view;

use std::io::{self, IsTerminal};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::ensure;
use board_link::recording::{LiveForces, RunningForces};
use board_link::{
    AppendWriter, LogSink, RecordOptions, RecordingProgress, Sinks, Source, Watcher, record,
};
use frame_stream::StreamOptions;
use live_view::web::Server;
use live_view::{Guide, LiveDisplay, LoadGuide};
use log_file::Log;
use output_file::OutputError;
use serde_json::json;
use shell_data::wrench::Axes;
use shellcal::workflow::live::{Feed, LiveSession, LogSeries, play};

use super::frames::{LiveForceArgs, warn_of_tare};
use super::mapping::MappingArgs;
use super::outputs::ReplacingArgs;
use super::ports::{SourceArgs, is_port};
use super::stream::{self, PlayingArgs, StreamToArgs};
use crate::files::{InputPath, OutputPath};
use crate::printer::Printer;
use crate::signals;

const EXAMPLES: &str = "\
Examples:
  shellcal live /dev/ttyUSB0 --start --calibration calibration.json
  shellcal live run3.csv --calibration calibration.json --speed 4
  shellcal live /dev/ttyUSB0 --start --calibration calibration.json --serve
  shellcal live /dev/ttyUSB0 --start -o session.csv

Keys: t and T tare and untare what is shown, space pauses, + and - zoom in time, m marks a moment,
r starts and ends a recording, q ends";

#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct LiveArgs {
    /// Serial port, or a log to play; `shellcal board` lists the ports
    #[arg(value_name = "PORT|LOG")]
    name: InputPath,

    #[command(flatten)]
    forces: LiveForceArgs,

    #[command(flatten)]
    stream: StreamToArgs,

    /// Record from the start; `r` ends the log, and begins the next with a number in its name
    #[arg(long, short, value_name = "LOG")]
    output: Option<OutputPath>,

    #[command(flatten)]
    replacing: ReplacingArgs,

    /// Time span shown, s
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    window: f64,

    #[command(flatten)]
    playing: PlayingArgs,

    #[command(flatten)]
    served: ServeArg,

    #[command(flatten)]
    source: SourceArgs,

    #[command(flatten)]
    mapping: MappingArgs,
}

/// The place of a view.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct ServeArg {
    /// Show the view in a browser instead of the terminal, at the printed address [default: 127.0.0.1 and a
    /// free port]; port 0 is a free one
    #[arg(long, value_name = "IP:PORT", num_args = 0..=1)]
    #[arg(require_equals = true, default_missing_value = view::LOOPBACK)]
    serve: Option<SocketAddr>,
}

impl ServeArg {
    /// Starts the server for a browser if one is wanted. Fails if it cannot listen, or there is neither a browser nor
    /// a terminal.
    pub(super) fn open(self) -> anyhow::Result<Option<Browser>> {
        let browser = self.serve.map(view::serve).transpose()?;
        ensure!(
            browser.is_some() || io::stdout().is_terminal() && io::stdin().is_terminal(),
            "a live view needs a terminal; `--serve` shows it in a browser, `shellcal record` needs neither"
        );
        Ok(browser)
    }
}

pub(super) type Browser = (Server, String);

impl LiveArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        self.source.serial.expect_board()?;
        let forces = self.forces.read(printer)?;
        let ranges = forces.as_ref().and_then(|forces| forces.calibration.valid_range.clone());
        let running = forces.clone().map(RunningForces::new).transpose()?;
        let stop = signals::stop_flag()?;
        let (feed, done) = (Feed::default(), Arc::default());
        let name = self.name.display().to_string();
        let is_port = is_port(&self.name);
        ensure!(is_port || self.output.is_none(), "a log that is played is not recorded again");
        let path = self.output.as_ref().map(|path| path.to_path_buf());
        let overwrite = self.replacing.overwrite;
        let next_log = move |made| next_log(path.as_deref(), overwrite, made);
        let mut logs = is_port.then(|| LogSeries::new(Box::new(next_log)));
        // Report errors before taking the screen.
        let (forces_of_stream, from_log) = (forces.clone(), !is_port);
        let stream =
            StreamOptions { forces: forces_of_stream, from_log, ..StreamOptions::default() };
        let view = Box::new(feed.clone());
        let (watcher, streamed) = self.stream.watch(printer, stream, Some(view))?;
        let browser = self.served.open()?;
        let first =
            logs.as_mut().filter(|_| self.output.is_some()).map(LogSeries::begin).transpose()?;
        let calibrated = forces.as_ref().map(|forces| forces.calibration.axes);
        let known = forces.clone();
        let (frames, recorded) = match is_port {
            true => (self.record(&name, forces, first, watcher, feed.clone())?, Axes::ALL),
            false => self.play(watcher, feed.clone())?,
        };
        // Without a calibration, the wrench comes from the board or the log itself.
        let axes = calibrated.unwrap_or(recorded);
        let display = LiveDisplay::new(ranges, self.window, axes);
        let mut session = LiveSession::<Guide>::new(display, None, running, feed, logs, name);
        let is_over = |_: &LiveSession, elapsed: Duration| {
            stop.load(Ordering::Relaxed) || self.source.duration.is_some_and(|end| elapsed >= end)
        };
        let ended = show(printer, &mut session, (frames, done), browser, &is_over)?;
        let streamed = stream::finish(printer, streamed.as_ref());
        warn_of_tare(known.as_ref(), printer);
        for line in session.report() {
            if printer.json() { printer.note(line) } else { printer.line(line) }
        }
        ended.and(streamed.map(drop))
    }

    fn record(
        &self,
        port: &str,
        forces: Option<LiveForces>,
        log: Option<Box<dyn LogSink>>,
        watcher: Option<Box<dyn Watcher>>,
        feed: Feed,
    ) -> anyhow::Result<FrameSource> {
        // The view ends after the duration, and ends the recording.
        let options = RecordOptions { forces, duration: None, ..self.source.options()? };
        let source = Source::port(self.source.serial.port(port), true)?;
        Ok(recording(source, Sinks { log, watcher, ..Sinks::default() }, options, feed))
    }

    fn play(
        &self,
        mut watcher: Option<Box<dyn Watcher>>,
        feed: Feed,
    ) -> anyhow::Result<(FrameSource, Axes)> {
        let log = Log::open(&self.name, &self.mapping.mapping())?;
        let (wants_readings, axes) = (self.forces.is_given(), log.axes());
        let (read, speed) = (self.mapping.read_options(), self.playing.speed);
        let source: FrameSource = Box::new(move |done| {
            let is_held = || feed.state().is_held;
            let mut see = |frames: &_| watcher.iter_mut().for_each(|it| it.see(frames));
            Ok(play(&log, &read, wants_readings, speed, &is_held, done, &mut see)?)
        });
        Ok((source, axes))
    }
}

/// Prints the address, and a warning if other machines can reach it.
fn announce(printer: &Printer, at: SocketAddr, address: &str) -> anyhow::Result<()> {
    if !at.ip().is_loopback() {
        printer.warning(
            "other machines reach this view, which is not encrypted; anyone with its address can end a \
             recording",
        );
    }
    printer.finish(&json!({ "address": address }), |printer| {
        printer.line(format!("live at {address}"));
        printer.line("Ctrl-C ends it");
    })
}

pub(super) type FrameSource = Box<dyn FnOnce(&AtomicBool) -> anyhow::Result<()> + Send>;

pub(super) fn recording(
    mut source: Source,
    sinks: Sinks,
    options: RecordOptions,
    feed: Feed,
) -> FrameSource {
    Box::new(move |done| {
        let mut tell = |it: &RecordingProgress| feed.state().progress = Some(it.clone());
        record(&mut source, sinks, &options, done, &mut tell)?;
        Ok(())
    })
}

/// Shows a session while `frames` come on another thread, until these end, the user ends it, or `is_over` is true
/// of the session and the time since its start. Returns the result of `frames`.
pub(super) fn show<G: LoadGuide>(
    printer: &Printer,
    session: &mut LiveSession<G>,
    (frames, done): (FrameSource, Arc<AtomicBool>),
    browser: Option<Browser>,
    is_over: &dyn Fn(&LiveSession<G>, Duration) -> bool,
) -> anyhow::Result<anyhow::Result<()>> {
    let end = Arc::clone(&done);
    let run = move || {
        let ended = frames(&end);
        // If the source fails, end the view: it would hide the error.
        end.fetch_or(ended.is_err(), Ordering::Relaxed);
        ended
    };
    let source = thread::Builder::new().name("source".to_owned()).spawn(run)?;
    let started = Instant::now();
    let advance = |session: &mut LiveSession<G>| {
        let elapsed = started.elapsed();
        let is_gone = session.advance(elapsed, source.is_finished())?;
        anyhow::Ok(!(done.load(Ordering::Relaxed) || is_gone || is_over(session, elapsed)))
    };
    let shown = match browser {
        Some((server, address)) => announce(printer, server.address(), &address)
            .and_then(|()| view::run_in_browser(session, server, &advance)),
        None => view::run(session, !view::is_utf8(), printer.is_colored(), &advance),
    };
    done.store(true, Ordering::Relaxed);
    let ended = source.join().unwrap_or_else(|_| Err(anyhow::anyhow!("the recording panicked")));
    shown.map(|()| ended)
}

/// Creates `log.csv`, then the first of `log-2.csv`, `log-3.csv`, … that does not exist; `path` is the first
/// name, if there is one.
fn next_log(
    path: Option<&Path>,
    overwrite: bool,
    made: usize,
) -> Result<Box<dyn LogSink>, OutputError> {
    // The name that the user gave may be refused or replaced; a generated one must not collide.
    if let Some(path) = path.filter(|_| made == 0) {
        return Ok(Box::new(AppendWriter::create(path, overwrite)?));
    }
    first_free(path.unwrap_or(Path::new("live.csv")), made + 1)
}

/// Creates the first log that does not exist, numbered from `number`.
pub(super) fn first_free(base: &Path, number: usize) -> Result<Box<dyn LogSink>, OutputError> {
    let mut names = (number..).map(|number| numbered(base, number));
    let free = names.find(|path| !path.exists()).expect("numbers do not end");
    Ok(Box::new(AppendWriter::create(&free, false)?))
}

/// The name of a log: the base, then with numbers from 2.
pub(super) fn numbered(base: &Path, number: usize) -> PathBuf {
    if number == 1 {
        return base.to_path_buf();
    }
    let stem = base.file_stem().unwrap_or_default().to_string_lossy();
    let ending = base.extension().map(|ending| format!(".{}", ending.to_string_lossy()));
    base.with_file_name(format!("{stem}-{number}{}", ending.unwrap_or_default()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logs_are_numbered_and_none_is_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("run.csv");
        std::fs::write(dir.path().join("run-2.csv"), "mine").unwrap();
        let next_log = |made| next_log(Some(&path), false, made);
        let writers = [next_log(0).unwrap(), next_log(1).unwrap()];
        let names = writers.each_ref().map(|log| log.path().file_name().unwrap().to_owned());
        assert_eq!(names, ["run.csv", "run-3.csv"]);
        assert_eq!(std::fs::read(dir.path().join("run-2.csv")).unwrap(), b"mine");
        drop(writers);
        assert!(next_log(0).is_err(), "a name that was given is taken");
    }
}
