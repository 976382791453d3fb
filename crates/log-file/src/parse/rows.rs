//! Parses rows of separated values into columns, only those that are wanted.
//!
//! For a few rows at a time, the short way first finds where their fields end, then parses them
//! column by column: no step waits for the one before it, and where columns hold numbers of one kind
//! branches are predicted. Blank and bad rows are parsed one by one. Lines with quotes go to the csv
//! crate, with the same results; a quoted field cannot contain a line break.

#[cfg(test)]
mod tests;

use memchr::{memchr, memchr_iter};
use pulp::Arch;
use shell_data::instructions::arch;

use super::field_ends::FieldEnds;
use super::instruction_set::{ColumnFields, InstructionSet, Portable};
#[cfg(all(target_arch = "aarch64", target_endian = "little"))]
use super::neon::Neon;
use super::number::{parse_date, parse_field};
use super::parsed_rows::ParsedRows;
#[cfg(target_arch = "x86_64")]
use super::{avx2::Avx2, avx512::Widest};
use crate::error::{Field, FieldProblem, RowProblem};

/// Which columns of a row are parsed, and how.
#[derive(Debug)]
pub(crate) struct RowPlan {
    pub(crate) separator: u8,
    /// The use of each column.
    pub(crate) uses: Vec<ColumnUse>,
    /// The column with the label of the row's group, whatever its use besides.
    pub(crate) group: Option<usize>,
    /// Columns that are wanted as text, whatever their use besides.
    pub(crate) texts: Vec<usize>,
    /// Names of all columns.
    pub(crate) names: Vec<String>,
    /// No converter gives a reading of a larger magnitude.
    pub(crate) largest_reading: f64,
}

/// The use of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ColumnUse {
    Skip,
    /// Parse it into the next column of the result.
    Number,
    /// The same, and refuse what no converter gives.
    Reading,
    /// The same, and refuse what no sensor measures.
    Load,
    /// Parse it into the next column of the result, as a date and time.
    Date,
}

impl ColumnUse {
    fn is_number(self) -> bool {
        self != Self::Skip
    }
}

/// The largest load anywhere, in the units of the log: its square is far from the largest number.
const LARGEST_LOAD: f64 = 1e15;

/// A bad row.
#[derive(Debug, PartialEq)]
pub(crate) struct RowError {
    /// Where the row starts in the lines that were parsed.
    pub(crate) offset: usize,
    pub(crate) problem: RowProblem,
}

impl RowPlan {
    /// Parses `lines` and adds their rows to `parsed`, to be finished when there are no more.
    pub(crate) fn parse_lines(
        &self,
        lines: &[u8],
        skip_bad_rows: bool,
        parsed: &mut ParsedRows,
    ) -> Result<(), RowError> {
        self.parse_lines_by(arch(), lines, skip_bad_rows, parsed)
    }

    /// The same by one of the sets of instructions that this processor has.
    fn parse_lines_by(
        &self,
        instructions: Arch,
        lines: &[u8],
        skip_bad_rows: bool,
        parsed: &mut ParsedRows,
    ) -> Result<(), RowError> {
        match instructions {
            #[cfg(target_arch = "x86_64")]
            Arch::V4(v4) => self.parse_lines_with(Widest::new(v4), lines, skip_bad_rows, parsed),
            #[cfg(target_arch = "x86_64")]
            Arch::V3(v3) => self.parse_lines_with(Avx2::new(v3), lines, skip_bad_rows, parsed),
            #[cfg(all(target_arch = "aarch64", target_endian = "little"))]
            Arch::Neon(neon) => {
                self.parse_lines_with(Neon::new(neon), lines, skip_bad_rows, parsed)
            }
            _ => self.parse_lines_with(Portable, lines, skip_bad_rows, parsed),
        }
    }

    fn parse_lines_with(
        &self,
        set: impl InstructionSet,
        lines: &[u8],
        skip_bad_rows: bool,
        parsed: &mut ParsedRows,
    ) -> Result<(), RowError> {
        if memchr(b'"', lines).is_some() {
            // Quotes around whole fields say nothing; where all is right without them, it is with them.
            if let Some(plain) = without_quotes(lines, self.separator) {
                let (rows, skipped) = (parsed.rows, parsed.skipped);
                let (groups, texts) = (parsed.groups.clone(), parsed.texts.clone());
                if self.parse_unquoted(set, &plain, skip_bad_rows, parsed).is_ok() {
                    return Ok(());
                }
                (parsed.rows, parsed.skipped) = (rows, skipped);
                (parsed.groups, parsed.texts) = (groups, texts);
            }
            return self.parse_quoted(lines, skip_bad_rows, parsed);
        }
        self.parse_unquoted(set, lines, skip_bad_rows, parsed)
    }

