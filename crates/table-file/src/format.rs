//! What a format reads, the bytes of a file, and what it gives: the names of columns, and a stream of rows.

use std::borrow::Cow;
use std::fmt;
use std::fs::File;
use std::io::{self, Cursor, Read, Seek};
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

use crate::budget::Unpacked;
use crate::kind::TableError;

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

/// A file that is read.
pub type OpenFile = Box<dyn FileBytes>;

/// The bytes of an open file.
pub trait FileBytes: Read + Seek + Send {}

impl<T: Read + Seek + Send> FileBytes for T {}

/// A value in a table.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Cell {
    /// Nothing.
    #[default]
    Missing,
    /// A number.
    Real(f64),
    /// A whole number.
    Whole(i64),
    /// Text, or a time in ISO 8601.
    Text(String),
}

/// Some rows of a column.
#[derive(Clone, Debug, PartialEq)]
pub enum Cells<'a> {
    /// Names and remarks.
    Text(Cow<'a, [String]>),
    /// Numbers, some of which may be missing.
    Number(Cow<'a, [Option<f64>]>),
    /// Numbers that are all there.
    Full(Cow<'a, [f64]>),
    /// Counts, some of which may be missing.
    Count(Cow<'a, [Option<u64>]>),
}

impl Cells<'_> {
    /// How many rows there are.
    pub fn rows(&self) -> usize {
        match self {
            Self::Text(values) => values.len(),
            Self::Number(values) => values.len(),
            Self::Full(values) => values.len(),
            Self::Count(values) => values.len(),
        }
    }
}

/// Some rows, column by column.
pub(crate) type RowBatch = Vec<Vec<Cell>>;

/// How many rows of so many columns are read at a time.
pub(crate) fn batch_rows(columns: usize) -> usize {
    ((1 << 15) / columns.max(1)).max(1)
}

/// The names of the columns, `None` where they have none or the rows hold them; and what their rows are in.
pub(crate) type NamedRows = (Option<Vec<String>>, Arc<dyn RowSource>);

/// What a format knows of one of its files.
pub(crate) trait RowSource: fmt::Debug + Send + Sync {
    /// What a column holds, from 0, if that is not read: its cells are missing then.
    fn unread(&self, _column: usize) -> Option<&'static str> {
        None
    }

    /// How many parts the rows are stored in, any of which can be read without those before it.
    fn parts(&self) -> usize {
        1
    }

    /// The rows of some parts; what is unpacked for them counts as part of `unpacked`.
    fn rows(
        self: Arc<Self>,
        parts: Range<usize>,
        unpacked: Unpacked,
    ) -> Result<RowStream, TableError>;
}

/// A stream of rows: puts the next ones into the batch; `false` if there are no more. Columns may differ in
/// number from one batch to the next, but are all of one length.
pub(crate) type RowStream = Box<dyn FnMut(&mut RowBatch) -> Result<bool, TableError> + Send>;
