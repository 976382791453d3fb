//! Joins two files row by row into one text: the lines `1,2` and `3` become `1,2,3`.
//!
//! If both files are logs by themselves, their rows are joined, and each may have its own head and notation. Otherwise,
//! both files must have names in their first line, or neither.

use std::io::{self, BufRead, BufReader, Read};
use std::sync::Arc;

use super::text_stream::TextStream;
use crate::line::quoted_fields;
use crate::parse::form::RowForm;
use crate::parse::marks::NumberMarks;

/// The longest line, bytes.
const LONGEST: u64 = 1 << 20;

/// Bytes of text made at a time.
const TEXT_BYTES: usize = 1 << 16;

/// The reason why the rows of two files cannot be joined.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RowMismatch {
    /// The number of a line that only one file has.
    #[error("line {0} is in one of them alone")]
    Lines(u64),
    #[error("`{}` separates the columns of the one, `{}` those of the other", char::from(*.0), char::from(*.1))]
    Separators(u8, u8),
    /// One file begins with names, the other with numbers.
    #[error("one of them begins with names of columns, the other with numbers")]
    Names,
    /// The first file is a log with several header lines.
    #[error("robot telemetry has no file beside it")]
    Telemetry,
    #[error("line {0} is longer than {LONGEST} bytes")]
    Long(u64),
    /// The number of a row, from 1, and its times in s.
    #[error("row {row} is at {first:.6} s in the one and at {second:.6} s in the other")]
    Times { row: usize, first: f64, second: f64 },
}

/// Properties of two files, from their first lines.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Sides {
    separator: u8,
    pub(crate) has_names: bool,
    pub(crate) columns: [usize; 2],
    /// The rows of two texts that are logs by themselves.
    rows: Option<Arc<[SideRows; 2]>>,
}

/// The notation of a text's rows.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SideRows {
    /// The number of the line that names the columns, and of the first row.
    pub(crate) lines: [u64; 2],
    pub(crate) separator: u8,
    pub(crate) form: RowForm,
    pub(crate) marks: NumberMarks,
    pub(crate) columns: usize,
}

impl SideRows {
    /// Rewrites a line with another separator and points as decimal marks.
    fn rewritten(&self, line: &[u8], separator: u8) -> Vec<u8> {
        let mut made = line.to_vec();
        if !self.form.is_plain() {
            made = self.form.separated(&made, self.separator);
        }
        if !self.marks.is_plain() {
            made = self.marks.rewritten(&made, self.separator);
        }
        if self.separator != separator {
            let fields = quoted_fields(&made, self.separator);
            let text = |field: &[u8]| field.trim_ascii().to_vec();
            made = fields.iter().map(text).collect::<Vec<_>>().join(&separator);
        }
        made
    }
}

impl Sides {
    /// Examines the first lines that are not blank.
    pub(crate) fn new<R: Read>(files: [R; 2]) -> io::Result<Self> {
        let mut files = files.map(CompanionLines::new);
        for file in &mut files {
            let mut number = 1;
            while file.next(number)? && file.line.is_empty() {
                number += 1;
            }
        }
        let [first, second] = files.each_ref().map(|file| file.line.as_slice());
        Self::of_lines([first, second]).map_err(io::Error::other)
    }

    fn of_lines([first, second]: [&[u8]; 2]) -> Result<Self, RowMismatch> {
        if first.starts_with(b"%") {
            return Err(RowMismatch::Telemetry);
        }
        let separator = match [first, second].map(separator) {
            [Some(first), Some(second)] if first != second => {
                return Err(RowMismatch::Separators(first, second));
            }
            [first, second] => first.or(second).unwrap_or(b','),
        };
        let fields =
            [first, second].map(|line| line.split(|&byte| byte == separator).collect::<Vec<_>>());
        let [has_names, other] = fields.each_ref().map(|fields| {
            2 * fields.iter().filter(|field| is_number(field, separator)).count() < fields.len()
        });
        match has_names == other {
            true => {
                let columns = fields.map(|fields| fields.len());
                Ok(Self { separator, has_names, columns, rows: None })
            }
            false => Err(RowMismatch::Names),
        }
    }

    /// Describes two logs that are joined below their heads.
    pub(crate) fn of_logs(rows: [SideRows; 2]) -> Self {
        let separator = match rows[0].separator == rows[1].separator {
            true => rows[0].separator,
            false => b'\t',
        };
        let columns = rows.each_ref().map(|rows| rows.columns);
        Self { separator, has_names: true, columns, rows: Some(Arc::new(rows)) }
    }

    pub(crate) fn separator(&self) -> u8 {
        self.separator
    }

    /// Returns the names of the second file. Names that the first file has, too, begin with `2nd`.
    fn names(&self, [first, second]: [&[u8]; 2]) -> Vec<u8> {
        let separator = char::from(self.separator);
        let [first, second] = [first, second].map(String::from_utf8_lossy);
        let is_taken = |name: &str| {
            first.split(separator).any(|taken| taken.trim().eq_ignore_ascii_case(name))
        };
        let own = |name: &str| match is_taken(name) {
            true => format!("2nd {name}"),
            false => name.to_owned(),
        };
        let names: Vec<String> = second.split(separator).map(|name| own(name.trim())).collect();
        names.join(&separator.to_string()).into_bytes()
    }
}

