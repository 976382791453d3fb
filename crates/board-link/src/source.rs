//! Where bytes come from: a port, or a file of bytes that were recorded before.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;
use std::time::{Duration, Instant, SystemTime};

use super::{Connection, LinkError, PortOptions};

/// Time between two attempts to open a port that is gone.
const RETRY: Duration = Duration::from_millis(500);

/// Time between two reads of a port that has bytes, at least. What arrives faster, three frames at 1 kHz, is taken together:
/// to wake for each takes thrice the processor time.
const PACE: Duration = Duration::from_millis(3);

/// A stream of bytes.
#[derive(Debug)]
pub struct Source {
    inner: Inner,
    /// When bytes were read last.
    read_at: Instant,
    started: Instant,
    wall: SystemTime,
    /// Times that a port that was gone has come back.
    pub reconnections: u64,
}

#[derive(Debug)]
enum Inner {
    Port {
        port: Option<Box<dyn Connection>>,
        options: PortOptions,
        reconnect: bool,
        retry: Instant,
    },
    Replay {
        file: File,
        path: String,
    },
}

impl Source {
    /// Opens a port. With `reconnect`, one that goes away is waited for.
    ///
    /// # Errors
    /// [`LinkError`] if it cannot be opened now.
    pub fn port(options: PortOptions, reconnect: bool) -> Result<Self, LinkError> {
        let (port, now) = (Some(options.open()?), Instant::now());
        Ok(Self::new(Inner::Port { port, options, reconnect, retry: now }))
    }

    /// Opens a file of raw bytes.
    ///
    /// # Errors
    /// [`LinkError::Replay`] if it cannot be opened.
    pub fn replay(path: &Path) -> Result<Self, LinkError> {
        let refused = |error: io::Error| replay_error(path.display(), &error);
        // Before it is opened: whoever opens a pipe waits for its writer.
        if !std::fs::metadata(path).map_err(refused)?.is_file() {
            return Err(refused(io::Error::other("it is not a regular file")));
        }
        let file = File::open(path).map_err(refused)?;
        Ok(Self::new(Inner::Replay { file, path: path.display().to_string() }))
    }

    fn new(inner: Inner) -> Self {
        let (started, wall) = (Instant::now(), SystemTime::now());
        Self { inner, read_at: started, started, wall, reconnections: 0 }
    }

    /// Time since the start; a replay takes none.
    pub(super) fn elapsed(&self) -> Duration {
        match self.inner {
            Inner::Port { .. } => self.started.elapsed(),
            Inner::Replay { .. } => Duration::ZERO,
        }
    }

    /// When bytes that are read now were sent, or so, since the start; of a replay nobody knows.
    pub(super) fn arrival(&self) -> Option<Duration> {
        // While a computer sleeps, only the clock on its wall goes on.
        let on_the_wall = self.wall.elapsed().unwrap_or_default();
        matches!(self.inner, Inner::Port { .. }).then(|| self.started.elapsed().max(on_the_wall))
    }

    /// Whether the port is there.
    pub(super) fn is_connected(&self) -> bool {
        !matches!(self.inner, Inner::Port { port: None, .. })
    }

    /// The name of the port or file.
    pub(super) fn name(&self) -> &str {
        match &self.inner {
            Inner::Port { options, .. } => &options.port,
            Inner::Replay { path, .. } => path,
        }
    }

    /// Reads bytes into `buffer` and waits briefly for the first. Returns their number, or `None` at the end.
    pub(super) fn read(&mut self, buffer: &mut [u8]) -> Result<Option<usize>, LinkError> {
        match &mut self.inner {
            Inner::Replay { file, path } => match read_port(file, buffer) {
                Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(None),
                read => read.map(Some).map_err(|error| replay_error(path, &error)),
            },
            Inner::Port { port, options, reconnect, retry } => {
                let Some(connection) = port else {
                    std::thread::sleep(Duration::from_millis(20));
                    if retry.elapsed() >= RETRY {
                        *retry = Instant::now();
                        *port = options.open().ok();
                        self.reconnections += u64::from(port.is_some());
                    }
                    return Ok(Some(0));
                };
                std::thread::sleep(PACE.saturating_sub(self.read_at.elapsed()));
                match read_port(&mut **connection, buffer) {
                    Ok(count) => {
                        if count > 0 {
                            self.read_at = Instant::now();
                        }
                        Ok(Some(count))
                    }
                    Err(_) if *reconnect => {
                        *port = None;
                        Ok(Some(0))
                    }
                    Err(error) => Err(LinkError::lost(&options.port, &error)),
                }
            }
        }
    }

    /// Sends bytes to the board; a replay has none. What cannot be sent is lost: the caller repeats
    /// it until the board has heard.
    pub(super) fn send(&mut self, bytes: &[u8]) {
        if let Inner::Port { port: Some(port), .. } = &mut self.inner {
            let _ = port.write_all(bytes);
        }
    }
}

/// Reads what a port or file has ready, which may be zero bytes.
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
