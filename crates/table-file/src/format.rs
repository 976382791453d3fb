//! The interface of a format: from the bytes of a file to the names of columns and a stream of rows.

use std::borrow::Cow;
use std::fmt;
use std::fs::File;
use std::io::{self, Cursor, Read, Seek};
use std::path::PathBuf;
use std::sync::Arc;

use crate::calendar::{iso_of, seconds_of};
use crate::kind::TableError;

/// A file that can be opened any number of times.
#[derive(Clone, Debug)]
pub enum FileSource {
    Disk(PathBuf),
    /// A file in memory, as a browser passes it.
    Memory(Arc<[u8]>),
}

impl FileSource {
    /// Opens the file at its start.
    ///
    /// # Errors
    /// [`io::Error`] if a file on disk cannot be opened.
    pub fn open(&self) -> io::Result<OpenFile> {
        Ok(match self {
            Self::Disk(path) => Box::new(File::open(path)?),
            Self::Memory(bytes) => Box::new(Cursor::new(Arc::clone(bytes))),
        })
    }

    /// Returns the length in bytes.
    ///
    /// # Errors
    /// [`io::Error`] of the system.
    pub fn length(&self) -> io::Result<u64> {
        match self {
            Self::Disk(path) => Ok(path.metadata()?.len()),
            Self::Memory(bytes) => Ok(bytes.len() as u64),
        }
    }
}

pub type OpenFile = Box<dyn FileBytes>;

pub trait FileBytes: Read + Seek + Send {}

impl<T: Read + Seek + Send> FileBytes for T {}

#[derive(Clone, Debug, Default, PartialEq)]
pub enum Cell {
    /// No value.
    #[default]
    Missing,
    /// A floating-point number.
    Real(f64),
    /// An integer.
    Whole(i64),
    /// Text.
    Text(String),
    /// An elapsed time in s.
    Elapsed(f64),
    /// A time since 1970, in units of 1/`per_second` s.
    Time { units: i64, per_second: i64 },
}

impl Cell {
    /// Returns the number, or the time in seconds since 1970; `None` for text and missing values.
    pub fn number(&self) -> Option<f64> {
        match *self {
            Self::Real(value) | Self::Elapsed(value) => Some(value),
            Self::Whole(value) => Some(value as f64),
            Self::Time { units, per_second } => Some(seconds_of(units, per_second)),
            Self::Missing | Self::Text(_) => None,
        }
    }

    /// Formats the value on one line: numbers with the fewest digits that read back equal, times in ISO 8601.
    pub fn text(&self) -> Cow<'_, str> {
        match self {
            Self::Missing => Cow::Borrowed(""),
            Self::Whole(value) => Cow::Owned(value.to_string()),
            Self::Real(value) | Self::Elapsed(value) => Cow::Owned(match whole(*value) {
                Some(whole) => whole.to_string(),
                None => zmij::Buffer::new().format(*value).to_owned(),
            }),
            Self::Time { units, per_second } => Cow::Owned(iso_of(*units, *per_second)),
            // A control character would make the whole text file look like a binary one.
            Self::Text(text) if text.contains(char::is_control) => {
                Cow::Owned(text.replace(char::is_control, " "))
            }
            Self::Text(text) => Cow::Borrowed(text),
        }
    }
}

/// Returns the number as an integer if it is one; −0 is excluded to keep its sign.
fn whole(value: f64) -> Option<i64> {
    let is_whole = value.trunc() == value && value.abs() < 9e15;
    (is_whole && (value != 0.0 || value.is_sign_positive())).then_some(value as i64)
}