pub(crate) fn separator(line: &[u8]) -> Option<u8> {
    // Commas come last, because they may be decimal.
    b";\t,".iter().copied().find(|separator| line.contains(separator))
}

fn is_number(field: &[u8], separator: u8) -> bool {
    let text = String::from_utf8_lossy(field);
    let text = text.trim().trim_matches('"');
    let text = if separator == b',' { text.to_owned() } else { text.replace(',', ".") };
    text.parse::<f64>().is_ok()
}

pub(crate) fn joined<R: Read>(files: [R; 2], sides: Sides) -> impl Read {
    let [mut first, mut second] = files.map(CompanionLines::new);
    let (mut are_names, mut line) = (sides.has_names, 0);
    let mut head = sides.rows.clone();
    TextStream::new(Vec::new(), move |text| {
        if let Some(rows) = head.take() {
            // The rows of the first file keep their line numbers.
            for (file, rows) in [&mut first, &mut second].into_iter().zip(rows.iter()) {
                for number in 1..rows.lines[1] {
                    file.next(number)?;
                }
            }
            line = rows[0].lines[1] - 1;
            text.extend((0..line).map(|_| b'\n'));
            are_names = false;
        }
        while text.len() < TEXT_BYTES {
            line += 1;
            let there = [first.next(line)?, second.next(line)?];
            let mut lines = [first.line.as_slice(), second.line.as_slice()];
            let mut made = [Vec::new(), Vec::new()];
            if let Some(rows) = &sides.rows {
                for ((made, line), rows) in made.iter_mut().zip(&mut lines).zip(rows.iter()) {
                    *made = rows.rewritten(line, sides.separator);
                    *line = made.trim_ascii_end();
                }
            }
            match (there, lines) {
                ([false, false], _) => return Ok(false),
                // Blank lines at the end have no counterpart.
                (_, [[], []]) => text.push(b'\n'),
                ([true, true], [[_, ..], [_, ..]]) => {
                    text.extend_from_slice(lines[0]);
                    text.push(sides.separator);
                    match std::mem::take(&mut are_names) {
                        true => text.extend(sides.names(lines)),
                        false => text.extend_from_slice(lines[1]),
                    }
                    text.push(b'\n');
                }
                _ => return Err(io::Error::other(RowMismatch::Lines(line))),
            }
        }
        Ok(true)
    })
}

#[derive(Debug)]
struct CompanionLines<R> {
    stream: BufReader<R>,
    line: Vec<u8>,
}

impl<R: Read> CompanionLines<R> {
    fn new(stream: R) -> Self {
        Self { stream: BufReader::with_capacity(TEXT_BYTES, stream), line: Vec::new() }
    }

    /// Reads the next line without its line end; `false` if there is none.
    fn next(&mut self, number: u64) -> io::Result<bool> {
        self.line.clear();
        let read = (&mut self.stream).take(LONGEST).read_until(b'\n', &mut self.line)?;
        if read as u64 == LONGEST && self.line.last() != Some(&b'\n') {
            return Err(io::Error::other(RowMismatch::Long(number)));
        }
        let end = self.line.trim_ascii_end().len();
        self.line.truncate(end);
        let mark = self.line.strip_prefix(b"\xef\xbb\xbf").map_or(0, |_| 3);
        self.line.drain(..mark);
        Ok(read > 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn joined(first: &str, second: &str) -> Result<String, String> {
        let mut text = String::new();
        let files = [first.as_bytes(), second.as_bytes()];
        let read = Sides::new(files)
            .and_then(|sides| super::joined(files, sides).read_to_string(&mut text));
        read.map(|_| text).map_err(|error| error.to_string())
    }

    #[test]
    fn lines_stand_beside_each_other() {
        assert_eq!(joined("1,2\n3,4\n", "5\r\n6"), Ok("1,2,5\n3,4,6\n".to_owned()));
        assert_eq!(
            joined("t,a\n1,2\n", "\u{feff}T,fx\n3,4\n\n"),
            Ok("t,a,2nd T,fx\n1,2,3,4\n\n".to_owned())
        );
        assert_eq!(joined("1,5;2\n", "3,5;4\n"), Ok("1,5;2;3,5;4\n".to_owned()));
        let many = |value: &str| format!("{value}\n").repeat(50_000);
        assert_eq!(joined(&many("1,2"), &many("3")), Ok(many("1,2,3")));
    }

    #[test]
    fn files_that_are_not_row_by_row_are_told() {
        for (first, second, expected) in [
            ("1,2\n3,4\n", "5\n", RowMismatch::Lines(2)),
            ("1,2\n", "5\n6\n", RowMismatch::Lines(2)),
            ("1,2\n\n", "5\n6\n", RowMismatch::Lines(2)),
            ("1,2\n", "5;6\n", RowMismatch::Separators(b',', b';')),
            ("a,b\n1,2\n", "5\n6\n", RowMismatch::Names),
            ("% a|b\n1,2\n", "a\n6\n", RowMismatch::Telemetry),
        ] {
            assert_eq!(joined(first, second), Err(expected.to_string()), "{first:?} {second:?}");
        }
        assert_eq!(joined(&"1".repeat(2 << 20), "1\n"), Err(RowMismatch::Long(1).to_string()));
    }
}