    fn parse_unquoted(
        &self,
        set: impl InstructionSet,
        lines: &[u8],
        skip_bad_rows: bool,
        parsed: &mut ParsedRows,
    ) -> Result<(), RowError> {
        let mut ends = FieldEnds::default();
        let mut at = 0;
        while at < lines.len() {
            at = self.parse_plain_rows(set, lines, at, &mut ends, parsed);
            if at == lines.len() {
                break;
            }
            // A blank line, a bad row or one with something unusual: look at it by itself.
            let end = memchr(b'\n', &lines[at..]).map_or(lines.len(), |i| at + i);
            let line = lines[at..end].strip_suffix(b"\r").unwrap_or(&lines[at..end]);
            if !line.trim_ascii().is_empty() && !is_comment(line) {
                let fields = line.split(|&byte| byte == self.separator);
                let result = self.parse_fields(fields, parsed);
                let may_skip =
                    skip_bad_rows || is_cut(&result, self.names.len(), end == lines.len());
                finish_row(result, at, may_skip, parsed)?;
            }
            at = end + 1;
            // More blank lines cost no more than their bytes.
            at += lines.get(at..).map_or(0, blank_lines);
        }
        Ok(())
    }

    /// Parses rows from `lines[at]` on; returns where the first row starts that is blank or wrong.
    /// `ends` is room for the ends of fields.
    fn parse_plain_rows<L: InstructionSet>(
        &self,
        set: L,
        lines: &[u8],
        mut at: usize,
        ends: &mut FieldEnds,
        parsed: &mut ParsedRows,
    ) -> usize {
        loop {
            let columns = self.uses.len();
            set.run(
                #[inline(always)]
                || ends.find(set, lines, at, self.separator, columns),
            );
            let whole = ends.whole_rows(lines, columns);
            let right = self.parse_columns(set, lines, ends, whole, parsed);
            parsed.rows += right;
            if right > 0 {
                at = ends.end_of(right, columns) + 1;
            }
            if right < whole || whole == 0 {
                return at;
            }
        }
    }

    /// Parses `rows` rows, column by column, from the ends where their fields end; returns how
    /// many are right before the first that is wrong.
    fn parse_columns<L: InstructionSet>(
        &self,
        set: L,
        lines: &[u8],
        ends: &FieldEnds,
        rows: usize,
        parsed: &mut ParsedRows,
    ) -> usize {
        if rows == 0 {
            return 0;
        }
        let mut right = rows;
        let count = self.uses.len();
        let mut columns = parsed.columns.iter_mut();
        for (column, step) in self.uses.iter().enumerate().filter(|(_, step)| step.is_number()) {
            let Some(values) = columns.next() else { break };
            let rows = parsed.rows..parsed.rows + right;
            if values.len() < rows.end {
                values.resize(rows.end, 0.0);
            }
            let values = &mut values[rows];
            let fields = ends.of_column(column, count);
            let wrong = match step {
                ColumnUse::Date => parse_dates(lines, fields, values),
                _ => set.run(
                    #[inline(always)]
                    || parse_column(set, lines, fields, values),
                ),
            };
            right = wrong.unwrap_or(right);
            if let Some(largest) = self.largest(*step) {
                right = believable(&values[..right], largest);
            }
        }
        if let Some(group) = self.group {
            let fields = ends.of_column(group, count);
            for row in 0..right {
                let (start, end) = fields.position(row);
                parsed.push_group(lines[start..end].trim_ascii());
            }
        }
        for (text, &column) in self.texts.iter().enumerate() {
            let fields = ends.of_column(column, count);
            for row in 0..right {
                let (start, end) = fields.position(row);
                parsed.push_text(text, lines[start..end].trim_ascii());
            }
        }
        right
    }

    /// The largest magnitude of a column that is believed.
    fn largest(&self, step: ColumnUse) -> Option<f64> {
        match step {
            ColumnUse::Reading => Some(self.largest_reading),
            ColumnUse::Load => Some(LARGEST_LOAD),
            ColumnUse::Skip | ColumnUse::Number | ColumnUse::Date => None,
        }
    }

