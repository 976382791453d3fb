//! What a format reads, the bytes of a file, and what it gives: the names of columns, and a stream of rows.

use std::borrow::Cow;
use std::fmt;
use std::fs::File;
use std::io::{self, Cursor, Read, Seek};
use std::path::PathBuf;
use std::sync::Arc;

use crate::calendar::{iso_of, seconds_of};
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
    /// Text.
    Text(String),
    /// A time since 1970, in units of which so many make a second.
    Time { units: i64, per_second: i64 },
}

impl Cell {
    /// Its number, or time in seconds since 1970; `None` for what is missing or text.
    pub fn number(&self) -> Option<f64> {
        match *self {
            Self::Real(value) => Some(value),
            Self::Whole(value) => Some(value as f64),
            Self::Time { units, per_second } => Some(seconds_of(units, per_second)),
            Self::Missing | Self::Text(_) => None,
        }
    }

    /// Its text on one line: numbers with the fewest digits that read back as the same number, times in ISO 8601.
    pub fn text(&self) -> Cow<'_, str> {
        match self {
            Self::Missing => Cow::Borrowed(""),
            Self::Whole(value) => Cow::Owned(value.to_string()),
            Self::Real(value) => Cow::Owned(match whole(*value) {
                Some(whole) => whole.to_string(),
                None => zmij::Buffer::new().format(*value).to_owned(),
            }),
            Self::Time { units, per_second } => Cow::Owned(iso_of(*units, *per_second)),
            // What no text file has would make the whole file one that is none.
            Self::Text(text) if text.contains(char::is_control) => {
                Cow::Owned(text.replace(char::is_control, " "))
            }
            Self::Text(text) => Cow::Borrowed(text),
        }
    }
}

/// The integer that a number is, but for a zero with a sign.
fn whole(value: f64) -> Option<i64> {
    let is_whole = value.trunc() == value && value.abs() < 9e15;
    (is_whole && (value != 0.0 || value.is_sign_positive())).then_some(value as i64)
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

/// A column that is wanted: its position from 0, and whether its values are wanted as they are written, not as
/// numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WantedColumn {
    /// Its position, from 0.
    pub at: usize,
    /// Give texts, not numbers.
    pub is_text: bool,
}

/// Some rows of a column.
#[derive(Clone, Debug, PartialEq)]
pub enum ColumnPart {
    /// Numbers, or times in seconds since 1970; NaN in the rows that are missing, which are listed in order.
    Numbers { values: Vec<f64>, missing: Vec<usize> },
    /// Values of any kind.
    Cells(Vec<Cell>),
}

impl Default for ColumnPart {
    fn default() -> Self {
        Self::Numbers { values: Vec::new(), missing: Vec::new() }
    }
}

impl ColumnPart {
    /// Forgets all rows, and makes it one for what is wanted.
    fn clear(&mut self, is_text: bool) {
        match self {
            Self::Numbers { values, missing } if !is_text => {
                values.clear();
                missing.clear();
            }
            Self::Cells(cells) if is_text => cells.clear(),
            part => *part = if is_text { Self::Cells(Vec::new()) } else { Self::default() },
        }
    }

    /// Adds a value to those of a column whose values are all numbers or times, or to cells.
    pub(crate) fn push(&mut self, cell: Cell) {
        match self {
            Self::Cells(cells) => cells.push(cell),
            Self::Numbers { values, missing } => match cell.number() {
                Some(number) => values.push(number),
                None => {
                    missing.push(values.len());
                    values.push(f64::NAN);
                }
            },
        }
    }

    /// Adds every so many values of another one, from the one at `first` on.
    pub(crate) fn extend_by_step(&mut self, from: &Self, first: usize, step: usize) {
        match from {
            Self::Cells(cells) => {
                self.cells().extend(cells.iter().skip(first).step_by(step.max(1)).cloned());
            }
            Self::Numbers { values, missing } => {
                for (at, &value) in values.iter().enumerate().skip(first).step_by(step.max(1)) {
                    let is_missing = missing.binary_search(&at).is_ok();
                    self.push(if is_missing { Cell::Missing } else { Cell::Real(value) });
                }
            }
        }
    }

