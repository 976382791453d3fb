//! The source of a log: text, decompressed and converted to UTF-8, or a table in a binary file; with an optional
//! companion file.
//!
//! ```text
//! file ─▶ gzip, zstd ─▶ UTF-16 ─▶ text ─▶ joined with a companion file, line by line
//! file ─▶ table ─▶ columns ─▶ joined with those of a companion file
//! ```
//!
//! The format of a file is recognised from its first bytes, not from its name.

use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use flate2::bufread::MultiGzDecoder;
use table_file::{FileKind, FileSource, OpenFile, Recognised, Table, TableError};
use tempfile::TempPath;

use super::bytes::{ByteStream, CountedStream, ReadMeter, UNPACKED_RATIO, Unpacked};
use super::chunk::{LINE_LIMIT, LongLine};
use super::companion::{RowMismatch, SideRows, Sides, joined};
use super::text_rows::TextRows;
use super::utf16::as_utf8;
use crate::error::{LogError, LogPosition, PlacedProblem};

/// A file that can be read from its start any number of times.
#[derive(Clone, Debug)]
pub(crate) struct LogSource {
    pub(crate) path: PathBuf,
    pub(crate) bytes: u64,
    file: FileSource,
    container: Container,
    /// True for big-endian UTF-16.
    utf16: Option<bool>,
    /// The temporary copy of standard input, which must outlive all reads.
    _spool: Option<Arc<TempPath>>,
    /// A file whose columns follow those of this file, row by row.
    pub(crate) companion: Option<Arc<LogSource>>,
    pub(crate) sides: Sides,
}

const HEAD_ROWS: usize = 256;

/// Copies standard input to a file, because logs are read several times.
fn spooled_stdin() -> io::Result<TempPath> {
    let mut file = tempfile::NamedTempFile::new()?;
    io::copy(&mut io::stdin().lock(), file.as_file_mut())?;
    Ok(file.into_temp_path())
}

/// Returns the recording in the folder of a ROS 2 bag, which contains a recording and its description.
fn recording_in(folder: &Path) -> io::Result<PathBuf> {
    let mut recordings = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let endings = [".mcap", ".db3", ".mcap.zstd", ".db3.zstd"];
        recordings.extend(endings.iter().any(|ending| name.ends_with(ending)).then_some(path));
    }
    let is_bag = folder.join("metadata.yaml").is_file();
    match (recordings.pop(), recordings.len()) {
        (Some(recording), 0) if is_bag => Ok(recording),
        (Some(_), others) if is_bag => {
            let files = others + 1;
            Err(io::Error::other(format!("a recording in {files} files: read them one by one")))
        }
        _ => Err(io::ErrorKind::IsADirectory.into()),
    }
}

#[derive(Clone, Debug)]
enum Container {
    Plain,
    Gzip,
    Zstd,
    Table(Table),
}

impl LogSource {
    /// Opens the file at `path`, or standard input for `-`; `part` names the table of a file with several.
    pub(crate) fn new(path: &Path, part: Option<&str>) -> Result<Self, LogError> {
        let failed = |source| LogError::Io { path: path.to_owned(), source };
        let is_stdin = path.as_os_str() == "-";
        let spool = is_stdin.then(spooled_stdin).transpose().map_err(failed)?;
        let file = spool.as_deref().unwrap_or(path);
        // The file is not opened yet, because opening a pipe waits for its writer.
        let metadata = std::fs::metadata(file).map_err(failed)?;
        if metadata.is_dir() {
            let recording = recording_in(file).map_err(failed)?;
            let recording = FileSource::Disk(recording);
            return Self::plain(path, recording).recognise(part);
        }
        if !metadata.is_file() {
            return Err(failed(io::Error::other("not a regular file, which logs must be")));
        }
        let file = FileSource::Disk(file.to_owned());
        Self { _spool: spool.map(Arc::new), ..Self::plain(path, file) }.recognise(part)
    }

    pub(crate) fn in_memory(
        name: &Path,
        bytes: Arc<[u8]>,
        part: Option<&str>,
    ) -> Result<Self, LogError> {
        Self::plain(name, FileSource::Memory(bytes)).recognise(part)
    }

    /// Makes a source from a plain file of unknown size.
    fn plain(path: &Path, file: FileSource) -> Self {
        let (path, container, sides) = (path.to_owned(), Container::Plain, Sides::default());
        Self { path, bytes: 0, file, container, utf16: None, _spool: None, companion: None, sides }
    }

