//! `shellcal stream`: frames to other programs, as they arrive.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use board_link::recording::PROTOCOLS;
use board_link::{RecordOptions, Sinks, Source, Watcher, record};
use clap::builder::TypedValueParser;
use frame_stream::{Destination, FrameStream, StreamFormat, StreamOptions, StreamWatcher};
use log_file::Log;
use shared_proto::Protocol;
use shellcal::workflow::live::play;

use super::choices::{POSITIVE, number_in, number_within, one_of};
use super::live_forces::LiveForceArgs;
use super::mapping::MappingArgs;
use super::ports::is_port;
use super::record::parse_duration;
use super::serial::SerialArgs;
use super::streaming;
use crate::files::InputPath;
use crate::printer::Printer;
use crate::signals;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal stream /dev/ttyUSB0 --start --calibration calibration.json | my-program
  shellcal stream /dev/ttyUSB0 --start --calibration calibration.json -o udp:127.0.0.1:9870
  shellcal stream run3.csv --calibration calibration.json -o tcp:9000 -o run3.jsonl --rate 50")]
pub(crate) struct StreamArgs {
    /// Serial port, or a log to play; `shellcal ports` lists the ports
    #[arg(value_name = "PORT|LOG")]
    name: InputPath,

    /// Where rows go; may be given several times: `-` (standard output), `udp:HOST:PORT`, `tcp:PORT` (whoever
    /// connects on this machine), `tcp:IP:PORT`, or a file
    #[arg(long, short, value_name = "DEST", default_value = "-")]
    output: Vec<Destination>,

    /// How rows are written
    #[arg(long, value_name = "ENCODING", value_parser = one_of(&ENCODINGS), default_value = "json")]
    encoding: StreamFormat,

    /// Replace files that are there
    #[arg(long)]
    overwrite: bool,

    #[command(flatten)]
    forces: LiveForceArgs,

    /// Rows per second, where frames are more: filtered against aliasing, which delays them by some 1/HZ
    #[arg(long, value_name = "HZ", value_parser = number_in(POSITIVE, "a rate in Hz above 0, such as 50"))]
    rate: Option<f64>,

    /// Bring the channels of a frame to one time, as `record` does; each frame waits for three after it
    #[arg(long)]
    one_time: bool,

    /// Tell the board to start streaming, and to stop at the end
    #[arg(long)]
    start: bool,

    /// Wait for a port that goes away, and go on when it is back
    #[arg(long)]
    reconnect: bool,

    /// End after so many seconds
    #[arg(long, value_name = "S", value_parser = parse_duration)]
    duration: Option<Duration>,

    /// End when the standard input ends, for a program that runs this one
    #[arg(long)]
    until_eof: bool,

    /// How many times as fast a log is played
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = speed())]
    speed: f64,

    /// Say at the end how late rows were: median and 99th percentile of the time from the board's clock to the
    /// reader, beyond that of the fastest row of every ten seconds
    #[arg(long)]
    latency: bool,

    /// How the bytes are framed; recognised unless given
    #[arg(long, value_name = "FRAMING", value_parser = one_of(&PROTOCOLS))]
    framing: Option<Protocol>,

    #[command(flatten)]
    serial: SerialArgs,

    #[command(flatten)]
    mapping: MappingArgs,
}

/// How rows are written.
const ENCODINGS: [(&str, &str, StreamFormat); 2] = [
    ("json", "An object of JSON a line", StreamFormat::JsonLines),
    ("csv", "Comma-separated values after a line with their names", StreamFormat::Csv),
];

impl StreamArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        let from_log = !is_port(&self.name);
        if from_log && self.latency {
            anyhow::bail!("`--latency` is for a port: what is in a log has long been measured");
        }
        let forces = self.forces.read(printer)?;
        let log = from_log.then(|| Log::open(&self.name, &self.mapping.mapping())).transpose()?;
        let stop = signals::stop_flag()?;
        let port = self.serial.port(&self.name.to_string_lossy());
        let source = (!from_log).then(|| Source::port(port, self.reconnect)).transpose()?;
        let at_end = self.until_eof.then(|| Arc::clone(&stop));
        let options = StreamOptions {
            forces,
            from_log,
            one_time: self.one_time,
            format: self.encoding,
            rate_hz: self.rate,
            commands: Some(streaming::commands(printer, at_end)?),
        };
        let readers = streaming::open(printer, &self.output, self.overwrite)?;
        let stream = FrameStream::new(options, readers)?;
        let (watcher, handle) = StreamWatcher::new(stream, None, Some(Arc::clone(&stop)));
        let ended = match (source, &log) {
            (Some(source), _) => self.record(source, Box::new(watcher), &stop, printer),
            (None, Some(log)) => self.play(log, watcher, &stop),
            (None, None) => Ok(()),
        };
        let summary = streaming::finish(printer, Some(&handle))?;
        let latency = summary.and_then(|summary| summary.latency).filter(|_| self.latency);
        latency.iter().for_each(|latency| printer.note(latency.to_string()));
        ended
    }

    fn record(
        &self,
        mut source: Source,
        watcher: Box<dyn Watcher>,
        stop: &AtomicBool,
        printer: &Printer,
    ) -> anyhow::Result<()> {
        let options = RecordOptions {
            protocol: self.framing,
            duration: self.duration,
            start: self.start.then(|| self.serial.uplink(self.framing)).transpose()?,
            ..RecordOptions::default()
        };
        let sinks = Sinks { watcher: Some(watcher), ..Sinks::default() };
        let recorded = record(&mut source, sinks, &options, stop, &mut |_| {})?;
        let losses = recorded.losses.in_words();
        printer.note(format!("{} frames from the board; {losses}", recorded.frames));
        Ok(())
    }

    fn play(&self, log: &Log, mut watcher: StreamWatcher, stop: &AtomicBool) -> anyhow::Result<()> {
        let (read, readings) = (self.mapping.read_options(), self.forces.is_given());
        let started = Instant::now();
        let mut see = |frames: &_| {
            watcher.see(frames);
            if self.duration.is_some_and(|duration| started.elapsed() >= duration) {
                stop.store(true, Ordering::Relaxed);
            }
        };
        play(log, &read, readings, self.speed, &|| false, stop, &mut see)?;
        Ok(())
    }
}

/// A factor on the pace of a log.
pub(super) fn speed() -> impl TypedValueParser<Value = f64> {
    number_within(0.001..=1000.0, ["a factor, such as 4", "a factor from 0.001 to 1000"])
}
