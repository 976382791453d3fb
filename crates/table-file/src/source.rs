//! The bytes of a file: on disk, or in memory where there is no disk.

use std::fs::File;
use std::io::{self, Cursor, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A file to be opened any number of times.
#[derive(Clone, Debug)]
pub enum FileSource {
    /// On disk.
    Disk(PathBuf),
    /// In memory, as a browser hands files over.
    Memory(Arc<[u8]>),
}

impl FileSource {
    /// Opens it at its start.
    ///
    /// # Errors
    /// [`io::Error`] if a file on disk cannot be opened.
    pub fn open(&self) -> io::Result<OpenFile> {
        Ok(match self {
            Self::Disk(path) => OpenFile::Disk(File::open(path)?),
            Self::Memory(bytes) => OpenFile::Memory(Cursor::new(Arc::clone(bytes))),
        })
    }
}

impl From<&Path> for FileSource {
    fn from(path: &Path) -> Self {
        Self::Disk(path.to_owned())
    }
}

/// A file that is read.
#[derive(Debug)]
pub enum OpenFile {
    /// On disk.
    Disk(File),
    /// In memory.
    Memory(Cursor<Arc<[u8]>>),
}

impl OpenFile {
    /// Its length in bytes.
    ///
    /// # Errors
    /// [`io::Error`] if the system does not say.
    pub fn length(&self) -> io::Result<u64> {
        match self {
            Self::Disk(file) => Ok(file.metadata()?.len()),
            Self::Memory(bytes) => Ok(bytes.get_ref().len() as u64),
        }
    }
}

impl Read for OpenFile {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Disk(file) => file.read(buffer),
            Self::Memory(bytes) => bytes.read(buffer),
        }
    }
}

impl Seek for OpenFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match self {
            Self::Disk(file) => file.seek(to),
            Self::Memory(bytes) => bytes.seek(to),
        }
    }
}