    fn recognise(mut self, part: Option<&str>) -> Result<Self, LogError> {
        self.bytes = self.file.length().map_err(|error| self.error(error))?;
        let start = self.start(self.open_file()?)?;
        self.container = match start.as_slice() {
            [0x1f, 0x8b, ..] => Container::Gzip,
            // A frame, or one to skip.
            [0x28, 0xb5, 0x2f, 0xfd, ..] | [0x50..=0x5f, 0x2a, 0x4d, 0x18, ..] => Container::Zstd,
            _ => Container::Plain,
        };
        let text = match self.container {
            Container::Plain => start,
            _ => self.start(self.open()?)?,
        };
        let kind = match table_file::recognise(&text) {
            Recognised::Unknown => None,
            Recognised::Table(_) if self.compression().is_some() => {
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
            self.container = Container::Table(table.map_err(|problem| self.table_error(problem))?);
            return Ok(self);
        }
        self.utf16 = match text.as_slice() {
            [0xff, 0xfe, ..] => Some(false),
            [0xfe, 0xff, ..] => Some(true),
            _ => None,
        };
        Ok(self)
    }

    /// Adds the columns of another file with the same rows.
    pub(crate) fn with_companion(self, companion: Self) -> Result<Self, LogError> {
        let source = Self { companion: Some(Arc::new(companion)), ..self };
        let sides = match &source.companion {
            Some(companion) if source.is_text() => {
                Sides::new([source.open_alone()?, companion.open()?])
            }
            _ => {
                let heads = source.heads()?;
                Sides::new(heads.each_ref().map(Vec::as_slice))
            }
        };
        let sides = sides.map_err(|error| source.error(error))?;
        Ok(Self { sides, ..source })
    }

    /// Adds the columns of another text, below the heads of both.
    pub(crate) fn with_rows_of(self, companion: Self, rows: [SideRows; 2]) -> Self {
        Self { companion: Some(Arc::new(companion)), sides: Sides::of_logs(rows), ..self }
    }

    /// Returns the first lines of this file and its companion; at least one of the two is a table.
    fn heads(&self) -> Result<[Vec<u8>; 2], LogError> {
        let head = |source: &Self| match source.as_table() {
            Some(table) => {
                let head = table.head(None, HEAD_ROWS, usize::MAX);
                head.map_err(|problem| source.table_error(problem))
            }
            None => {
                let head = TextRows::new(source.open_alone()?).head(HEAD_ROWS + 1);
                head.map_err(|error| source.error(error))
            }
        };
        let companion = self.companion.as_deref().map(head).transpose()?;
        Ok([head(self)?, companion.unwrap_or_default()])
    }

    /// Returns the first `bytes` of the text. For a table, returns its first rows as text; if columns have names,
    /// only those in `shown` are filled.
    pub(crate) fn head(&self, shown: Option<&[usize]>, bytes: usize) -> Result<Vec<u8>, LogError> {
        if let Some(table) = self.as_whole_table() {
            let head = table.head(shown, HEAD_ROWS, bytes);
            return head.map_err(|problem| self.table_error(problem));
        }
        let mut head = Vec::with_capacity(bytes);
        let read = match self.is_text() {
            true => self.open()?.take(bytes as u64).read_to_end(&mut head),
            false => {
                let heads = self.heads()?;
                let heads = heads.each_ref().map(Vec::as_slice);
                joined(heads, self.sides.clone()).read_to_end(&mut head)
            }
        };
        read.map_err(|error| self.error(error))?;
        Ok(head)
    }

    fn start(&self, stream: impl Read) -> Result<Vec<u8>, LogError> {
        let mut start = Vec::with_capacity(table_file::RECOGNISED_BYTES);
        let mut stream = stream.take(table_file::RECOGNISED_BYTES as u64);
        stream.read_to_end(&mut start).map_err(|error| self.error(error))?;
        Ok(start)
    }

    pub(crate) fn open_file(&self) -> Result<OpenFile, LogError> {
        self.file.open().map_err(|error| self.error(error))
    }

    pub(crate) fn open(&self) -> Result<ByteStream, LogError> {
        self.open_counting(&ReadMeter::default())
    }

    pub(crate) fn open_counting(&self, meter: &ReadMeter) -> Result<ByteStream, LogError> {
        let text = self.open_alone_counting(meter)?;
        let Some(companion) = &self.companion else { return Ok(text) };
        Ok(Box::new(joined([text, companion.open()?], self.sides.clone())))
    }

    /// Opens the text of this file alone.
    pub(crate) fn open_alone(&self) -> Result<ByteStream, LogError> {
        self.open_alone_counting(&ReadMeter::default())
    }

    fn open_alone_counting(&self, meter: &ReadMeter) -> Result<ByteStream, LogError> {
        let file = || {
            let (stream, meter) = (self.open_file()?, meter.clone());
            Ok::<_, LogError>(CountedStream { stream, meter, left: self.bytes })
        };
        let buffered = || Ok::<_, LogError>(BufReader::with_capacity(1 << 16, file()?));
        let left = self.bytes.saturating_mul(UNPACKED_RATIO).saturating_add(64 << 20);
        let text: ByteStream = match &self.container {
            Container::Plain | Container::Table(_) => Box::new(file()?),
            Container::Gzip => {
                Box::new(Unpacked { decoder: MultiGzDecoder::new(buffered()?), left })
            }
            Container::Zstd => {
                Box::new(Unpacked { decoder: zrip::FrameDecoder::new(buffered()?), left })
            }
        };
        Ok(match self.utf16 {
            None => text,
            Some(high_first) => Box::new(as_utf8(text, high_first)),
        })
    }

    /// Reads the whole file for its checksum, if `meter` computes one: tables are not read from start to end.
    pub(crate) fn read_for_checksum(&self, meter: &ReadMeter) -> Result<(), LogError> {
        if let Some(meter) = meter.of_checksum() {
            let mut whole = CountedStream { stream: self.open_file()?, meter, left: self.bytes };
            io::copy(&mut whole, &mut io::sink()).map_err(|error| self.error(error))?;
        }
        Ok(())
    }

    pub(crate) fn is_text(&self) -> bool {
        self.as_table().is_none()
            && self.companion.as_ref().is_none_or(|companion| companion.is_text())
    }

    /// Returns true if the text is identical to the bytes of the file.
    pub(crate) fn is_plain(&self) -> bool {
        matches!(self.container, Container::Plain)
            && self.utf16.is_none()
            && self.companion.is_none()
    }

    pub(crate) fn compression(&self) -> Option<&'static str> {
        match self.container {
            Container::Gzip => Some("gzip"),
            Container::Zstd => Some("zstd"),
            Container::Plain | Container::Table(_) => None,
        }
    }

