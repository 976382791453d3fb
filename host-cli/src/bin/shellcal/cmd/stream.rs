//! `shellcal stream`: frames for other programs, as they arrive. Also has the code shared with `record
//! --stream` and `live --stream`.

use std::io::{self, BufRead, Read};
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::Context;
use board_link::{Sinks, Source, Watcher, record};
use frame_stream::{
    Destination, FrameStream, LEAST_RATE_HZ, NetFtPage, Readers, StreamCommand, StreamFormat,
    StreamHandle, StreamOptions, StreamSummary, StreamWatcher,
};
use live_view::web::{OpenDocument, Server, Site};
use log_file::Log;
use shellcal::workflow::live::play;

use super::choices::{number_in, number_within, one_of};
use super::frames::{LiveForceArgs, warn_of_tare};
use super::mapping::MappingArgs;
use super::outputs::ReplacingArgs;
use super::ports::{Recipient, SourceArgs, is_port};
use crate::files::InputPath;
use crate::printer::Printer;
use crate::signals;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal stream /dev/ttyUSB0 --start --calibration calibration.json | my-program
  shellcal stream /dev/ttyUSB0 --start --calibration calibration.json -o udp:127.0.0.1:9870
  shellcal stream /dev/ttyUSB0 --start --calibration calibration.json -o netft
  shellcal stream run3.csv --calibration calibration.json -o tcp:9000 -o run3.jsonl --rate 50")]
pub(crate) struct StreamArgs {
    /// Serial port, or a log to play; `shellcal board` lists the ports
    #[arg(value_name = "PORT|LOG")]
    name: InputPath,

    /// Where rows go; may be given several times: `-` (standard output), `udp:HOST:PORT`, `tcp:PORT`
    /// (programs of this machine), `tcp:IP:PORT`, `netft[:PORT]` (as an ATI Net F/T box answers), or a file
    #[arg(long, short, value_name = "DEST", default_value = "-")]
    output: Vec<Destination>,

    /// Encoding of rows [default: csv to a file `.csv`, json otherwise]
    #[arg(long, value_name = "ENCODING", value_parser = one_of(&ENCODINGS))]
    encoding: Option<StreamFormat>,

    /// Address of this machine at which `netft` answers others [default: 127.0.0.1, this machine alone]
    #[arg(long, value_name = "IP")]
    bind: Option<IpAddr>,

    #[command(flatten)]
    replacing: ReplacingArgs,

    #[command(flatten)]
    forces: LiveForceArgs,

    /// Rows per second, if frames are more frequent: filtered against aliasing, which delays them by about
    /// 1/HZ
    #[arg(long, value_name = "HZ", value_parser = number_in(LEAST_RATE_HZ..=f64::MAX, "a rate in Hz from 0.1, such as 50"))]
    rate: Option<f64>,

    /// Interpolate the channels of a frame to one time, as `record` does; each frame waits for the next three
    #[arg(long)]
    one_time: bool,

    #[command(flatten)]
    waiting: WaitingArgs,

    #[command(flatten)]
    ending: EndingArgs,

    #[command(flatten)]
    playing: PlayingArgs,

    /// Report the delay of rows at the end: median and 99th percentile of the time from the board's clock to
    /// the reader, relative to the fastest row of every ten seconds
    #[arg(long)]
    latency: bool,

    #[command(flatten)]
    source: SourceArgs,

    #[command(flatten)]
    mapping: MappingArgs,
}

/// The option of commands that play logs.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct PlayingArgs {
    /// Playback speed, as a factor
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = number_within(0.001..=1000.0, SPEED))]
    pub(super) speed: f64,
}

const SPEED: [&str; 2] = ["a factor, such as 4", "a factor from 0.001 to 1000"];

/// The option of recordings whose port may disappear.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct WaitingArgs {
    /// Wait for a port that disappears, and continue when it is back
    #[arg(long)]
    pub(super) reconnect: bool,
}

/// The option of commands that serve other programs.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct EndingArgs {
    /// End when the standard input ends; for use by another program
    #[arg(long)]
    pub(super) until_eof: bool,
}

const ENCODINGS: [(&str, &str, StreamFormat); 2] = [
    ("json", "An object of JSON a line", StreamFormat::JsonLines),
    ("csv", "Comma-separated values after a line with their names", StreamFormat::Csv),
];

