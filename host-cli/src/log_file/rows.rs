//! Parses rows of separated values into columns, only those that are wanted.
//!
//! The short way here walks once over the bytes and expects plain numbers between single-byte
//! separators. Lines with quotes go to the csv crate, with the same results; a quoted field cannot
//! contain a line break.

use memchr::{memchr, memchr_iter, memchr2};

use super::error::{Field, RowProblem};
use super::number::{NumberError, ParsePlain, Portable, parse_field};
#[cfg(target_arch = "x86_64")]
use super::rows_avx2::PlainRows;

/// What is wanted from each row.
#[derive(Debug)]
pub(super) struct RowPlan {
    pub(super) separator: u8,
    /// What to do with each column.
    pub(super) steps: Vec<Step>,
    /// Names of all columns.
    pub(super) names: Vec<String>,
}

/// What to do with a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Step {
    Skip,
    /// Parse it into the next column of the result.
    Number,
    /// Keep it as the label of the row's group.
    Group,
}

/// Rows, column by column.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Parsed {
    pub(super) rows: usize,
    pub(super) skipped: u64,
    pub(super) columns: Vec<Vec<f64>>,
    pub(super) groups: Vec<(String, usize)>,
}

/// A row that is wrong.
#[derive(Debug, PartialEq)]
pub(super) struct RowError {
    /// Where the row starts in the lines that were parsed.
    pub(super) offset: usize,
    pub(super) problem: RowProblem,
}

impl Parsed {
    /// No rows yet, with room for `capacity` rows of `columns` columns.
    pub(super) fn with_capacity(columns: usize, capacity: usize) -> Self {
        let columns = (0..columns).map(|_| Vec::with_capacity(capacity)).collect();
        Self { columns, ..Self::default() }
    }

    pub(super) fn push_group(&mut self, label: &[u8]) {
        match self.groups.last_mut() {
            Some((last, rows)) if last.as_bytes() == label => *rows += 1,
            _ => self.groups.push((String::from_utf8_lossy(label).into_owned(), 1)),
        }
    }

    /// Takes back what a bad row has left behind; `groups` is the state before it.
    fn take_back_row(&mut self, labelled: bool) {
        for column in &mut self.columns {
            column.truncate(self.rows);
        }
        if labelled && let Some((_, rows)) = self.groups.last_mut() {
            *rows -= 1;
            if *rows == 0 {
                self.groups.pop();
            }
        }
        self.skipped += 1;
    }
}

impl RowPlan {
    /// Parses `lines` and appends their rows to `parsed`.
    pub(super) fn parse_lines(
        &self,
        lines: &[u8],
        skip_bad_rows: bool,
        parsed: &mut Parsed,
    ) -> Result<(), RowError> {
        if memchr(b'"', lines).is_some() {
            return self.parse_quoted(lines, skip_bad_rows, parsed);
        }
        let mut at = 0;
        while at < lines.len() {
            at = self.parse_plain_rows(lines, at, parsed);
            if at == lines.len() {
                break;
            }
            // A blank line, a bad row or one with something unusual: look at it by itself.
            let end = memchr(b'\n', &lines[at..]).map_or(lines.len(), |i| at + i);
            let line = lines[at..end].strip_suffix(b"\r").unwrap_or(&lines[at..end]);
            parsed.columns.iter_mut().for_each(|column| column.truncate(parsed.rows));
            if !line.trim_ascii().is_empty() {
                let fields = line.split(|&byte| byte == self.separator);
                let result = self.parse_fields(fields, parsed);
                finish_row(result, at, skip_bad_rows, parsed)?;
            }
            at = end + 1;
        }
        Ok(())
    }

    /// Parses rows of plain numbers from `lines[at]` on; returns where the first row starts that is
    /// not that, part of which may be left in `parsed.columns`.
    fn parse_plain_rows(&self, lines: &[u8], mut at: usize, parsed: &mut Parsed) -> usize {
        #[cfg(target_arch = "x86_64")]
        if let Some(simd) = pulp::x86::V3::try_new() {
            return simd.vectorize(PlainRows { simd, plan: self, lines, at, parsed });
        }
        while let Some(next) = self.parse_row(lines, at, parsed) {
            parsed.rows += 1;
            at = next;
        }
        at
    }

    /// Parses the row of plain numbers that starts at `lines[at]` and returns where the next one
    /// starts; `None`, with part of the row left in `parsed.columns`, if it is not that.
    #[inline(always)]
    fn parse_row(&self, lines: &[u8], mut at: usize, parsed: &mut Parsed) -> Option<usize> {
        let last = self.steps.len() - 1;
        let mut label = None;
        let mut columns = parsed.columns.iter_mut();
        for (column, step) in self.steps.iter().enumerate() {
            let end = match step {
                Step::Number => {
                    let (value, end) = Portable.parse_plain(lines, at)?;
                    columns.next()?.push(value);
                    end
                }
                Step::Skip => field_end(lines, at, self.separator)?,
                Step::Group => {
                    let end = field_end(lines, at, self.separator)?;
                    label = Some(at..end);
                    end
                }
            };
            if column < last {
                if *lines.get(end)? != self.separator {
                    return None;
                }
                at = end + 1;
            } else {
                at = after_line_end(lines, end)?;
            }
        }
        if let Some(label) = label {
            parsed.push_group(lines[label].trim_ascii());
        }
        Some(at)
    }

