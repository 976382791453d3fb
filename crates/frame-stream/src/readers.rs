//! Destinations of a stream, and their readers. The stream never waits for a reader.

use std::fmt;
use std::io::{self, Write};
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, TcpListener, TcpStream, ToSocketAddrs, UdpSocket};
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use board_link::{AppendWriter, LogSink};
use output_file::OutputError;
use reference_sensor::rdt;
use shell_data::wrench::Axes;

use crate::encoding::{RowEncoder, StreamFormat, StreamRow};
use crate::netft::{NetFtAddress, NetFtBox, NetFtPage};
use crate::summary::ReaderSummary;

const ACCEPT: Duration = Duration::from_millis(10);

/// Time for each reader to take pending rows at the end.
const PATIENCE: Duration = Duration::from_millis(500);

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Destination {
    Stdout,
    File(PathBuf),
    Udp(SocketAddr),
    Tcp(SocketAddr),
    NetFt(NetFtAddress),
}

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{0}; a destination is `-`, `udp:HOST:PORT`, `tcp:PORT`, `tcp:IP:PORT`, `netft`, `netft:PORT` or a file"
)]
pub struct BadDestination(String);

impl FromStr for Destination {
    type Err = BadDestination;

    fn from_str(word: &str) -> Result<Self, BadDestination> {
        let bad = |problem: String| BadDestination(problem);
        if let Some(at) = word.strip_prefix("udp:") {
            let mut found =
                at.to_socket_addrs().map_err(|error| bad(format!("`{at}`: {error}")))?;
            let found = found.next().ok_or_else(|| bad(format!("`{at}` has no address")))?;
            return Ok(Self::Udp(found));
        }
        if let Some(at) = word.strip_prefix("tcp:") {
            let own = |port| SocketAddr::from((Ipv4Addr::LOCALHOST, port));
            let address = at.parse().map(own).or_else(|_| at.parse());
            return address.map(Self::Tcp).map_err(|error| bad(format!("`{at}`: {error}")));
        }
        if let Some(port) = word.strip_prefix("netft:") {
            let port = port.parse().map_err(|error| bad(format!("`{port}`: {error}")))?;
            return Ok(Self::NetFt(NetFtAddress { port: Some(port), ..Default::default() }));
        }
        match word {
            "netft" => Ok(Self::NetFt(NetFtAddress::default())),
            "" => Err(bad("there is no name".to_owned())),
            "-" => Ok(Self::Stdout),
            path => Ok(Self::File(path.strip_prefix("file:").unwrap_or(path).into())),
        }
    }
}

impl fmt::Display for Destination {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Stdout => f.write_str("standard output"),
            Self::File(path) => write!(f, "`{}`", path.display()),
            Self::Udp(address) => write!(f, "udp:{address}"),
            Self::Tcp(address) => write!(f, "tcp:{address}"),
            Self::NetFt(NetFtAddress { ip, port }) => {
                write!(f, "netft:{}", SocketAddr::new(*ip, port.unwrap_or(rdt::PORT)))
            }
        }
    }
}

impl Destination {
    fn format(&self) -> StreamFormat {
        let is_csv = |path: &PathBuf| {
            path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("csv"))
        };
        match self {
            Self::File(path) if is_csv(path) => StreamFormat::Csv,
            _ => StreamFormat::JsonLines,
        }
    }
}

#[derive(Debug, Default)]
pub struct Readers {
    readers: Vec<StreamReader>,
    listeners: Vec<TcpListener>,
    boxes: Vec<NetFtBox>,
    format: Option<StreamFormat>,
    encoders: [Option<RowEncoder>; 2],
    looked: Option<Instant>,
    rows: u64,
    gone: Vec<ReaderSummary>,
}

#[derive(Debug)]
struct StreamReader {
    name: String,
    way: Transport,
    format: StreamFormat,
    /// True for a file or the standard output, which must be complete.
    is_output: bool,
    has_names: bool,
    handed: u64,
    lost: u64,
}

#[derive(Debug)]
enum Transport {
    Pipe(PipeReader),
    Udp(UdpSocket),
}

