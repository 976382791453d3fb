//! The bytes of a log as text: those of the file, unpacked if it is compressed, brought to UTF-8, or
//! the rows of a table in a binary file as CSV.
//!
//! ```text
//! file ─▶ gzip, zstd ─▶ UTF-16 ─┐
//! file ─▶ table as CSV ─────────┴▶ text ─▶ with that of a file beside it, line by line
//! ```
//!
//! What a file is, is known by its first bytes, not by its name.

use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use flate2::bufread::MultiGzDecoder;
use table_file::{FileKind, FileSource, OpenFile, Recognised, Table, TableError};
use tempfile::TempPath;
use twox_hash::XxHash3_128;

use super::chunk::{LINE_LIMIT, LongLine};
use super::companion::{RowMismatch, Sides, joined};
use super::utf16::as_utf8;
use super::zstd::{self, Zstd};
use crate::checksum;
use crate::error::{LogError, LogPosition, PlacedProblem};
use shell_data::lock::lock;

/// A file to be read from its start any number of times.
#[derive(Clone, Debug)]
pub(crate) struct LogSource {
    /// As it was given.
    pub(crate) path: PathBuf,
    /// Its size.
    pub(crate) bytes: u64,
    file: FileSource,
    container: Container,
    /// Whether the text is UTF-16, with the highest byte of each pair first.
    utf16: Option<bool>,
    /// A file that stands in for standard input, as long as it is read.
    _spool: Option<Arc<TempPath>>,
    /// A file whose columns stand beside those of this one, row by row.
    pub(crate) companion: Option<Arc<LogSource>>,
    /// What the first lines of both say.
    pub(crate) sides: Sides,
}

/// A file with all of standard input: logs are read several times.
fn spooled_stdin() -> io::Result<TempPath> {
    let mut file = tempfile::NamedTempFile::new()?;
    io::copy(&mut io::stdin().lock(), file.as_file_mut())?;
    Ok(file.into_temp_path())
}

/// What the text of a log is in.
#[derive(Clone, Debug)]
enum Container {
    Plain,
    Gzip,
    Zstd,
    Table(Table),
}

impl LogSource {
    /// The file at `path`, or all of standard input for `-`; `part` names the table to be read of a
    /// file that can hold several.
    pub(crate) fn new(path: &Path, part: Option<&str>) -> Result<Self, LogError> {
        let failed = |source| LogError::Io { path: path.to_owned(), source };
        let is_stdin = path.as_os_str() == "-";
        let spool = is_stdin.then(spooled_stdin).transpose().map_err(failed)?;
        let file = spool.as_deref().unwrap_or(path);
        // Before it is opened: whoever opens a pipe waits for its writer.
        let metadata = std::fs::metadata(file).map_err(failed)?;
        if metadata.is_dir() {
            return Err(failed(io::ErrorKind::IsADirectory.into()));
        }
        if !metadata.is_file() {
            return Err(failed(io::Error::other("not a regular file, which logs must be")));
        }
        let file = FileSource::Disk(file.to_owned());
        Self { _spool: spool.map(Arc::new), ..Self::plain(path, file) }.recognise(part)
    }

    /// A file in memory, called `name`.
    pub(crate) fn in_memory(
        name: &Path,
        bytes: Arc<[u8]>,
        part: Option<&str>,
    ) -> Result<Self, LogError> {
        Self::plain(name, FileSource::Memory(bytes)).recognise(part)
    }

    /// A plain file of unknown size.
    fn plain(path: &Path, file: FileSource) -> Self {
        let (path, container, sides) = (path.to_owned(), Container::Plain, Sides::default());
        Self { path, bytes: 0, file, container, utf16: None, _spool: None, companion: None, sides }
    }