impl StreamArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        let from_log = !is_port(&self.name);
        anyhow::ensure!(
            !from_log || !self.latency,
            "`--latency` is for a port: what is in a log has long been measured"
        );
        let forces = self.forces.read(printer)?;
        let known = forces.clone();
        let log = from_log.then(|| Log::open(&self.name, &self.mapping.mapping())).transpose()?;
        let stop = signals::stop_flag()?;
        let port = self.source.serial.port(&self.name.to_string_lossy());
        let source = (!from_log).then(|| Source::port(port, self.waiting.reconnect)).transpose()?;
        let at_end = self.ending.until_eof.then(|| Arc::clone(&stop));
        let options = StreamOptions {
            forces,
            from_log,
            one_time: self.one_time,
            rate_hz: self.rate,
            commands: Some(commands(printer, at_end)?),
        };
        let destinations = self.destinations();
        let readers = open(printer, &destinations, self.encoding, self.replacing.overwrite)?;
        let stream = FrameStream::new(options, readers)?;
        let (watcher, handle) = StreamWatcher::new(stream, None, Some(Arc::clone(&stop)));
        let ended = match (source, &log) {
            (Some(source), _) => self.record(source, Box::new(watcher), &stop, printer),
            (None, Some(log)) => self.play(log, watcher, &stop),
            (None, None) => Ok(()),
        };
        let summary = finish(printer, Some(&handle))?;
        warn_of_tare(known.as_ref(), printer);
        let latency = summary.and_then(|summary| summary.latency).filter(|_| self.latency);
        latency.iter().for_each(|latency| printer.note(latency.to_string()));
        ended
    }

    fn destinations(&self) -> Vec<Destination> {
        let mut all = self.output.clone();
        if let Recipient::NetFt(address) = self.source.serial.to {
            all.retain(|destination| *destination != Destination::Stdout);
            all.push(Destination::NetFt(address));
        }
        for destination in &mut all {
            if let (Destination::NetFt(address), Some(ip)) = (destination, self.bind) {
                address.ip = ip;
            }
        }
        all
    }

    fn record(
        &self,
        mut source: Source,
        watcher: Box<dyn Watcher>,
        stop: &AtomicBool,
        printer: &Printer,
    ) -> anyhow::Result<()> {
        let sinks = Sinks { watcher: Some(watcher), ..Sinks::default() };
        let recorded = record(&mut source, sinks, &self.source.options()?, stop, &mut |_| {})?;
        let losses = recorded.losses.in_words();
        printer.note(format!("{} frames from the board; {losses}", recorded.frames));
        Ok(())
    }

    fn play(&self, log: &Log, mut watcher: StreamWatcher, stop: &AtomicBool) -> anyhow::Result<()> {
        let (read, readings) = (self.mapping.read_options(), self.forces.is_given());
        let started = Instant::now();
        let mut see = |frames: &_| {
            watcher.see(frames);
            if self.source.duration.is_some_and(|duration| started.elapsed() >= duration) {
                stop.store(true, Ordering::Relaxed);
            }
        };
        Ok(play(log, &read, readings, self.playing.speed, &|| false, stop, &mut see)?)
    }
}

type WatchedStream = (Option<Box<dyn Watcher>>, Option<StreamHandle>);

/// Destination of rows in addition to a log or a view, as JSON lines, or CSV to a file `.csv`
#[derive(Debug, clap::Args)]
pub(crate) struct StreamToArgs {
    /// Pass rows on as they arrive, as `shellcal stream` does: to `udp:HOST:PORT`, `tcp:PORT`, `netft` or a file; may
    /// be given several times
    #[arg(long, value_name = "DEST")]
    stream: Vec<Destination>,
}

impl StreamToArgs {
    pub(crate) fn is_given(&self) -> bool {
        !self.stream.is_empty()
    }

    /// Adds the stream to another watcher. The end of the stream does not end the recording.
    pub(crate) fn watch(
        &self,
        printer: &Printer,
        options: StreamOptions,
        beside: Option<Box<dyn Watcher>>,
    ) -> anyhow::Result<WatchedStream> {
        if !self.is_given() {
            return Ok((beside, None));
        }
        anyhow::ensure!(
            !self.stream.contains(&Destination::Stdout),
            "only `shellcal stream` writes rows to the standard output"
        );
        let readers = open(printer, &self.stream, None, false)?;
        let stream = FrameStream::new(options, readers)?;
        let (watcher, handle) = StreamWatcher::new(stream, beside, None);
        Ok((Some(Box::new(watcher)), Some(handle)))
    }
}

