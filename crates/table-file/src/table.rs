//! A table in any format: its columns, and its rows part by part.

use std::sync::Arc;

use shell_data::escape;

use crate::format::{
    ColumnPart, FileSource, FoundTable, RowSource, RowStream, TableColumn, TablePart, WantedColumn,
};
use crate::kind::{FileKind, TableError};
use crate::sheet::is_error;
use crate::{hdf5, mat5, npy, ods, parquet, recording, tdms, xdf, xlsx};

#[derive(Clone, Debug)]
pub struct Table {
    pub kind: FileKind,
    /// The columns; `None` if they have no names, or the names are in the rows.
    pub columns: Option<Vec<TableColumn>>,
    /// Notes on contents that are left out, with the reason, and on decisions.
    pub notes: Vec<String>,
    /// True if the file ends in the middle of its content, as after the recorder was killed.
    pub is_cut_off: bool,
    /// Keys and values that describe the whole table: `sample_rate`, `units`, or for one column `units.fx`.
    pub attributes: Vec<(String, String)>,
    rows: Arc<dyn RowSource>,
}

impl Table {
    /// Opens a file and finds its table: the matrix, group, sheet or topic `part`, or else the table that holds a log.
    ///
    /// # Errors
    /// [`TableError`] if the file cannot be read, is damaged, or has no such part.
    pub fn open(file: &FileSource, kind: FileKind, part: Option<&str>) -> Result<Self, TableError> {
        let FoundTable { columns, rows, mut notes, is_cut_off, attributes } = match kind {
            FileKind::Hdf5 => hdf5::open(file, part)?,
            FileKind::Matlab => mat5::open(file, part)?,
            FileKind::Mcap | FileKind::Rosbag | FileKind::Sqlite => {
                recording::open(kind, file, part)?
            }
            FileKind::NumPy => npy::open(file)?,
            FileKind::Ods => ods::open(file, part)?,
            FileKind::Parquet => parquet::open(file)?,
            FileKind::Tdms => tdms::open(file, part)?,
            FileKind::Xdf => xdf::open(file, part)?,
            FileKind::Xlsx => xlsx::open(file, part)?,
        };
        if is_cut_off {
            notes.push("the file is cut off: its last piece is left out".to_owned());
        }
        Ok(Self { kind, columns, notes, is_cut_off, attributes, rows })
    }

    /// Returns `None` if the columns have no names, or the names are in the rows.
    pub fn names(&self) -> Option<Vec<String>> {
        let columns = self.columns.as_ref()?.iter();
        Some(columns.map(|column| column.name.clone()).collect())
    }

    /// Returns the unit of each column, empty if it has none. The list is empty if columns have no names.
    pub fn units(&self) -> Vec<String> {
        let columns = self.columns.iter().flatten();
        columns.map(|column| column.unit.clone().unwrap_or_default()).collect()
    }

    /// Returns the number of columns; 0 if it differs between rows.
    pub fn width(&self) -> usize {
        self.rows.columns()
    }

    /// Returns true if the format declares a column, from 0, as times.
    pub fn is_time(&self, column: usize) -> bool {
        self.rows.is_time(column)
    }

    /// Returns true if the format declares a column, from 0, as floating-point numbers.
    pub fn is_real(&self, column: usize) -> bool {
        self.rows.is_real(column)
    }

    /// Returns the reason why an array of this name, with or without its groups, is not among the columns.
    pub fn reason_of_absence(&self, name: &str) -> Option<&str> {
        self.rows.reason_of_absence(name)
    }

    /// Checks that the values of a column, from 0, can be read.
    ///
    /// # Errors
    /// [`TableError::Unsupported`] with the column's name and content.
    pub fn check_is_read(&self, column: usize) -> Result<(), TableError> {
        let Some(why) = self.rows.unread(column) else { return Ok(()) };
        let name = self.columns.as_ref().and_then(|columns| columns.get(column));
        let name = name.map_or("", |column| &column.name);
        Err(self.kind.unsupported(format!("column `{name}` {why}")))
    }

    /// Returns the number of rows in a part of about `bytes` bytes with all columns.
    pub fn rows_of_part(&self, bytes: usize) -> usize {
        (bytes / (3 * self.rows.columns().max(1))).max(1)
    }

