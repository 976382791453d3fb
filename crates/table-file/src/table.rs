//! A table of any kind: its columns, and a stream of its rows.

use std::sync::Arc;

use crate::error::TableError;
use crate::kind::FileKind;
use crate::rows::RowSource;
use crate::source::FileSource;
use crate::{hdf5, mat5, mcap, npy, parquet, xlsx};

/// A table in a file.
#[derive(Clone, Debug)]
pub struct Table {
    kind: FileKind,
    names: Option<Vec<String>>,
    pub(crate) rows: Arc<dyn RowSource>,
}

impl Table {
    /// Finds the columns of the table in a file of this kind: of the matrix, group, sheet or topic `part`, or
    /// of the one that holds a log.
    ///
    /// # Errors
    /// [`TableError`] if the file cannot be read, is damaged, or has no such part.
    pub fn open(
        file: impl Into<FileSource>,
        kind: FileKind,
        part: Option<&str>,
    ) -> Result<Self, TableError> {
        let file = &file.into();
        let (names, rows) = match kind {
            FileKind::Hdf5 => hdf5::open(file, part)?,
            FileKind::Matlab => mat5::open(file, part)?,
            FileKind::Mcap => mcap::open(file, part)?,
            FileKind::NumPy => npy::open(file)?,
            FileKind::Parquet => parquet::open(file)?,
            FileKind::Xlsx => xlsx::open(file, part)?,
        };
        Ok(Self { kind, names, rows })
    }

    /// What kind of file it is.
    pub fn kind(&self) -> FileKind {
        self.kind
    }

    /// The names of its columns; `None` where they have none, or the rows hold them.
    pub fn names(&self) -> Option<&[String]> {
        self.names.as_deref()
    }

    /// Checks that the values of a column, from 0, are read.
    ///
    /// # Errors
    /// [`TableError::Unsupported`] with its name and what it holds.
    pub fn check_is_read(&self, column: usize) -> Result<(), TableError> {
        let Some(what) = self.rows.unread(column) else { return Ok(()) };
        let name = self.names().and_then(|names| names.get(column)).map_or("", String::as_str);
        Err(self.kind.unsupported(format!("column `{name}` holds values of type {what}")))
    }
}
