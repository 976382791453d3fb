//! A table of any kind: its columns, and a stream of its rows.

use std::fmt;
use std::path::Path;
use std::sync::Arc;

use crate::error::TableError;
use crate::kind::FileKind;
use crate::{arrow, mat5, mcap, npy, parquet, xlsx};

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

/// Some rows, column by column.
pub(crate) type Batch = Vec<Vec<Cell>>;

/// How many rows of so many columns are read at a time.
pub(crate) fn batch_rows(columns: usize) -> usize {
    ((1 << 15) / columns.max(1)).max(1)
}

/// What the lines of a table's text are in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Numbering {
    /// A first line of names, then the rows from 1.
    Named,
    /// The rows from 1.
    Unnamed,
    /// Rows as the file itself numbers them, from 1, with names in one of them or nowhere.
    Sheet,
}

/// What a format knows of one of its files.
pub(crate) trait Layout: fmt::Debug + Send + Sync {
    /// The names of the columns; `None` where they have none, or the rows hold them.
    fn names(&self) -> Option<&[String]>;

    fn numbering(&self) -> Numbering {
        match self.names() {
            Some(_) => Numbering::Named,
            None => Numbering::Unnamed,
        }
    }

    /// The rows, from the first on.
    fn rows(&self) -> Result<Box<dyn Rows>, TableError>;
}

/// A stream of rows.
pub(crate) trait Rows: Send {
    /// Puts the next rows into `batch`; `false` if there are no more. Columns may differ in number
    /// from one batch to the next, but are all of one length.
    fn next(&mut self, batch: &mut Batch) -> Result<bool, TableError>;
}

/// A table in a file.
#[derive(Clone, Debug)]
pub struct Table {
    pub(crate) layout: Arc<dyn Layout>,
    kind: FileKind,
}

impl Table {
    /// Finds the columns of the table in a file of this kind: of the matrix, sheet or topic `part`, or
    /// of the one that holds a log.
    ///
    /// # Errors
    /// [`TableError`] if the file cannot be read, is damaged, or has no such part.
    pub fn open(path: &Path, kind: FileKind, part: Option<&str>) -> Result<Self, TableError> {
        let layout: Arc<dyn Layout> = match kind {
            FileKind::Arrow => arrow::open(path)?,
            FileKind::Matlab => mat5::open(path, part)?,
            FileKind::Mcap => mcap::open(path, part)?,
            FileKind::NumPy => npy::open(path)?,
            FileKind::Parquet => parquet::open(path)?,
            FileKind::Xlsx => xlsx::open(path, part)?,
        };
        Ok(Self { layout, kind })
    }

    /// What kind of file it is.
    pub fn kind(&self) -> FileKind {
        self.kind
    }

    /// The names of its columns; `None` where they have none, or the rows hold them.
    pub fn names(&self) -> Option<&[String]> {
        self.layout.names()
    }

    /// What the lines of its text are in the file.
    pub fn numbering(&self) -> Numbering {
        self.layout.numbering()
    }
}
