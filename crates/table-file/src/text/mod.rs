//! A table of any kind: its columns, and its rows as the text of a CSV file.

mod parts;

use std::io::{self, Read};
use std::sync::Arc;

use shell_data::escape;

use self::parts::TextOfParts;
use crate::budget::Unpacked;
use crate::format::{Cell, FileSource, RowBatch, RowSource};
use crate::kind::{FileKind, TableError};
use crate::{hdf5, mat5, mcap, npy, parquet, xlsx};

/// Text that is made piece by piece, as a stream.
pub struct TextStream<F> {
    append: F,
    text: Vec<u8>,
    at: usize,
    ended: bool,
}

impl<F: FnMut(&mut Vec<u8>) -> io::Result<bool>> TextStream<F> {
    /// The text that `append` makes, after `text`: it appends the next piece, and returns `false` once there is none
    /// behind it. There is none after an error.
    pub fn new(text: Vec<u8>, append: F) -> Self {
        Self { append, text, at: 0, ended: false }
    }
}

impl<F: FnMut(&mut Vec<u8>) -> io::Result<bool>> Read for TextStream<F> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        while self.at == self.text.len() && !self.ended {
            self.text.clear();
            self.at = 0;
            // Set until the next piece is there: there is none after an error.
            self.ended = true;
            self.ended = !(self.append)(&mut self.text)?;
        }
        let count = buffer.len().min(self.text.len() - self.at);
        buffer[..count].copy_from_slice(&self.text[self.at..][..count]);
        self.at += count;
        Ok(count)
    }
}

/// A table in a file.
#[derive(Clone, Debug)]
pub struct Table {
    /// What kind of file it is.
    pub kind: FileKind,
    /// The names of its columns; `None` where they have none, or the rows hold them.
    pub names: Option<Vec<String>>,
    rows: Arc<dyn RowSource>,
}

impl Table {
    /// Finds the columns of the table in a file of this kind: of the matrix, group, sheet or topic `part`, or
    /// of the one that holds a log.
    ///
    /// # Errors
    /// [`TableError`] if the file cannot be read, is damaged, or has no such part.
    pub fn open(file: &FileSource, kind: FileKind, part: Option<&str>) -> Result<Self, TableError> {
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

    /// Checks that the values of a column, from 0, are read.
    ///
    /// # Errors
    /// [`TableError::Unsupported`] with its name and what it holds.
    pub fn check_is_read(&self, column: usize) -> Result<(), TableError> {
        let Some(what) = self.rows.unread(column) else { return Ok(()) };
        let name = self.names.as_ref().and_then(|names| names.get(column));
        let name = name.map_or("", String::as_str);
        Err(self.kind.unsupported(format!("column `{name}` holds values of type {what}")))
    }

    /// The table as the text of a CSV file: a line of names, if the table has any, and a line for each row.
    /// Numbers have the fewest digits that read back as the same number. Texts lose their line breaks. So many
    /// `threads` read it where the rows are stored in parts: the row groups of Parquet.
    ///
    /// Errors of the table are in the errors of reading, as [`TableError`].
    ///
    /// # Errors
    /// [`TableError`] if the file cannot be opened.
    pub fn text(&self, threads: usize) -> Result<Box<dyn Read + Send>, TableError> {
        let mut text = Vec::new();
        if let Some(names) = &self.names {
            let line = names.iter().map(|name| vec![Cell::Text(name.clone())]);
            write_rows(&line.collect(), &mut text);
        }
        let parts = self.rows.parts();
        if threads > 1 && parts > 1 {
            let mut parts = TextOfParts::new(Arc::clone(&self.rows), threads);
            return Ok(Box::new(TextStream::new(text, move |text| Ok(parts.next(text)?))));
        }
        let mut rows = Arc::clone(&self.rows).rows(0..parts, Unpacked::default())?;
        let mut batch = RowBatch::new();
        Ok(Box::new(TextStream::new(text, move |text| {
            let is_there = rows(&mut batch)?;
            if is_there {
                write_rows(&batch, text);
            }
            Ok(is_there)
        })))
    }
}

/// Adds a line for each row.
fn write_rows(batch: &RowBatch, text: &mut Vec<u8>) {
    let rows = batch.first().map_or(0, Vec::len);
    let mut digits = zmij::Buffer::new();
    for row in 0..rows {
        for (position, column) in batch.iter().enumerate() {
            if position > 0 {
                text.push(b',');
            }
            match column.get(row) {
                None | Some(Cell::Missing) => {}
                Some(&Cell::Whole(value)) => write_whole(value, text),
                Some(&Cell::Real(value)) => match whole(value) {
                    Some(whole) => write_whole(whole, text),
                    None => text.extend_from_slice(digits.format(value).as_bytes()),
                },
                Some(Cell::Text(value)) => write_text(value, text),
            }
        }
        text.push(b'\n');
    }
}

/// The integer that a number is, but for a zero with a sign.
fn whole(value: f64) -> Option<i64> {
    let is_whole = value.trunc() == value && value.abs() < 9e15;
    (is_whole && (value != 0.0 || value.is_sign_positive())).then_some(value as i64)
}

fn write_whole(value: i64, text: &mut Vec<u8>) {
    let mut digits = [0; 20];
    let mut start = digits.len();
    let mut rest = value.unsigned_abs();
    loop {
        start -= 1;
        digits[start] = b'0' + (rest % 10) as u8;
        rest /= 10;
        if rest == 0 {
            break;
        }
    }
    if value < 0 {
        text.push(b'-');
    }
    text.extend_from_slice(&digits[start..]);
}

/// A field on one line, in quotes where it has to be.
fn write_text(value: &str, text: &mut Vec<u8>) {
    // What no text file has would make the whole file one that is none.
    let plain = |c: char| if c.is_control() { ' ' } else { c };
    let value: String = value.chars().map(plain).collect();
    text.extend_from_slice(escape::csv_field(&value).as_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_are_written_with_their_digits() {
        for value in [0, 7, -7, 10, 1234567890123456789, i64::MAX, i64::MIN] {
            let mut text = Vec::new();
            write_whole(value, &mut text);
            assert_eq!(String::from_utf8(text).unwrap(), value.to_string());
        }
        assert_eq!([1.0, -0.0, 0.5, 1e300, f64::NAN].map(whole), [Some(1), None, None, None, None]);
    }

    #[test]
    fn texts_stay_on_their_line() {
        let mut text = Vec::new();
        write_text("a\n\"b\",\0c", &mut text);
        assert_eq!(text, b"\"a \"\"b\"\", c\"");
    }
}