impl Readers {
    /// Opens all destinations. An existing file is kept unless `overwrite` is set. The default
    /// `format` is CSV for a file with that extension, otherwise JSON lines. Fails with
    /// [`OutputError`] for the first destination that cannot be opened.
    pub fn open(
        destinations: &[Destination],
        format: Option<StreamFormat>,
        overwrite: bool,
    ) -> Result<Self, OutputError> {
        let mut readers = Self { format, ..Self::default() };
        for destination in destinations {
            let failed = |source| OutputError::failed(destination.to_string(), source);
            let way = match destination {
                Destination::Tcp(address) => {
                    let listener = TcpListener::bind(address).map_err(failed)?;
                    listener.set_nonblocking(true).map_err(failed)?;
                    readers.listeners.push(listener);
                    continue;
                }
                Destination::NetFt(address) => {
                    readers.boxes.push(NetFtBox::open(*address).map_err(failed)?);
                    continue;
                }
                Destination::Stdout => PipeReader::new("stdout", io::stdout()).map(Transport::Pipe),
                Destination::File(path) => {
                    let file = AppendWriter::create(path, overwrite)?;
                    PipeReader::new("file", file).map(Transport::Pipe)
                }
                Destination::Udp(address) => datagrams(*address).map(Transport::Udp),
            };
            let (name, way) = (destination.to_string(), way.map_err(failed)?);
            let format = format.unwrap_or(destination.format());
            let is_output = !matches!(destination, Destination::Udp(_));
            readers
                .readers
                .push(StreamReader { is_output, ..StreamReader::new(name, way, format) });
        }
        Ok(readers)
    }

    pub fn addresses(&self) -> Vec<SocketAddr> {
        self.listeners.iter().filter_map(|listener| listener.local_addr().ok()).collect()
    }

    /// Returns the addresses that answer like a Net F/T box, each with its page.
    pub fn boxes(&self) -> impl Iterator<Item = (SocketAddr, NetFtPage)> {
        self.boxes.iter().map(|of| (of.address(), of.page()))
    }

    pub fn are_gone(&self) -> bool {
        self.readers.is_empty() && self.listeners.is_empty() && self.boxes.is_empty()
    }

    /// Sends a row whose wrench has these axes. Readers that fail are removed.
    pub fn send(&mut self, row: &StreamRow, axes: Axes) {
        self.accept();
        self.boxes.iter().for_each(|of| of.send(row));
        let (number, gone, encoders) = (self.rows, &mut self.gone, &mut self.encoders);
        self.rows += 1;
        // The row in each format, without its end, which differs between readers.
        let mut begun: [Option<Vec<u8>>; 2] = [None, None];
        self.readers.retain_mut(|reader| {
            let at = reader.format as usize;
            let encoder =
                encoders[at].get_or_insert_with(|| RowEncoder::new(reader.format, axes, row));
            let begun = begun[at].get_or_insert_with(|| encoder.begin(row));
            match reader.send(begun, number, encoder) {
                Ok(()) => true,
                Err(error) => {
                    gone.push(reader.summary(Some(error)));
                    false
                }
            }
        });
    }

    fn accept(&mut self) {
        if self.listeners.is_empty() || self.looked.is_some_and(|at| at.elapsed() < ACCEPT) {
            return;
        }
        self.looked = Some(Instant::now());
        for listener in &self.listeners {
            // Skips a connection that is already closed.
            while let Ok((stream, peer)) = listener.accept() {
                if let Ok(reader) = connection(stream) {
                    let (name, way) = (format!("tcp:{peer}"), Transport::Pipe(reader));
                    let format = self.format.unwrap_or_default();
                    self.readers.push(StreamReader::new(name, way, format));
                }
            }
        }
    }

    pub fn finish(mut self) -> Vec<ReaderSummary> {
        let rest = self.readers.iter_mut().map(|reader| reader.summary(None));
        let rest: Vec<_> = rest.collect();
        let boxes = self.boxes.iter().map(NetFtBox::summary);
        let mut all: Vec<ReaderSummary> = self.gone.into_iter().chain(rest).chain(boxes).collect();
        // An output exists from the first row on, so every missing row is lost.
        for output in all.iter_mut().filter(|summary| summary.is_broken) {
            output.lost = self.rows - output.rows;
        }
        all
    }
}

