//! The bytes of a file: on disk, or in memory where there is no disk.

use std::fs::File;
use std::io::{self, Cursor, Read, Seek};
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
            Self::Disk(path) => Box::new(File::open(path)?),
            Self::Memory(bytes) => Box::new(Cursor::new(Arc::clone(bytes))),
        })
    }

    /// The number of its bytes.
    ///
    /// # Errors
    /// [`io::Error`] if the system does not say.
    pub fn length(&self) -> io::Result<u64> {
        match self {
            Self::Disk(path) => Ok(path.metadata()?.len()),
            Self::Memory(bytes) => Ok(bytes.len() as u64),
        }
    }
}

impl From<&Path> for FileSource {
    fn from(path: &Path) -> Self {
        Self::Disk(path.to_owned())
    }
}

/// A file that is read.
pub type OpenFile = Box<dyn FileBytes>;

/// The bytes of an open file.
pub trait FileBytes: Read + Seek + Send {}

impl<T: Read + Seek + Send> FileBytes for T {}
