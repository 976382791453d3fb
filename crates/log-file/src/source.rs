//! The bytes of a log: a file as it is or, where it starts like gzip, what it unpacks to.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use flate2::bufread::MultiGzDecoder;

use super::LogError;
use crate::checksum::Checksum;

/// A file to be read from its start any number of times.
#[derive(Debug)]
pub(super) struct Source {
    pub(super) path: PathBuf,
    /// Size on disk.
    pub(super) bytes: u64,
    pub(super) compressed: bool,
}

impl Source {
    pub(super) fn new(path: &Path) -> Result<Self, LogError> {
        let source = Self { path: path.to_owned(), bytes: 0, compressed: false };
        let mut file = source.file()?;
        let metadata = file.metadata().map_err(|error| source.error(error))?;
        if metadata.is_dir() {
            return Err(source.error(io::ErrorKind::IsADirectory.into()));
        }
        if !metadata.is_file() {
            return Err(source.error(io::Error::other("not a regular file, which logs must be")));
        }
        let mut magic = Vec::with_capacity(2);
        Read::take(&mut file, 2).read_to_end(&mut magic).map_err(|error| source.error(error))?;
        Ok(Self { bytes: metadata.len(), compressed: magic == [0x1f, 0x8b], ..source })
    }

    pub(super) fn file(&self) -> Result<File, LogError> {
        File::open(&self.path).map_err(|error| self.error(error))
    }

    /// Opens the file at its start.
    pub(super) fn open(&self) -> Result<Stream, LogError> {
        self.open_counting(false, &Arc::default())
    }

    /// The same; what is read of the file on disk is added to `bytes`.
    pub(super) fn open_counting(
        &self,
        checksum: bool,
        bytes: &Arc<AtomicU64>,
    ) -> Result<Stream, LogError> {
        let checksum = checksum.then(Box::default);
        let tap = Tap { file: self.file()?, bytes: Arc::clone(bytes), checksum };
        Ok(match self.compressed {
            true => {
                let tap = BufReader::with_capacity(1 << 16, tap);
                Stream::Gzip(Box::new(MultiGzDecoder::new(tap)))
            }
            false => Stream::Plain(tap),
        })
    }

    /// What a failure to read means.
    pub(super) fn error(&self, source: io::Error) -> LogError {
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
pub(super) enum Stream {
    Plain(Tap),
    Gzip(Box<MultiGzDecoder<BufReader<Tap>>>),
}

impl Stream {
    /// The checksum of the file on disk, once it has been read to its end.
    pub(super) fn checksum(&self) -> Option<String> {
        self.tap().checksum.as_ref().map(|checksum| checksum.finish())
    }

    fn tap(&self) -> &Tap {
        match self {
            Stream::Plain(tap) => tap,
            Stream::Gzip(decoder) => decoder.get_ref().get_ref(),
        }
    }
}

impl Read for Stream {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            Stream::Plain(tap) => tap.read(buffer),
            Stream::Gzip(decoder) => decoder.read(buffer),
        }
    }
}

/// A file that counts and sums up what is read from it.
#[derive(Debug)]
pub(super) struct Tap {
    file: File,
    bytes: Arc<AtomicU64>,
    checksum: Option<Box<Checksum>>,
}

impl Read for Tap {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.file.read(buffer)?;
        self.bytes.fetch_add(read as u64, Ordering::Relaxed);
        if let Some(checksum) = &mut self.checksum {
            checksum.update(&buffer[..read]);
        }
        Ok(read)
    }
}