fn connection(stream: TcpStream) -> io::Result<PipeReader> {
    // On some systems a connection inherits the mode of its listener.
    stream.set_nonblocking(false)?;
    stream.set_nodelay(true)?;
    PipeReader::new("tcp", stream)
}

trait RowSink: Send + 'static {
    fn put(&mut self, rows: &[u8]) -> io::Result<()>;

    fn end(self) -> io::Result<()>;
}

impl RowSink for io::Stdout {
    fn put(&mut self, rows: &[u8]) -> io::Result<()> {
        self.write_all(rows).and_then(|()| self.flush())
    }

    fn end(self) -> io::Result<()> {
        Ok(())
    }
}

impl RowSink for TcpStream {
    fn put(&mut self, rows: &[u8]) -> io::Result<()> {
        self.write_all(rows)
    }

    fn end(self) -> io::Result<()> {
        Ok(())
    }
}

/// When the disk is full, the file is cut back to the last complete row.
impl RowSink for AppendWriter {
    fn put(&mut self, rows: &[u8]) -> io::Result<()> {
        self.append(rows).map_err(source)
    }

    fn end(self) -> io::Result<()> {
        Box::new(self).close().map_err(source)
    }
}

/// Returns the system's error, since messages name the reader anyway.
fn source(error: OutputError) -> io::Error {
    match error {
        OutputError::Failed { source, .. } => source,
        error => io::Error::other(error),
    }
}

fn datagrams(to: SocketAddr) -> io::Result<UdpSocket> {
    let socket = match to {
        SocketAddr::V4(_) => UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?,
        SocketAddr::V6(_) => UdpSocket::bind((Ipv6Addr::UNSPECIFIED, 0))?,
    };
    socket.connect(to)?;
    socket.set_nonblocking(true)?;
    Ok(socket)
}

impl StreamReader {
    fn new(name: String, way: Transport, format: StreamFormat) -> Self {
        Self { name, way, format, is_output: false, has_names: false, handed: 0, lost: 0 }
    }

    fn send(&mut self, row: &[u8], number: u64, encoder: &RowEncoder) -> io::Result<()> {
        let names = if self.has_names { None } else { encoder.header() }.unwrap_or_default();
        self.has_names = true;
        let end = encoder.end(number, self.lost);
        let is_taken = match &mut self.way {
            Transport::Pipe(pipe) => pipe.send([&names, row, &end].concat())?,
            // A datagram is a line. Errors are temporary: no listener, or the network is down.
            Transport::Udp(socket) => {
                if !names.is_empty() {
                    _ = socket.send(&names);
                }
                socket.send(&[row, &end].concat()).is_ok()
            }
        };
        match is_taken {
            true => self.handed += 1,
            false => self.lost += 1,
        }
        Ok(())
    }

    fn summary(&mut self, error: Option<io::Error>) -> ReaderSummary {
        let (rows, ended) = match &mut self.way {
            Transport::Udp(_) => (self.handed, Ok(())),
            Transport::Pipe(pipe) => pipe.finish(PATIENCE),
        };
        let error = error.or(ended.err());
        let has_left = |error: &io::Error| {
            matches!(
                error.kind(),
                io::ErrorKind::BrokenPipe
                    | io::ErrorKind::ConnectionReset
                    | io::ErrorKind::ConnectionAborted
            )
        };
        let untaken = self.handed.saturating_sub(rows);
        let left = error.as_ref().is_some_and(has_left);
        let is_broken = self.is_output && error.is_some() && !left;
        ReaderSummary {
            is_broken,
            name: self.name.clone(),
            rows,
            // A reader that has left does not want the pending rows.
            lost: self.lost + if left { 0 } else { untaken },
            problem: error.filter(|error| !has_left(error)).map(|error| error.to_string()),
        }
    }
}

/// Maximum number of rows that wait for a reader: four seconds at 1 kHz.
const WAITING: usize = 4096;