#[derive(Clone, Debug, PartialEq)]
pub enum Cells<'a> {
    Text(Cow<'a, [String]>),
    /// Numbers, possibly with missing values.
    Number(Cow<'a, [Option<f64>]>),
    /// Numbers, none missing.
    Full(Cow<'a, [f64]>),
    /// Counts, possibly with missing values.
    Count(Cow<'a, [Option<u64>]>),
}

impl Cells<'_> {
    pub fn rows(&self) -> usize {
        match self {
            Self::Text(values) => values.len(),
            Self::Number(values) => values.len(),
            Self::Full(values) => values.len(),
            Self::Count(values) => values.len(),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WantedColumn {
    /// Position of the column, from 0.
    pub at: usize,
    /// True for text, false for numbers.
    pub is_text: bool,
}

#[derive(Clone, Debug, PartialEq)]
pub enum ColumnPart {
    /// Numbers, or times in seconds since 1970. Missing rows are NaN and listed in order.
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
    /// Removes all rows, and selects the variant for the requested form.
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

    /// Appends a value; a column of [`Self::Numbers`] accepts only numbers and times.
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

    /// Appends every `step`-th value of another part, beginning with the one at `first`.
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

#[derive(Clone, Debug, Default, PartialEq)]
pub struct TablePart {
    pub rows: usize,
    /// Columns in the order of the request.
    pub columns: Vec<ColumnPart>,
    /// Rows, in ascending order, that are empty or hold a comment.
    pub blank: Vec<usize>,
}

impl TablePart {
    pub(crate) fn clear(&mut self, wanted: &[WantedColumn]) {
        self.rows = 0;
        self.blank.clear();
        self.columns.resize_with(wanted.len(), ColumnPart::default);
        self.columns.iter_mut().zip(wanted).for_each(|(part, wanted)| part.clear(wanted.is_text));
    }
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TableColumn {
    pub name: String,
    /// Unit as written in the file.
    pub unit: Option<String>,
}

impl From<String> for TableColumn {
    fn from(name: String) -> Self {
        Self { name, unit: None }
    }
}

pub(crate) struct FoundTable {
    pub(crate) columns: Option<Vec<TableColumn>>,
    pub(crate) rows: Arc<dyn RowSource>,
    pub(crate) notes: Vec<String>,
    pub(crate) is_cut_off: bool,
    /// Keys and values that describe the whole table.
    pub(crate) attributes: Vec<(String, String)>,
}

impl FoundTable {
    pub(crate) fn new(columns: Option<Vec<TableColumn>>, rows: impl RowSource + 'static) -> Self {
        let (notes, attributes) = (Vec::new(), Vec::new());
        Self { columns, rows: Arc::new(rows), notes, is_cut_off: false, attributes }
    }
}

pub(crate) trait RowSource: fmt::Debug + Send + Sync {
    /// Returns the reason why a column, from 0, cannot be read: `holds values of type decimal`.
    fn unread(&self, _column: usize) -> Option<String> {
        None
    }

    /// Returns true if the format declares a column, from 0, as times. Their values are in s.
    fn is_time(&self, _column: usize) -> bool {
        false
    }

    /// Returns true if the format declares a column, from 0, as floating-point numbers.
    fn is_real(&self, _column: usize) -> bool {
        false
    }

    /// Returns the reason why an array of this name, with or without its groups, is not among the columns.
    fn reason_of_absence(&self, _name: &str) -> Option<&str> {
        None
    }

    /// Returns the number of columns; 0 if it differs between rows.
    fn columns(&self) -> usize;

    fn rows(self: Arc<Self>, wanted: Vec<WantedColumn>) -> Result<RowStream, TableError>;

    /// Like [`Self::rows`], and may unpack columns on this many threads.
    fn rows_on(
        self: Arc<Self>,
        wanted: Vec<WantedColumn>,
        _threads: usize,
    ) -> Result<RowStream, TableError> {
        self.rows(wanted)
    }
}

/// A stream of rows. Each call appends the given number of rows to an empty part, or fewer at the end.
pub(crate) type RowStream = Box<dyn FnMut(usize, &mut TablePart) -> Result<(), TableError> + Send>;

/// A stream of rows of cells. Each call returns the next whole row; `None` at the end.
pub(crate) type CellRows = Box<dyn FnMut() -> Result<Option<Vec<Cell>>, TableError> + Send>;

/// Selects the requested columns from rows of cells and marks the rows for which `is_blank` is true.
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
                // Cloned, because a column may be requested both as numbers and as text.
                let cell = row.get_mut(wanted.at);
                column.cells().push(cell.cloned().unwrap_or_default());
            }
            part.rows += 1;
        }
        Ok(())
    })
}
