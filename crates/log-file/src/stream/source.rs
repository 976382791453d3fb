//! The bytes of a log: those of the file or, if it is compressed with gzip, of its content.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use flate2::bufread::MultiGzDecoder;

use crate::checksum::Checksum;
use crate::error::LogError;

/// A file to be read from its start any number of times.
#[derive(Debug)]
pub(crate) struct LogSource {
    pub(crate) path: PathBuf,
    /// Size on disk.
    pub(crate) bytes: u64,
    pub(crate) compressed: bool,
}

impl LogSource {
    pub(crate) fn new(path: &Path) -> Result<Self, LogError> {
        let source = Self { path: path.to_owned(), bytes: 0, compressed: false };
        // Before it is opened: whoever opens a pipe waits for its writer.
        let metadata = std::fs::metadata(path).map_err(|error| source.error(error))?;
        if metadata.is_dir() {
            return Err(source.error(io::ErrorKind::IsADirectory.into()));
        }
        if !metadata.is_file() {
            return Err(source.error(io::Error::other("not a regular file, which logs must be")));
        }
        let mut file = source.file()?;
        let mut magic = Vec::with_capacity(2);
        Read::take(&mut file, 2).read_to_end(&mut magic).map_err(|error| source.error(error))?;
        Ok(Self { bytes: metadata.len(), compressed: magic == [0x1f, 0x8b], ..source })
    }

    pub(crate) fn file(&self) -> Result<File, LogError> {
        File::open(&self.path).map_err(|error| self.error(error))
    }

    /// Opens the file at its start.
    pub(crate) fn open(&self) -> Result<ByteStream, LogError> {
        self.open_counting(false, &Arc::default())
    }

    /// The same; what is read of the file on disk is added to `bytes`.
    pub(crate) fn open_counting(
        &self,
        checksum: bool,
        bytes: &Arc<AtomicU64>,
    ) -> Result<ByteStream, LogError> {
        let checksum = checksum.then(Box::default);
        let file = CountingFile { file: self.file()?, bytes: Arc::clone(bytes), checksum };
        Ok(match self.compressed {
            true => {
                let file = BufReader::with_capacity(1 << 16, file);
                ByteStream::Gzip(Box::new(MultiGzDecoder::new(file)))
            }
            false => ByteStream::Plain(file),
        })
    }

    /// The error of a failed read.
    pub(crate) fn error(&self, source: io::Error) -> LogError {
        use io::ErrorKind::{InvalidData, InvalidInput, UnexpectedEof};
        let path = self.path.clone();
        match source.kind() {
            InvalidData | InvalidInput | UnexpectedEof if self.compressed => {
                LogError::Gzip { path, source }
            }
            _ => LogError::Io { path, source },
        }
    }
}

/// The bytes of a log from its start.
#[derive(Debug)]
pub(crate) enum ByteStream {
    Plain(CountingFile),
    Gzip(Box<MultiGzDecoder<BufReader<CountingFile>>>),
}

impl ByteStream {
    /// The checksum of the file on disk, once it has been read to its end.
    pub(crate) fn checksum(&self) -> Option<String> {
        self.file().checksum.as_ref().map(|checksum| checksum.finish())
    }

    fn file(&self) -> &CountingFile {
        match self {
            ByteStream::Plain(file) => file,
            ByteStream::Gzip(decoder) => decoder.get_ref().get_ref(),
        }
    }
}

impl Read for ByteStream {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            ByteStream::Plain(file) => file.read(buffer),
            ByteStream::Gzip(decoder) => decoder.read(buffer),
        }
    }
}

/// A file that counts the bytes read from it and computes their checksum.
#[derive(Debug)]
pub(crate) struct CountingFile {
    file: File,
    bytes: Arc<AtomicU64>,
    checksum: Option<Box<Checksum>>,
}

impl Read for CountingFile {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.file.read(buffer)?;
        self.bytes.fetch_add(read as u64, Ordering::Relaxed);
        if let Some(checksum) = &mut self.checksum {
            checksum.update(&buffer[..read]);
        }
        Ok(read)
    }
}