    pub(crate) fn as_table(&self) -> Option<&Table> {
        match &self.container {
            Container::Table(table) => Some(table),
            _ => None,
        }
    }

    pub(crate) fn as_whole_table(&self) -> Option<&Table> {
        self.as_table().filter(|_| self.companion.is_none())
    }

    /// Converts a line number of the text, from 1, to a position in the file.
    pub(crate) fn position(&self, line: u64) -> LogPosition {
        match (self.as_table().map(|table| &table.columns), line) {
            (None, line) => LogPosition::Line(line),
            (Some(Some(_)), 0 | 1) => LogPosition::Names,
            (Some(Some(_)), line) => LogPosition::Row(line - 1),
            (Some(None), line) => LogPosition::Row(line),
        }
    }

    /// Returns the error for a problem at a line of the text.
    pub(crate) fn error_at(&self, line: u64, problem: impl Into<PlacedProblem>) -> LogError {
        let (path, position) = (self.path.clone(), self.position(line));
        let problem = problem.into();
        let left_out = match (&problem, self.as_table()) {
            (PlacedProblem::MissingColumns { missing, .. }, Some(table)) => {
                missing.iter().find_map(|column| {
                    let why = table.reason_of_absence(column)?.to_owned();
                    Some(PlacedProblem::LeftOutColumn { column: column.clone(), why })
                })
            }
            _ => None,
        };
        LogError::At { path, position, problem: left_out.unwrap_or(problem) }
    }

    pub(crate) fn table_error(&self, problem: TableError) -> LogError {
        match problem {
            TableError::Io(source) => LogError::Io { path: self.path.clone(), source },
            problem => LogError::Table { path: self.path.clone(), problem },
        }
    }

    pub(crate) fn mismatch(&self, problem: RowMismatch) -> LogError {
        let companion = self.companion.as_ref().map(|companion| companion.path.clone());
        let companion = companion.unwrap_or_default();
        LogError::RowMismatch { path: self.path.clone(), companion, problem }
    }

    pub(crate) fn error(&self, source: impl Into<io::Error>) -> LogError {
        use io::ErrorKind::{InvalidData, InvalidInput, Other, UnexpectedEof};
        let path = self.path.clone();
        let source = match source.into().downcast::<LongLine>() {
            Ok(long) => return self.error_at(long.0, PlacedProblem::LineTooLong(LINE_LIMIT)),
            Err(source) => source,
        };
        let source = match source.downcast::<RowMismatch>() {
            Ok(problem) => return self.mismatch(problem),
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