    /// The number, unless it is too large for its column.
    fn believed(&self, step: ColumnUse, value: f64) -> Result<f64, FieldProblem> {
        match self.largest(step) {
            Some(largest) if value.abs() > largest => Err(match step {
                ColumnUse::Load => FieldProblem::UnbelievableLoad { largest },
                _ => FieldProblem::UnbelievableReading { largest },
            }),
            _ => Ok(value),
        }
    }

    /// The same for lines with quotes, by the csv crate.
    fn parse_quoted(
        &self,
        lines: &[u8],
        skip_bad_rows: bool,
        parsed: &mut ParsedRows,
    ) -> Result<(), RowError> {
        let mut reader = csv::ReaderBuilder::new();
        reader.has_headers(false).flexible(true).delimiter(self.separator);
        // A carriage return within a line ends no row.
        reader.terminator(csv::Terminator::Any(b'\n'));
        let mut record = csv::ByteRecord::new();
        let mut start = 0;
        while start < lines.len() {
            let end = memchr(b'\n', &lines[start..]).map_or(lines.len(), |i| start + i + 1);
            let line = &lines[start..end];
            // Bytes in memory cannot fail to be read, and any line is some record.
            let content = line.strip_suffix(b"\n").unwrap_or(line);
            let content = content.strip_suffix(b"\r").unwrap_or(content);
            let found = reader.from_reader(content).read_byte_record(&mut record).unwrap_or(false);
            let blank = record.len() == 1 && record[0].trim_ascii().is_empty();
            if found && !blank && !is_comment(line) {
                let closed = memchr_iter(b'"', line).count().is_multiple_of(2);
                let result = match closed {
                    true => self.parse_fields(record.iter(), parsed),
                    false => Err((RowProblem::OpenQuote, false)),
                };
                let may_skip =
                    skip_bad_rows || is_cut(&result, self.names.len(), !line.ends_with(b"\n"));
                finish_row(result, start, may_skip, parsed)?;
            }
            start = end;
        }
        Ok(())
    }

    /// Parses a row from its fields; the whole row is in `parsed`, or `false` with nothing counted
    /// but what [`ParsedRows::take_back_row`] takes back.
    fn parse_fields<'a>(
        &self,
        fields: impl Iterator<Item = &'a [u8]>,
        parsed: &mut ParsedRows,
    ) -> Result<(), (RowProblem, bool)> {
        let mut labelled = false;
        let mut texts: Vec<(usize, &[u8])> = Vec::new();
        let mut problem = None;
        let mut found = 0;
        let mut slot = 0;
        for (column, field) in fields.enumerate() {
            found += 1;
            match self.uses.get(column) {
                Some(step) if step.is_number() => {
                    let parsed_field = match step {
                        ColumnUse::Date => parse_date(field),
                        _ => parse_field(field).and_then(|value| self.believed(*step, value)),
                    };
                    match parsed_field {
                        Ok(value) => parsed.put(slot, value),
                        Err(error) => {
                            problem = problem.or_else(|| Some(self.problem(error, column, field)));
                        }
                    }
                    slot += 1;
                }
                _ => {}
            }
            if self.group == Some(column) {
                parsed.push_group(field.trim_ascii());
                labelled = true;
            }
            let text = self.texts.iter().position(|&at| at == column);
            texts.extend(text.map(|text| (text, field.trim_ascii())));
        }
        let expected = self.names.len();
        // A wrong number of columns says more than what that makes of the fields.
        if found != expected {
            problem = Some(RowProblem::ColumnCount { expected, found });
        }
        match problem {
            None => {
                texts.into_iter().for_each(|(text, field)| parsed.push_text(text, field));
                Ok(())
            }
            Some(problem) => Err((problem, labelled)),
        }
    }

    fn problem(&self, problem: FieldProblem, column: usize, field: &[u8]) -> RowProblem {
        let name = self.names[column].clone();
        let mut found = String::from_utf8_lossy(field.trim_ascii()).into_owned();
        if let Some((at, _)) = found.char_indices().nth(40) {
            found.truncate(at);
            found.push('…');
        }
        RowProblem::Field { field: Field { column, name }, problem, found }
    }
}