    /// Streams the rows of columns that [can be read](Self::check_is_read); may unpack them on `threads` threads.
    ///
    /// # Errors
    /// [`TableError`] if the file cannot be opened.
    pub fn rows(
        &self,
        wanted: Vec<WantedColumn>,
        threads: usize,
    ) -> Result<TableStream, TableError> {
        Ok(TableStream { rows: Arc::clone(&self.rows).rows_on(wanted.clone(), threads)?, wanted })
    }

    /// Formats at most `rows` first rows and about `bytes` bytes as CSV, after a line of names if there are any. If
    /// `shown` is given, the other columns are left empty.
    ///
    /// # Errors
    /// [`TableError`] if the file cannot be read.
    pub fn head(
        &self,
        shown: Option<&[usize]>,
        rows: usize,
        bytes: usize,
    ) -> Result<Vec<u8>, TableError> {
        let columns = match &self.columns {
            Some(columns) => columns.len(),
            // A sheet may have any number of columns.
            None if self.rows.columns() == 0 => crate::budget::COLUMNS,
            None => self.rows.columns(),
        };
        let is_read = |at: &usize| {
            shown.is_none_or(|shown| shown.contains(at)) && self.rows.unread(*at).is_none()
        };
        let wanted: Vec<_> =
            (0..columns).filter(is_read).map(|at| WantedColumn { at, is_text: true }).collect();
        let head = |wanted: &[WantedColumn]| self.head_of(wanted.to_vec(), rows, bytes);
        match head(&wanted) {
            // One column is not supported, but may not be wanted.
            Err(TableError::Unsupported { .. }) => {
                let is_read = |column: &WantedColumn| {
                    !matches!(head(&[*column]), Err(TableError::Unsupported { .. }))
                };
                head(&wanted.into_iter().filter(is_read).collect::<Vec<_>>())
            }
            head => head,
        }
    }

    /// Formats the first rows of some columns.
    fn head_of(
        &self,
        wanted: Vec<WantedColumn>,
        rows: usize,
        bytes: usize,
    ) -> Result<Vec<u8>, TableError> {
        let places: Vec<usize> = wanted.iter().map(|wanted| wanted.at).collect();
        let mut text = Vec::new();
        if let Some(columns) = &self.columns {
            let names = columns
                .iter()
                .map(|column| escape::csv_field(&column.name).replace(char::is_control, " "));
            text.extend_from_slice(names.collect::<Vec<_>>().join(",").as_bytes());
            text.push(b'\n');
        }
        let mut stream = self.rows(wanted, 1)?;
        let mut part = TablePart::default();
        let (mut left, part_rows) = (rows, rows.min(64));
        while left > 0 && text.len() < bytes && stream.next(part_rows.min(left), &mut part)? {
            left -= part.rows;
            for row in 0..part.rows {
                write_row(&part, row, &places, self.columns.as_ref().map(Vec::len), &mut text);
            }
        }
        Ok(text)
    }
}

/// Writes a row with its columns at the given places. A line of a sheet ends with its last filled cell.
fn write_row(
    part: &TablePart,
    row: usize,
    places: &[usize],
    columns: Option<usize>,
    text: &mut Vec<u8>,
) {
    let start = text.len();
    let mut end = start;
    let mut at = 0;
    for (column, &place) in part.columns.iter().zip(places) {
        text.resize(text.len() + place - at, b',');
        at = place;
        if let ColumnPart::Cells(cells) = column
            && let Some(cell) = cells.get(row)
        {
            let field = cell.text();
            // In a text, such a line would be a comment.
            let is_mark = text.len() == start && field.starts_with(['#', '%', '/']);
            match is_mark && (columns.is_some() || is_error(&field)) {
                true => text.extend(format!("\"{}\"", field.replace('"', "\"\"")).bytes()),
                false => text.extend_from_slice(escape::csv_field(&field).as_bytes()),
            }
            if *cell != crate::format::Cell::Missing {
                end = text.len();
            }
        }
    }
    match columns {
        Some(columns) => text.resize(text.len() + columns.saturating_sub(at + 1), b','),
        None => text.truncate(end),
    }
    text.push(b'\n');
}

pub struct TableStream {
    wanted: Vec<WantedColumn>,
    rows: RowStream,
}

impl TableStream {
    /// Reads at most `rows` next rows, fewer only at the end; returns `false` if there are none.
    ///
    /// # Errors
    /// [`TableError`] if the file cannot be read or is damaged.
    pub fn next(&mut self, rows: usize, part: &mut TablePart) -> Result<bool, TableError> {
        part.clear(&self.wanted);
        (self.rows)(rows, part)?;
        Ok(part.rows > 0)
    }
}