    /// Its values as cells.
    pub(crate) fn cells(&mut self) -> &mut Vec<Cell> {
        if let Self::Numbers { values, missing } = self {
            let cell = |(at, value): (usize, &f64)| match missing.binary_search(&at) {
                Ok(_) => Cell::Missing,
                Err(_) => Cell::Real(*value),
            };
            *self = Self::Cells(values.iter().enumerate().map(cell).collect());
        }
        match self {
            Self::Cells(cells) => cells,
            Self::Numbers { .. } => unreachable!("it is one of cells"),
        }
    }
}

/// Some rows of the columns that are wanted.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TablePart {
    /// How many rows there are.
    pub rows: usize,
    /// The columns, in the order in which they are wanted.
    pub columns: Vec<ColumnPart>,
    /// Rows, in order, that hold nothing or a remark.
    pub blank: Vec<usize>,
}

impl TablePart {
    /// Forgets all rows, and makes room for what is wanted.
    pub(crate) fn clear(&mut self, wanted: &[WantedColumn]) {
        self.rows = 0;
        self.blank.clear();
        self.columns.resize_with(wanted.len(), ColumnPart::default);
        self.columns.iter_mut().zip(wanted).for_each(|(part, wanted)| part.clear(wanted.is_text));
    }
}

/// A column of a table.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TableColumn {
    /// Its name.
    pub name: String,
    /// The unit of its values, as the file writes it.
    pub unit: Option<String>,
}

impl From<String> for TableColumn {
    fn from(name: String) -> Self {
        Self { name, unit: None }
    }
}

/// What a format finds in a file.
pub(crate) struct FoundTable {
    /// The columns, `None` where they have no names or the rows hold them.
    pub(crate) columns: Option<Vec<TableColumn>>,
    pub(crate) rows: Arc<dyn RowSource>,
    /// What is left out of the table, and what was decided.
    pub(crate) notes: Vec<String>,
}

impl FoundTable {
    /// A table of all that there is.
    pub(crate) fn new(columns: Option<Vec<TableColumn>>, rows: impl RowSource + 'static) -> Self {
        Self { columns, rows: Arc::new(rows), notes: Vec::new() }
    }
}

/// What a format knows of one of its files.
pub(crate) trait RowSource: fmt::Debug + Send + Sync {
    /// What a column holds, from 0, if that is not read.
    fn unread(&self, _column: usize) -> Option<&'static str> {
        None
    }

    /// The number of columns; 0 where rows differ in it.
    fn columns(&self) -> usize;

    /// The rows of the columns that are wanted.
    fn rows(self: Arc<Self>, wanted: Vec<WantedColumn>) -> Result<RowStream, TableError>;
}

/// A stream of rows: adds at most so many of the next ones to a part that has none; fewer only at the end.
pub(crate) type RowStream = Box<dyn FnMut(usize, &mut TablePart) -> Result<(), TableError> + Send>;

/// A stream of rows of cells, for formats whose rows are read whole: the next row, `None` if there are no more.
pub(crate) type CellRows = Box<dyn FnMut() -> Result<Option<Vec<Cell>>, TableError> + Send>;

/// The wanted columns of rows of cells; rows for which `is_blank` is true are marked as such.
pub(crate) fn columns_of_cells(
    mut next: CellRows,
    wanted: Vec<WantedColumn>,
    is_blank: fn(&[Cell]) -> bool,
) -> RowStream {
    Box::new(move |rows, part| {
        while part.rows < rows
            && let Some(mut row) = next()?
        {
            if is_blank(&row) {
                part.blank.push(part.rows);
            }
            for (column, wanted) in part.columns.iter_mut().zip(&wanted) {
                // A column may be wanted both as numbers and as texts.
                let cell = row.get_mut(wanted.at);
                column.cells().push(cell.cloned().unwrap_or_default());
            }
            part.rows += 1;
        }
        Ok(())
    })
}
