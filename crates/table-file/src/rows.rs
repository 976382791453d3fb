//! What every kind of table gives: the names of its columns, and a stream of its rows.

use std::fmt;

use crate::error::TableError;

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
pub(crate) type RowBatch = Vec<Vec<Cell>>;

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
pub(crate) trait ColumnLayout: fmt::Debug + Send + Sync {
    /// The names of the columns; `None` where they have none, or the rows hold them.
    fn names(&self) -> Option<&[String]>;

    fn numbering(&self) -> Numbering {
        match self.names() {
            Some(_) => Numbering::Named,
            None => Numbering::Unnamed,
        }
    }

    /// What a column holds, from 0, if that is not read: its cells are missing then.
    fn unread(&self, _column: usize) -> Option<&'static str> {
        None
    }

    /// The rows, from the first on.
    fn rows(&self) -> Result<Box<dyn RowStream>, TableError>;

    /// The parts that the rows are stored in, where they can be read apart from each other.
    fn parts(&self) -> Option<Box<dyn RowParts>> {
        None
    }
}

/// Rows in parts, any of which can be read without those before it.
pub(crate) trait RowParts: Send + Sync {
    /// How many there are.
    fn count(&self) -> usize;

    /// The rows of one.
    fn rows(&self, part: usize) -> Result<Box<dyn RowStream>, TableError>;
}

/// A stream of rows.
pub(crate) trait RowStream: Send {
    /// Puts the next rows into `batch`; `false` if there are no more. Columns may differ in number
    /// from one batch to the next, but are all of one length.
    fn next(&mut self, batch: &mut RowBatch) -> Result<bool, TableError>;
}
