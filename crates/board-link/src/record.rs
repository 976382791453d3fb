//! Recording of a port, or of a file of raw bytes, into a log and a raw file.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime};

use super::capture::CaptureReader;
use super::record_options::{RecordError, RecordOptions, RecordingProgress};
use super::recorder::{Recorded, Recorder, Sinks};
use super::{Connection, LinkError, PortOptions};

const RETRY: Duration = Duration::from_millis(500);

/// Minimum interval between reads: waking for each frame at 1 kHz triples the processor time.
const PACE: Duration = Duration::from_millis(3);

#[derive(Debug)]
pub struct Source {
    name: String,
    input: Input,
    pub reconnections: u64,
}

#[derive(Debug)]
enum Input {
    Port(OpenPort),
    Capture(CaptureReader<BufReader<File>>),
}

#[derive(Debug)]
struct OpenPort {
    options: PortOptions,
    connection: Option<Box<dyn Connection>>,
    reconnect: bool,
    tried_at: Instant,
    read_at: Instant,
    started: Instant,
    wall: SystemTime,
}

impl Source {
    /// Opens a port. With `reconnect`, a lost port is waited for. Fails with [`LinkError`] if it
    /// cannot be opened now.
    pub fn port(options: PortOptions, reconnect: bool) -> Result<Self, LinkError> {
        let (name, now) = (options.port.clone(), Instant::now());
        let port = OpenPort {
            connection: Some(options.open()?),
            options,
            reconnect,
            tried_at: now,
            read_at: now,
            started: now,
            wall: SystemTime::now(),
        };
        Ok(Self { name, input: Input::Port(port), reconnections: 0 })
    }

    /// Opens a file of raw bytes. Fails with [`LinkError::Replay`] if it cannot be opened.
    pub fn replay(path: &Path) -> Result<Self, LinkError> {
        let refused = |error: io::Error| replay_error(path.display(), &error);
        // Opening a pipe would wait for its writer.
        if !std::fs::metadata(path).map_err(refused)?.is_file() {
            return Err(refused(io::Error::other("it is not a regular file")));
        }
        let file = BufReader::new(File::open(path).map_err(refused)?);
        let input = Input::Capture(CaptureReader::new(file).map_err(refused)?);
        Ok(Self { name: path.display().to_string(), input, reconnections: 0 })
    }

    fn started(&self) -> Instant {
        match &self.input {
            Input::Port(port) => port.started,
            Input::Capture(_) => Instant::now(),
        }
    }

    /// Returns the time since the start; in a replay, as recorded, or zero if unknown.
    fn elapsed(&self) -> Duration {
        match &self.input {
            Input::Port(port) => port.started.elapsed(),
            Input::Capture(capture) => capture.arrival().unwrap_or_default(),
        }
    }

    /// Returns the approximate time since the start at which bytes read now were sent, if known.
    fn arrival(&self) -> Option<Duration> {
        match &self.input {
            // Only the wall clock continues while a computer sleeps.
            Input::Port(port) => {
                Some(port.started.elapsed().max(port.wall.elapsed().unwrap_or_default()))
            }
            Input::Capture(capture) => capture.arrival(),
        }
    }

    fn is_connected(&self) -> bool {
        !matches!(&self.input, Input::Port(OpenPort { connection: None, .. }))
    }

    /// Reads bytes and waits briefly for the first. Returns their number, `None` at the end.
    fn read(&mut self, buffer: &mut [u8]) -> Result<Option<usize>, LinkError> {
        match &mut self.input {
            Input::Port(port) => port.read(buffer, &mut self.reconnections).map(Some),
            Input::Capture(capture) => match read_port(capture, buffer) {
                Ok(count) => Ok(Some(count)),
                Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(None),
                Err(error) => Err(replay_error(&self.name, &error)),
            },
        }
    }

    /// Sends bytes to the board, if any. The caller repeats commands, so errors do not matter.
    fn send(&mut self, bytes: &[u8]) {
        if let Input::Port(OpenPort { connection: Some(connection), .. }) = &mut self.input {
            let _ = connection.write_all(bytes);
        }
    }
}

impl OpenPort {
    fn read(&mut self, buffer: &mut [u8], reconnections: &mut u64) -> Result<usize, LinkError> {
        let Some(connection) = &mut self.connection else {
            std::thread::sleep(Duration::from_millis(20));
            if self.tried_at.elapsed() >= RETRY {
                self.tried_at = Instant::now();
                self.connection = self.options.open().ok();
                *reconnections += u64::from(self.connection.is_some());
            }
            return Ok(0);
        };
        std::thread::sleep(PACE.saturating_sub(self.read_at.elapsed()));
        match read_port(&mut **connection, buffer) {
            Ok(count) => {
                if count > 0 {
                    self.read_at = Instant::now();
                }
                Ok(count)
            }
            Err(_) if self.reconnect => {
                self.connection = None;
                Ok(0)
            }
            Err(error) => Err(LinkError::lost(&self.options.port, &error)),
        }
    }
}

/// Records until the end, the duration or `stop`, and calls `observe` about twice a second. When
/// this returns, even with an error, every frame that arrived is in the log.
pub fn record(
    source: &mut Source,
    sinks: Sinks,
    options: &RecordOptions,
    stop: &AtomicBool,
    observe: &mut dyn FnMut(&RecordingProgress),
) -> Result<Recorded, RecordError> {
    let mut recorder = Recorder::new(&source.name, sinks, options.clone());
    recorder.start_reference(source.started());
    let ran = run(&mut recorder, source, options.duration, stop, observe);
    source.send(&recorder.last_commands());
    let is_about_a_file = |error: &RecordError| matches!(error, RecordError::Output(_));
    let finished = match ran {
        Ok(()) => recorder.finish(),
        Err(error) => Err(recorder.finish().err().filter(is_about_a_file).unwrap_or(error)),
    };
    let mut recorded = recorder.recorded(source.elapsed());
    recorded.reconnections = source.reconnections;
    let closed = recorder.close();
    finished?;
    closed?;
    Ok(recorded)
}

fn run(
    recorder: &mut Recorder,
    source: &mut Source,
    duration: Option<Duration>,
    stop: &AtomicBool,
    observe: &mut dyn FnMut(&RecordingProgress),
) -> Result<(), RecordError> {
    let mut buffer = vec![0; 1 << 14];
    let commands = recorder.commands(source.arrival());
    source.send(&commands);
    loop {
        let elapsed = source.elapsed();
        if stop.load(Ordering::Relaxed) || duration.is_some_and(|end| elapsed >= end) {
            return Ok(());
        }
        let Some(count) = source.read(&mut buffer)? else { return Ok(()) };
        let (now, arrival) = (source.elapsed(), source.arrival());
        recorder.take(&buffer[..count], now, arrival)?;
        if let Some(mut progress) = recorder.tend(now, arrival)? {
            source.send(&progress.commands);
            progress.connected = source.is_connected();
            observe(&progress);
        }
    }
}

pub(super) fn read_port(port: &mut (impl Read + ?Sized), buffer: &mut [u8]) -> io::Result<usize> {
    match port.read(buffer) {
        Ok(0) => Err(io::ErrorKind::UnexpectedEof.into()),
        Ok(count) => Ok(count),
        Err(error) => match error.kind() {
            io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted => {
                Ok(0)
            }
            _ => Err(error),
        },
    }
}

fn replay_error(path: impl ToString, error: &io::Error) -> LinkError {
    LinkError::Replay { path: path.to_string(), reason: error.to_string() }
}