const PIECE: usize = 1 << 16;

/// Queue to a reader with its own thread, since a pipe, disk or network may block.
#[derive(Debug)]
struct PipeReader {
    rows: Option<SyncSender<Vec<u8>>>,
    written: Arc<AtomicU64>,
    thread: Option<JoinHandle<io::Result<()>>>,
}

impl PipeReader {
    fn new(name: &str, out: impl RowSink) -> io::Result<Self> {
        let (rows, receiver) = sync_channel(WAITING);
        let written = Arc::new(AtomicU64::new(0));
        let of_thread = Arc::clone(&written);
        let run = move || write_all(out, &receiver, &of_thread);
        let thread = Some(thread::Builder::new().name(name.to_owned()).spawn(run)?);
        Ok(Self { rows: Some(rows), written, thread })
    }

    /// Queues a row, or returns `false` without room; fails with the error that ended the reader.
    fn send(&mut self, row: Vec<u8>) -> io::Result<bool> {
        let Some(rows) = &self.rows else { return Ok(false) };
        match rows.try_send(row) {
            Err(TrySendError::Disconnected(_)) => {
                self.rows = None;
                self.end().map(|()| false)
            }
            sent => Ok(sent.is_ok()),
        }
    }

    /// Waits until all rows are written, or none was written for `patience`. Returns the number written.
    fn finish(&mut self, patience: Duration) -> (u64, io::Result<()>) {
        self.rows = None;
        let (mut written, mut since) = (self.written.load(Ordering::Acquire), Instant::now());
        while !self.has_ended() && since.elapsed() < patience {
            thread::sleep(Duration::from_millis(1));
            let now_written = self.written.load(Ordering::Acquire);
            if now_written > written {
                (written, since) = (now_written, Instant::now());
            }
        }
        let ended = if self.has_ended() { self.end() } else { Ok(()) };
        (self.written.load(Ordering::Acquire), ended)
    }

    fn has_ended(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    fn end(&mut self) -> io::Result<()> {
        self.thread.take().and_then(|thread| thread.join().ok()).unwrap_or(Ok(()))
    }
}

fn write_all(
    mut out: impl RowSink,
    waiting: &Receiver<Vec<u8>>,
    written: &AtomicU64,
) -> io::Result<()> {
    while let Ok(mut bytes) = waiting.recv() {
        let mut rows = 1;
        while bytes.len() < PIECE
            && let Ok(next) = waiting.try_recv()
        {
            bytes.extend_from_slice(&next);
            rows += 1;
        }
        out.put(&bytes)?;
        written.fetch_add(rows, Ordering::Release);
    }
    out.end()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_without_address_listens_on_this_machine_only() {
        let tcp = |text: &str| Destination::Tcp(text.parse().unwrap());
        assert_eq!("tcp:9000".parse(), Ok(tcp("127.0.0.1:9000")));
        assert_eq!("tcp:0.0.0.0:9000".parse(), Ok(tcp("0.0.0.0:9000")));
        let netft = |port| Destination::NetFt(NetFtAddress { port, ..Default::default() });
        assert_eq!("netft".parse(), Ok(netft(None)));
        assert_eq!("netft:5000".parse(), Ok(netft(Some(5000))));
        assert_eq!("-".parse(), Ok(Destination::Stdout));
        assert_eq!("file:-".parse(), Ok(Destination::File("-".into())));
        assert_eq!("run.csv".parse(), Ok(Destination::File("run.csv".into())));
        for word in ["", "udp:9870", "tcp:host", "tcp:70000", "udp:127.0.0.1", "netft:x"] {
            assert!(word.parse::<Destination>().is_err(), "{word}");
        }
    }

    #[test]
    fn a_file_that_is_named_csv_gets_csv() {
        let format = |word: &str| word.parse::<Destination>().unwrap().format();
        assert_eq!(format("run.csv"), StreamFormat::Csv);
        assert_eq!(format("RUN.CSV"), StreamFormat::Csv);
        assert_eq!(format("run.jsonl"), StreamFormat::JsonLines);
        assert_eq!(format("-"), StreamFormat::JsonLines);
    }
}