/// How many values there are before the first of a larger magnitude.
fn believable(values: &[f64], largest: f64) -> usize {
    let is_believable = |value: &f64| value.abs() <= largest;
    // As a rule all of them, which is found without a branch for each.
    match values.iter().fold(true, |all, value| all & is_believable(value)) {
        true => values.len(),
        false => values.iter().take_while(|value| is_believable(value)).count(),
    }
}

/// Lines without their quotes, if each stands around a whole field that needs none.
fn without_quotes(lines: &[u8], separator: u8) -> Option<Vec<u8>> {
    let ends_field = |byte: u8| byte == separator || byte == b'\n' || byte == b'\r';
    let mut plain = Vec::with_capacity(lines.len());
    let mut quotes = memchr_iter(b'"', lines);
    let mut copied = 0;
    while let Some(open) = quotes.next() {
        let close = quotes.next()?;
        let begins = open.checked_sub(1).is_none_or(|before| ends_field(lines[before]));
        let ends = lines.get(close + 1).is_none_or(|&after| ends_field(after));
        let field = &lines[open + 1..close];
        if !begins || !ends || field.iter().any(|&byte| ends_field(byte)) {
            return None;
        }
        plain.extend_from_slice(&lines[copied..open]);
        plain.extend_from_slice(field);
        copied = close + 1;
    }
    plain.extend_from_slice(&lines[copied..]);
    Some(plain)
}

/// Whether a line is a comment.
pub(crate) fn is_comment(line: &[u8]) -> bool {
    let line = line.trim_ascii_start();
    line.starts_with(b"#") || line.starts_with(b"//")
}

/// The bytes of the blank lines at the start of some lines.
fn blank_lines(lines: &[u8]) -> usize {
    let is_blank = |byte: &u8| matches!(byte, b'\n' | b'\r');
    let blank = lines.iter().position(|byte| !is_blank(byte)).unwrap_or(lines.len());
    memchr::memrchr(b'\n', &lines[..blank]).map_or(0, |end| end + 1)
}

/// Whether a row is cut off: the end of a file whose writer was killed or lost power. Such a row is
/// skipped and is not an error.
fn is_cut(result: &Result<(), (RowProblem, bool)>, columns: usize, is_open: bool) -> bool {
    let is_short = match result {
        Err((RowProblem::ColumnCount { expected, found }, _)) => found < expected,
        // Right after a separator.
        Err((RowProblem::Field { field, problem: FieldProblem::Empty, .. }, _)) => {
            field.column + 1 == columns
        }
        _ => false,
    };
    is_open && is_short
}

fn finish_row(
    result: Result<(), (RowProblem, bool)>,
    offset: usize,
    skip_bad_rows: bool,
    parsed: &mut ParsedRows,
) -> Result<(), RowError> {
    match result {
        Ok(()) => parsed.rows += 1,
        Err((_, labelled)) if skip_bad_rows => parsed.take_back_row(labelled),
        Err((problem, _)) => return Err(RowError { offset, problem }),
    }
    Ok(())
}

/// The same for dates and times.
fn parse_dates(lines: &[u8], fields: ColumnFields<'_>, values: &mut [f64]) -> Option<usize> {
    values.iter_mut().enumerate().position(|(row, value)| {
        let (start, end) = fields.position(row);
        let date = lines.get(start..end).map(parse_date);
        match date {
            Some(Ok(seconds)) => {
                *value = seconds;
                false
            }
            _ => true,
        }
    })
}

/// Parses the fields of a column into `values`; returns which one is the first that is wrong.
#[inline(always)]
fn parse_column(
    set: impl InstructionSet,
    lines: &[u8],
    fields: ColumnFields<'_>,
    values: &mut [f64],
) -> Option<usize> {
    // Readings are short integers: as long as they are, so are the next.
    let whole = set.whole_numbers(lines, fields, values);
    for (row, value) in values.iter_mut().enumerate().skip(whole) {
        let (start, end) = fields.position(row);
        *value = match set.plain_number(lines, start, end) {
            Some(number) => number,
            None => match parse_unusual(lines, start, end) {
                Some(number) => number,
                None => return Some(row),
            },
        };
    }
    None
}

/// Out of the way of the loop for plain numbers.
#[cold]
#[inline(never)]
fn parse_unusual(lines: &[u8], start: usize, end: usize) -> Option<f64> {
    parse_field(lines.get(start..end)?).ok()
}