    /// The same with what it is by its first bytes.
    fn recognise(mut self, part: Option<&str>) -> Result<Self, LogError> {
        self.bytes = self.file.length().map_err(|error| self.error(error))?;
        let start = self.start(self.open_file()?)?;
        self.container = match start.as_slice() {
            [0x1f, 0x8b, ..] => Container::Gzip,
            start if zstd::begins(start) => Container::Zstd,
            _ => Container::Plain,
        };
        let text = match self.container {
            Container::Plain => start,
            _ => self.start(self.open()?)?,
        };
        let kind = match table_file::recognise(&text) {
            Recognised::Unknown => None,
            _ if self.compression().is_some() => {
                let what = "a compressed file of something other than text";
                let remedy = "unpack it first; compressed logs are text";
                return Err(LogError::Foreign { path: self.path, what, remedy });
            }
            Recognised::Table(kind) => Some(kind),
            Recognised::Foreign { what, remedy } => {
                return Err(LogError::Foreign { path: self.path, what, remedy });
            }
        };
        if let (None | Some(FileKind::NumPy | FileKind::Parquet), Some(part)) = (kind, part) {
            return Err(LogError::NoParts { path: self.path, wanted: part.to_owned() });
        }
        if let Some(kind) = kind {
            let table = Table::open(&self.file, kind, part);
            self.container = Container::Table(table.map_err(|error| self.error(error))?);
            return Ok(self);
        }
        self.utf16 = match text.as_slice() {
            [0xff, 0xfe, ..] => Some(false),
            [0xfe, 0xff, ..] => Some(true),
            _ => None,
        };
        Ok(self)
    }

    /// The same with the columns of another file, whose rows are those of this one.
    pub(crate) fn with_companion(self, companion: Self) -> Result<Self, LogError> {
        let streams = [self.open()?, companion.open()?];
        let source = Self { companion: Some(Arc::new(companion)), ..self };
        let sides = Sides::new(streams).map_err(|error| source.error(error))?;
        Ok(Self { sides, ..source })
    }

    /// The first bytes of a stream.
    fn start(&self, stream: impl Read) -> Result<Vec<u8>, LogError> {
        let mut start = Vec::with_capacity(table_file::RECOGNISED_BYTES);
        let mut stream = stream.take(table_file::RECOGNISED_BYTES as u64);
        stream.read_to_end(&mut start).map_err(|error| self.error(error))?;
        Ok(start)
    }

    pub(crate) fn open_file(&self) -> Result<OpenFile, LogError> {
        self.file.open().map_err(|error| self.error(error))
    }

    /// Opens the text at its start.
    pub(crate) fn open(&self) -> Result<ByteStream, LogError> {
        self.open_counting(1, &ReadMeter::default())
    }

    /// The same, by so many threads where a table is stored in parts; `meter` counts what is read of the file.
    pub(crate) fn open_counting(
        &self,
        threads: usize,
        meter: &ReadMeter,
    ) -> Result<ByteStream, LogError> {
        let file = |meter: &ReadMeter| {
            let (stream, meter) = (self.open_file()?, meter.clone());
            Ok::<_, LogError>(CountedStream { stream, meter, left: self.bytes })
        };
        let buffered = || Ok::<_, LogError>(BufReader::with_capacity(1 << 16, file(meter)?));
        let left = self.bytes.saturating_mul(UNPACKED_RATIO).saturating_add(64 << 20);
        let text: ByteStream = match &self.container {
            Container::Plain => Box::new(file(meter)?),
            Container::Gzip => {
                Box::new(Unpacked { decoder: MultiGzDecoder::new(buffered()?), left })
            }
            Container::Zstd => Box::new(Unpacked { decoder: Zstd::new(buffered()?), left }),
            Container::Table(table) => {
                // Tables are not read from start to end, checksums are.
                if meter.checksum.is_some() {
                    let mut whole = file(&ReadMeter { bytes: Arc::default(), ..meter.clone() })?;
                    io::copy(&mut whole, &mut io::sink()).map_err(|error| self.error(error))?;
                }
                let stream = table.text(threads).map_err(|error| self.error(error))?;
                let meter = ReadMeter { checksum: None, ..meter.clone() };
                Box::new(CountedStream { stream, meter, left: self.bytes })
            }
        };
        let text = match self.utf16 {
            None => text,
            Some(high_first) => Box::new(as_utf8(text, high_first)),
        };
        let Some(companion) = &self.companion else { return Ok(text) };
        Ok(Box::new(joined([text, companion.open()?], self.sides)))
    }

    /// Whether the bytes of the file are those of the text.
    pub(crate) fn is_plain(&self) -> bool {
        matches!(self.container, Container::Plain)
            && self.utf16.is_none()
            && self.companion.is_none()
    }