    /// The same for lines with quotes, by the csv crate.
    fn parse_quoted(
        &self,
        lines: &[u8],
        skip_bad_rows: bool,
        parsed: &mut Parsed,
    ) -> Result<(), RowError> {
        let mut reader = csv::ReaderBuilder::new();
        reader.has_headers(false).flexible(true).delimiter(self.separator);
        let mut record = csv::ByteRecord::new();
        let mut start = 0;
        while start < lines.len() {
            let end = memchr(b'\n', &lines[start..]).map_or(lines.len(), |i| start + i + 1);
            let line = &lines[start..end];
            // Bytes in memory cannot fail to be read, and any line is some record.
            let found = reader.from_reader(line).read_byte_record(&mut record).unwrap_or(false);
            let blank = record.len() == 1 && record[0].trim_ascii().is_empty();
            if found && !blank {
                let closed = memchr_iter(b'"', line).count().is_multiple_of(2);
                let result = match closed {
                    true => self.parse_fields(record.iter(), parsed),
                    false => Err((RowProblem::OpenQuote, false)),
                };
                finish_row(result, start, skip_bad_rows, parsed)?;
            }
            start = end;
        }
        Ok(())
    }

    /// Parses a row from its fields; the whole row is in `parsed`, or `false` with nothing counted
    /// but what [`Parsed::take_back_row`] takes back.
    fn parse_fields<'a>(
        &self,
        fields: impl Iterator<Item = &'a [u8]>,
        parsed: &mut Parsed,
    ) -> Result<(), (RowProblem, bool)> {
        let mut labelled = false;
        let mut problem = None;
        let mut found = 0;
        let mut slot = 0;
        for (column, field) in fields.enumerate() {
            found += 1;
            match self.steps.get(column) {
                Some(Step::Number) => {
                    match parse_field(field) {
                        Ok(value) => parsed.columns[slot].push(value),
                        Err(error) => {
                            problem = problem.or_else(|| Some(self.problem(error, column, field)));
                        }
                    }
                    slot += 1;
                }
                Some(Step::Group) => {
                    parsed.push_group(field.trim_ascii());
                    labelled = true;
                }
                Some(Step::Skip) | None => {}
            }
        }
        let expected = self.names.len();
        // A wrong number of columns says more than what that makes of the fields.
        if found != expected {
            problem = Some(RowProblem::ColumnCount { expected, found });
        }
        match problem {
            None => Ok(()),
            Some(problem) => Err((problem, labelled)),
        }
    }

    fn problem(&self, error: NumberError, column: usize, field: &[u8]) -> RowProblem {
        let name = self.names[column].clone();
        let field_at = Field { column, name };
        let found = || {
            let text = String::from_utf8_lossy(field.trim_ascii()).into_owned();
            match text.char_indices().nth(40) {
                Some((at, _)) => format!("{}…", &text[..at]),
                None => text,
            }
        };
        match error {
            NumberError::Empty => RowProblem::EmptyField { field: field_at },
            NumberError::NotANumber => RowProblem::NotANumber { field: field_at, found: found() },
            NumberError::NotFinite => RowProblem::NotFinite { field: field_at, found: found() },
        }
    }
}

fn finish_row(
    result: Result<(), (RowProblem, bool)>,
    offset: usize,
    skip_bad_rows: bool,
    parsed: &mut Parsed,
) -> Result<(), RowError> {
    match result {
        Ok(()) => parsed.rows += 1,
        Err((_, labelled)) if skip_bad_rows => parsed.take_back_row(labelled),
        Err((problem, _)) => return Err(RowError { offset, problem }),
    }
    Ok(())
}

/// Where the field ends that starts at `lines[at]`: at a separator or at a line end.
#[inline(always)]
fn field_end(lines: &[u8], at: usize, separator: u8) -> Option<usize> {
    memchr2(separator, b'\n', lines.get(at..)?).map(|i| at + i)
}

/// Where the next line starts if a line ends at `lines[at]`.
#[inline(always)]
fn after_line_end(lines: &[u8], at: usize) -> Option<usize> {
    match *lines.get(at)? {
        b'\n' => Some(at + 1),
        b'\r' if lines.get(at + 1) == Some(&b'\n') => Some(at + 2),
        _ => None,
    }
}
