//! A table as the text of a CSV file.

mod parts;

use std::fmt;
use std::io::{self, Read};

use shell_data::escape;

use self::parts::TextOfParts;
use crate::error::TableError;
use crate::rows::{Cell, RowBatch, RowParts, RowStream};
use crate::table::Table;

/// Reads as the text of a CSV file: a line of names, if the table has any, and a line for each row.
/// Numbers have the fewest digits that read back as the same number. Texts lose their line breaks.
///
/// Errors of the table are in the errors of reading, as [`TableError`].
pub struct TableText {
    source: TextInput,
    text: Vec<u8>,
    at: usize,
    ended: bool,
}

/// Where the text comes from.
enum TextInput {
    /// Rows, one batch after the other.
    Rows(Box<dyn RowStream>, RowBatch),
    /// Parts that other threads read.
    Parts(TextOfParts),
}

impl Table {
    /// The table as text.
    ///
    /// # Errors
    /// [`TableError`] if the file cannot be opened.
    pub fn text(&self) -> Result<TableText, TableError> {
        self.text_by(1)
    }

    /// The same, read by so many threads where the rows are stored in parts: the row groups of Parquet.
    ///
    /// # Errors
    /// As [`Table::text`].
    pub fn text_by(&self, threads: usize) -> Result<TableText, TableError> {
        let mut text = Vec::new();
        if let Some(names) = self.names() {
            for (position, name) in names.iter().enumerate() {
                if position > 0 {
                    text.push(b',');
                }
                write_text(name, &mut text);
            }
            text.push(b'\n');
        }
        let parts = self.layout.parts().filter(|parts| threads > 1 && parts.count() > 1);
        match parts {
            Some(parts) => Ok(TableText::from_parts(text, parts, threads)),
            None => {
                let source = TextInput::Rows(self.layout.rows()?, RowBatch::new());
                Ok(TableText { source, text, at: 0, ended: false })
            }
        }
    }
}

impl TableText {
    /// The line of names, then all parts.
    fn from_parts(names: Vec<u8>, parts: Box<dyn RowParts>, threads: usize) -> Self {
        let source = TextInput::Parts(TextOfParts::new(parts, threads));
        Self { source, text: names, at: 0, ended: false }
    }

    /// Makes text of the next rows.
    fn refill(&mut self) -> Result<(), TableError> {
        self.text.clear();
        self.at = 0;
        // Set until the next rows are there: there are none after an error.
        self.ended = true;
        let is_there = match &mut self.source {
            TextInput::Rows(rows, batch) => {
                let is_there = rows.next(batch)?;
                if is_there {
                    write_rows(batch, &mut self.text);
                }
                is_there
            }
            TextInput::Parts(parts) => parts.next(&mut self.text)?,
        };
        self.ended = !is_there;
        Ok(())
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

impl Read for TableText {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        while self.at == self.text.len() && !self.ended {
            self.refill().map_err(|error| match error {
                TableError::Io(error) => error,
                error => io::Error::new(io::ErrorKind::InvalidData, error),
            })?;
        }
        let count = buffer.len().min(self.text.len() - self.at);
        buffer[..count].copy_from_slice(&self.text[self.at..][..count]);
        self.at += count;
        Ok(count)
    }
}

impl fmt::Debug for TableText {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("TableText").field("at", &self.at).finish_non_exhaustive()
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
