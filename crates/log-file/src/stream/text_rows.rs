//! The rows of a text that is joined with a table, as columns of texts.

use std::io::{self, BufRead, BufReader, Read};

use shell_data::escape;
use table_file::{Cell, ColumnPart, TablePart, WantedColumn};

use super::bytes::ByteStream;
use super::chunk::{LINE_LIMIT, LongLine};
use super::companion::separator;
use crate::line::{is_comment, quoted_fields};
use crate::parse::number::with_points;

/// The rows of a text: its lines except blank ones and comments.
pub(crate) struct TextRows {
    lines: BufReader<ByteStream>,
    line: Vec<u8>,
    number: u64,
    /// The separator, once a line contains one.
    separator: Option<u8>,
}

impl TextRows {
    pub(crate) fn new(text: ByteStream) -> Self {
        let lines = BufReader::with_capacity(1 << 16, text);
        Self { lines, line: Vec::new(), number: 0, separator: None }
    }

    pub(crate) fn next(&mut self) -> io::Result<Option<Vec<String>>> {
        loop {
            self.line.clear();
            self.number += 1;
            let mut lines = self.lines.by_ref().take(LINE_LIMIT as u64);
            if lines.read_until(b'\n', &mut self.line)? == 0 {
                return Ok(None);
            }
            if self.line.len() == LINE_LIMIT {
                return Err(io::Error::other(LongLine(self.number)));
            }
            let line = self.line.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&self.line).trim_ascii();
            if line.is_empty() || is_comment(line) {
                continue;
            }
            let separator = *self.separator.get_or_insert(separator(line).unwrap_or(b','));
            let line = if separator == b',' { line.to_vec() } else { with_points(line) };
            let fields = quoted_fields(&line, separator);
            let text = |field: &[u8]| String::from_utf8_lossy(field.trim_ascii()).into_owned();
            return Ok(Some(fields.iter().map(text).collect()));
        }
    }

    /// Appends at most `rows` of the next rows to an empty part.
    pub(crate) fn fill(
        &mut self,
        rows: usize,
        wanted: &[WantedColumn],
        part: &mut TablePart,
    ) -> io::Result<bool> {
        let mut columns = vec![Vec::new(); wanted.len()];
        part.rows = 0;
        while part.rows < rows
            && let Some(fields) = self.next()?
        {
            for (column, wanted) in columns.iter_mut().zip(wanted) {
                let field = fields.get(wanted.at).filter(|field| !field.is_empty());
                column.push(field.cloned().map_or(Cell::Missing, Cell::Text));
            }
            part.rows += 1;
        }
        part.columns = columns.into_iter().map(ColumnPart::Cells).collect();
        Ok(part.rows > 0)
    }

    /// Returns the first lines with commas between the fields.
    pub(crate) fn head(mut self, lines: usize) -> io::Result<Vec<u8>> {
        let mut text = Vec::new();
        for _ in 0..lines {
            let Some(fields) = self.next()? else { break };
            let fields: Vec<_> = fields.iter().map(|field| escape::csv_field(field)).collect();
            text.extend_from_slice(fields.join(",").as_bytes());
            text.push(b'\n');
        }
        Ok(text)
    }
}