    /// How the file is compressed, if it is.
    pub(crate) fn compression(&self) -> Option<&'static str> {
        match self.container {
            Container::Gzip => Some("gzip"),
            Container::Zstd => Some("zstd"),
            Container::Plain | Container::Table(_) => None,
        }
    }

    /// The table, if it is one.
    pub(crate) fn as_table(&self) -> Option<&Table> {
        match &self.container {
            Container::Table(table) => Some(table),
            _ => None,
        }
    }

    /// The table whose columns are all there are, if it is one.
    pub(crate) fn as_whole_table(&self) -> Option<&Table> {
        self.as_table().filter(|_| self.companion.is_none())
    }

    /// What a line of the text, from 1, is in the file.
    pub(crate) fn position(&self, line: u64) -> LogPosition {
        match (self.as_table().map(|table| &table.names), line) {
            (None, line) => LogPosition::Line(line),
            (Some(Some(_)), 0 | 1) => LogPosition::Names,
            (Some(Some(_)), line) => LogPosition::Row(line - 1),
            (Some(None), line) => LogPosition::Row(line),
        }
    }

    /// The error of what is wrong at a line of the text.
    pub(crate) fn error_at(&self, line: u64, problem: impl Into<PlacedProblem>) -> LogError {
        let (path, position) = (self.path.clone(), self.position(line));
        LogError::At { path, position, problem: problem.into() }
    }

    /// The error of a failed read.
    pub(crate) fn error(&self, source: impl Into<io::Error>) -> LogError {
        use io::ErrorKind::{InvalidData, InvalidInput, Other, UnexpectedEof};
        let path = self.path.clone();
        let source = match source.into().downcast::<LongLine>() {
            Ok(long) => return self.error_at(long.0, PlacedProblem::LineTooLong(LINE_LIMIT)),
            Err(source) => source,
        };
        let source = match source.downcast::<TableError>() {
            Ok(problem) => return LogError::Table { path, problem },
            Err(source) => source,
        };
        let source = match source.downcast::<RowMismatch>() {
            Ok(problem) => {
                let companion = self.companion.as_ref().map(|companion| companion.path.clone());
                let companion = companion.unwrap_or_default();
                return LogError::RowMismatch { path, companion, problem };
            }
            Err(source) => source,
        };
        match (self.compression(), source.kind()) {
            (Some(method), InvalidData | InvalidInput | Other | UnexpectedEof) => {
                LogError::Unpacking { path, method, source }
            }
            _ => LogError::Io { path, source },
        }
    }
}

/// How many times its size a compressed log may unpack to, beyond 64 MB. A log of numbers that were measured takes a
/// third to a twentieth of its text when compressed; what unpacks to a thousand times its size costs time and says
/// nothing.
const UNPACKED_RATIO: u64 = 128;

/// A decoder that may give `left` more bytes.
struct Unpacked<D> {
    decoder: D,
    left: u64,
}

impl<D: Read> Read for Unpacked<D> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.decoder.read(buffer)?;
        self.left = self.left.checked_sub(read as u64).ok_or_else(|| {
            let text = format!(
                "it unpacks to more than {UNPACKED_RATIO} times its size and 64 MB; if it is a log, unpack it \
                 first: a file as it is may be of any size"
            );
            io::Error::new(io::ErrorKind::FileTooLarge, text)
        })?;
        Ok(read)
    }
}

/// The text of a log from its start.
pub(crate) type ByteStream = Box<dyn Read + Send>;

/// What is counted while files on disk are read.
#[derive(Clone, Default)]
pub(crate) struct ReadMeter {
    /// The bytes that have been read.
    pub(crate) bytes: Arc<AtomicU64>,
    /// The checksum of the file that is being read, where it is asked for.
    checksum: Option<Arc<Mutex<XxHash3_128>>>,
}

impl ReadMeter {
    /// Begins another file.
    pub(crate) fn begin(&mut self, checksum: bool) {
        self.checksum = checksum.then(Arc::default);
    }

    /// The checksum of a file that has been read to its end.
    pub(crate) fn checksum(&self) -> Option<String> {
        self.checksum.as_ref().map(|checksum| checksum::text(&lock(checksum)))
    }
}

/// A file, or a table as text, whose bytes count as those that have been read of the file.
struct CountedStream<R> {
    stream: R,
    meter: ReadMeter,
    /// How many bytes of the file have not been counted.
    left: u64,
}

impl<R: Read> Read for CountedStream<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.stream.read(buffer)?;
        let counted = if read == 0 { self.left } else { self.left.min(read as u64) };
        self.left -= counted;
        self.meter.bytes.fetch_add(counted, Ordering::Relaxed);
        if let Some(checksum) = &self.meter.checksum {
            lock(checksum).write(&buffer[..read]);
        }
        Ok(read)
    }
}