fn open(
    printer: &Printer,
    to: &[Destination],
    format: Option<StreamFormat>,
    overwrite: bool,
) -> anyhow::Result<Readers> {
    let readers = Readers::open(to, format, overwrite)?;
    for (address, page) in readers.boxes() {
        let at = serve_page(&page)?;
        printer.note(format!("Net F/T at {address} (UDP); http://{at}{NETFT_PAGE}"));
        if !address.ip().is_loopback() {
            printer.warning(format!(
                "other machines reach {address}: any of them can read on, and take zero as it likes"
            ));
        }
    }
    for address in readers.addresses() {
        printer.note(format!("readers over TCP: {address}"));
        if !address.ip().is_loopback() {
            printer.warning(format!(
                "other machines reach {address}, which is not encrypted: anyone can connect and read"
            ));
        }
    }
    Ok(readers)
}

const NETFT_PAGE: &str = "/netftapi2.xml";

/// Serves the page of a Net F/T box; returns the address.
fn serve_page(page: &NetFtPage) -> anyhow::Result<SocketAddr> {
    let own = page.clone();
    let text = Arc::new(move || own.text());
    let document = OpenDocument { path: NETFT_PAGE, content_type: "text/xml", text };
    let site = Site { open: vec![document], ..Site::default() };
    let mut refused = None;
    for at in &page.addresses {
        match Server::start(*at, site.clone()) {
            Ok(server) => return Ok(server.address()),
            Err(error) => refused = Some((at, error)),
        }
    }
    let (at, error) = refused.context("the page has no address")?;
    Err(error).with_context(|| format!("cannot serve `netftapi2.xml` at {at}"))
}

/// Maximum number of commands obeyed within a second; later ones wait in the pipe, which blocks its writer when full.
const MOST_COMMANDS: u32 = 100;

/// Reads commands from the standard input, one per line. `at_end` is set when there are no more.
pub(crate) fn commands(
    printer: &Printer,
    at_end: Option<Arc<AtomicBool>>,
) -> io::Result<Receiver<StreamCommand>> {
    let (sender, commands) = channel();
    let mut second = (Instant::now(), 0);
    each_line("commands", printer, at_end, move |line| {
        if second.1 == MOST_COMMANDS {
            thread::sleep(Duration::from_secs(1).saturating_sub(second.0.elapsed()));
        }
        if second.0.elapsed() >= Duration::from_secs(1) {
            second = (Instant::now(), 0);
        }
        second.1 += 1;
        let command: StreamCommand = line.parse().map_err(|unknown| format!("{unknown}"))?;
        Ok(sender.send(command).is_ok())
    })?;
    Ok(commands)
}

const LONGEST_LINE: u64 = 4096;

/// Reads the standard input on a thread with this name. For each line, `take` returns true if it wants more lines,
/// or the error in the line. `at_end` is set when there are no more.
pub(crate) fn each_line(
    name: &str,
    printer: &Printer,
    at_end: Option<Arc<AtomicBool>>,
    mut take: impl FnMut(&str) -> Result<bool, String> + Send + 'static,
) -> io::Result<()> {
    let printer = printer.clone();
    let listen = move || {
        let mut input = io::stdin().lock();
        let mut line = Vec::new();
        // A longer line is split.
        while input.by_ref().take(LONGEST_LINE).read_until(b'\n', &mut line).is_ok_and(|n| n > 0) {
            match take(String::from_utf8_lossy(&line).trim_end_matches(['\r', '\n'])) {
                Ok(true) => {}
                Ok(false) => return,
                Err(wrong) => printer.warning(wrong),
            }
            line.clear();
        }
        if let Some(at_end) = at_end {
            at_end.store(true, Ordering::Relaxed);
        }
    };
    thread::Builder::new().name(name.to_owned()).spawn(listen).map(drop)
}

pub(crate) fn finish(
    printer: &Printer,
    handle: Option<&StreamHandle>,
) -> anyhow::Result<Option<StreamSummary>> {
    let Some(summary) = handle.map(StreamHandle::finish).transpose()?.flatten() else {
        return Ok(None);
    };
    let mut broken = None;
    for reader in &summary.readers {
        let lost = match reader.lost {
            0 => "none lost".to_owned(),
            lost => format!("{lost} lost"),
        };
        let said = format!("{}: {} rows, {lost}", reader.name, reader.rows);
        match &reader.problem {
            Some(problem) if reader.is_broken => {
                broken.get_or_insert(format!("cannot write {said}: {problem}"));
            }
            Some(problem) => printer.warning(format!("{said}: {problem}")),
            None => printer.note(said),
        }
    }
    broken.map_or(Ok(Some(summary)), |broken| Err(anyhow::Error::msg(broken)))
}
