//! Parses rows of separated values into columns. Only the requested columns are parsed.
//!
//! The fast path locates the ends of all fields of some rows, then parses column by column. No step waits for the
//! previous one, and branches are predicted well because a column has numbers of one kind. Blank and bad rows are
//! parsed one by one. If a quoted field contains a separator or a quote, the csv crate splits its line; no quoted field
//! can contain a line break.

#[cfg(test)]
mod tests;

use memchr::{memchr, memchr_iter, memchr2};
use pulp::Arch;

#[cfg(target_arch = "x86_64")]
use super::avx2::Avx2;
use super::date::{DateOrder, parse_date};
use super::field_ends::FieldEnds;
use super::instruction_set::{ColumnFields, InstructionSet, Portable};
#[cfg(all(target_arch = "aarch64", target_endian = "little"))]
use super::neon::Neon;
use super::number::{finite, parse_digits, parse_field, parse_long, signed};
use super::parsed_rows::{ParsedRows, RowError};
use crate::error::{FieldProblem, RowProblem};
use crate::format::meaning::{are_units, known_names};
use crate::line::{is_comment, line_ends, quoted_fields, without_returns};
use shell_data::wrench::Axis;

/// The column that shows that a log contains samples of a reference as well as of the board.
const REFERENCE_NUMBER: &str = "ref_index";

#[derive(Debug)]
pub(crate) struct RowPlan {
    pub(crate) separator: u8,
    pub(crate) uses: Vec<ColumnUse>,
    /// Columns requested as text; they may have another use as well.
    pub(crate) labels: Vec<usize>,
    pub(crate) names: Vec<String>,
    /// Lines of the head that may be repeated where logs were put together.
    pub(crate) head: Option<HeadLines>,
}

/// The lines that name the columns and their units.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct HeadLines {
    pub(crate) number: u64,
    pub(crate) names: Vec<u8>,
    pub(crate) units: Vec<u8>,
}

/// The kind of a line in the middle of a log that is no row.
#[derive(Clone, Copy, Debug, PartialEq)]
enum OtherLine {
    /// A repeated line of the head.
    Head,
    /// Names or units that differ from the head.
    OtherHead,
    Other,
}

impl HeadLines {
    fn recognise(&self, line: &[u8], separator: u8) -> OtherLine {
        // Lines are compared without blanks, quotes and comment marks.
        let bare = |line: &[u8]| -> Vec<u8> {
            let is_text = |byte: &u8| !byte.is_ascii_whitespace() && !b"\"#%/".contains(byte);
            line.iter().copied().filter(is_text).collect()
        };
        let text = bare(line);
        if !text.is_empty() && [&self.names, &self.units].iter().any(|known| bare(known) == text) {
            return OtherLine::Head;
        }
        let is_marked = |line: &[u8]| is_comment(line) || line.trim_ascii().starts_with(b"%");
        // If the names are not in a comment, no comment is a head.
        if is_marked(line) && !is_marked(&self.names) {
            return OtherLine::Other;
        }
        let line = String::from_utf8_lossy(line.trim_ascii());
        let line = line.trim_start_matches(['#', '%', '/', ' ']);
        let is_between = |c: char| match is_marked(&self.names) {
            true => c.is_whitespace() || ",;|".contains(c),
            false => c == char::from(separator),
        };
        let fields = line.split(is_between).map(|field| field.trim().trim_matches('"'));
        let fields: Vec<String> =
            fields.filter(|field| !field.is_empty()).map(str::to_owned).collect();
        let is_text = fields.iter().all(|field| field.parse::<f64>().is_err());
        let are_names = 2 * known_names(&fields) >= fields.len().min(4);
        let are_other_units = !self.units.is_empty() && are_units(&fields);
        match is_text && fields.len() > 1 && (are_names || are_other_units) {
            true => OtherLine::OtherHead,
            false => OtherLine::Other,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum ColumnUse {
    Skip,
    /// Parse a number into the next column of the result, and reject values beyond the limit.
    Number(Option<Limit>),
    /// Parse a date and time into the next column of the result.
    Date(DateOrder),
}

/// The largest plausible magnitude of a number, and a description of the expected value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Limit(f64, &'static str);

impl Limit {
    /// Limit of readings in robot telemetry, whose converter has at most 16 bits.
    pub(crate) const LOGGED_READING: Self = Self(65_535.0, "a reading of at most 65535 counts");
    /// Limit of readings in other logs: no converter has more than 32 bits.
    pub(crate) const READING: Self =
        Self(4_294_967_295.0, "a reading of at most 4294967295 counts");
    /// Limit of loads, in the units of the log: their squares are far below the largest double.
    pub(crate) const LOAD: Self = Self(1e15, "a load of at most 1e15 N or N·m");

    fn check(self, value: f64) -> Result<f64, FieldProblem> {
        if value.abs() <= self.0 { Ok(value) } else { Err(FieldProblem::BeyondLimit(self.1)) }
    }
}

impl ColumnUse {
    pub(super) fn most(self) -> f64 {
        match self {
            Self::Number(Some(Limit(most, _))) => most,
            _ => f64::MAX,
        }
    }

    pub(super) fn check(self, value: f64) -> Result<f64, FieldProblem> {
        match self {
            Self::Number(Some(limit)) => finite(value).and_then(|value| limit.check(value)),
            _ => finite(value),
        }
    }
}

impl RowPlan {
    /// Parses `lines` and appends their rows to `parsed`. Call [`ParsedRows::finish`] after the last lines.
    pub(crate) fn parse_lines(
        &self,
        instructions: Arch,
        lines: &[u8],
        skip_bad_rows: bool,
        parsed: &mut ParsedRows,
    ) -> Result<(), RowError> {
        match instructions {
            #[cfg(target_arch = "x86_64")]
            Arch::V4(v4) => self.parse_lines_with(Avx2(*v4), lines, skip_bad_rows, parsed),
            #[cfg(target_arch = "x86_64")]
            Arch::V3(v3) => self.parse_lines_with(Avx2(v3), lines, skip_bad_rows, parsed),
            #[cfg(all(target_arch = "aarch64", target_endian = "little"))]
            Arch::Neon(neon) => self.parse_lines_with(Neon(neon), lines, skip_bad_rows, parsed),
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
        let is_quoted = memchr(b'"', lines).is_some();
        // Quotes around whole fields have no effect.
        let bare = if is_quoted { without_quotes(lines, self.separator) } else { None };
        let are_plain = !is_quoted || bare.is_some();
        let lines = bare.as_deref().unwrap_or(lines);
        let columns = self.uses.len();
        let mut ends = std::mem::take(&mut parsed.ends);
        let mut at = 0;
        while at < lines.len() {
            if are_plain {
                set.run(
                    #[inline(always)]
                    || ends.find(set, lines, at, self.separator, columns),
                );
                let whole = ends.whole_rows(lines, columns);
                let right = self.parse_columns(set, lines, &ends, whole, parsed);
                parsed.rows += right;
                if right > 0 {
                    at = ends.end_of(right, columns) + 1;
                }
                if right == whole && whole > 0 {
                    continue;
                }
            }
            // A blank line, a bad row, or one with unusual fields: parse it separately.
            let end = memchr(b'\n', &lines[at..]).map_or(lines.len(), |i| at + i);
            let line = without_returns(&lines[at..end]);
            let is_cut = |problem: &RowProblem| {
                end == lines.len() && self.is_short(problem) || self.lacks_reference(problem)
            };
            // Rows below other names would be read into the wrong columns.
            let is_skipped = |problem: &RowProblem| {
                !matches!(problem, RowProblem::OtherNames(_)) && (skip_bad_rows || is_cut(problem))
            };
            match self.parse_line(line, parsed) {
                None => parsed.pass_lines(1),
                Some(Ok(())) => parsed.rows += 1,
                // A writer that was killed or lost power leaves a cut-off last row. Neither this nor a frame without a
                // sample of the reference is an error.
                Some(Err(problem)) if is_skipped(&problem) => {
                    parsed.skip(at, problem);
                    parsed.pass_lines(1);
                }
                Some(Err(problem)) => return Err(RowError { offset: at, problem }),
            }
            at = end + 1;
            // Skips further blank lines at the cost of their bytes only.
            let rest = lines.get(at..).unwrap_or_default();
            let blank = &rest[..blank_lines(rest)];
            parsed.pass_lines(line_ends(blank));
            at += blank.len();
        }
        parsed.ends = ends;
        Ok(())
    }

    /// Parses rows column by column from the ends of their fields; returns the number of valid rows before the first
    /// invalid one.
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
        for (column, step) in
            self.uses.iter().enumerate().filter(|(_, step)| **step != ColumnUse::Skip)
        {
            let Some(values) = columns.next() else { break };
            let rows = parsed.rows..parsed.rows + right;
            if values.len() < rows.end {
                values.resize(rows.end, 0.0);
            }
            let values = &mut values[rows];
            let fields = ends.of_column(column, count);
            let wrong = match step {
                ColumnUse::Date(order) => parse_dates(lines, fields, *order, values),
                _ => set.run(
                    #[inline(always)]
                    || parse_column(set, lines, fields, values),
                ),
            };
            right = wrong.unwrap_or(right);
            if let ColumnUse::Number(Some(Limit(largest, _))) = step {
                let is_believable = |value: &f64| value.abs() <= *largest;
                let values = &values[..right];
                // Usually all values are plausible; this check has no branch per value.
                if !values.iter().fold(true, |all, value| all & is_believable(value)) {
                    right = values.iter().take_while(|value| is_believable(value)).count();
                }
            }
        }
        for (label, &column) in self.labels.iter().enumerate() {
            let fields = ends.of_column(column, count);
            for row in 0..right {
                let (start, end) = fields.position(row);
                parsed.push_label(label, &lines[start..end]);
            }
        }
        right
    }

    /// Parses the row of a line; `None` if it is blank or a comment.
    fn parse_line(&self, line: &[u8], parsed: &mut ParsedRows) -> Option<Result<(), RowProblem>> {
        if line.trim_ascii().is_empty() {
            return None;
        }
        if let Some(head) = self.head.as_ref().filter(|_| !begins_with_number(line)) {
            match head.recognise(line, self.separator) {
                OtherLine::Head => {
                    parsed.repeated_heads += 1;
                    return None;
                }
                OtherLine::OtherHead => return Some(Err(RowProblem::OtherNames(head.number))),
                OtherLine::Other => {}
            }
        }
        if is_comment(line) {
            return None;
        }
        if memchr(b'"', line).is_none() {
            return Some(self.parse_fields(line.split(|&byte| byte == self.separator), parsed));
        }
        let record = quoted_fields(line, self.separator);
        if record.len() == 1 && record[0].trim_ascii().is_empty() {
            return None;
        }
        Some(match memchr_iter(b'"', line).count().is_multiple_of(2) {
            true => self.parse_fields(record.iter(), parsed),
            false => Err(RowProblem::OpenQuote),
        })
    }

    /// Parses a row from its fields into `parsed`, without counting it.
    fn parse_fields<'a>(
        &self,
        fields: impl Iterator<Item = &'a [u8]>,
        parsed: &mut ParsedRows,
    ) -> Result<(), RowProblem> {
        let mut labels: Vec<(usize, &[u8])> = Vec::new();
        let (mut problem, mut found, mut slot) = (None, 0, 0);
        for (column, field) in fields.enumerate() {
            found += 1;
            if let Some(step) = self.uses.get(column).filter(|step| **step != ColumnUse::Skip) {
                let number = match step {
                    ColumnUse::Date(order) => parse_date(field, *order),
                    ColumnUse::Number(Some(limit)) => {
                        parse_field(field).and_then(|it| limit.check(it))
                    }
                    _ => parse_field(field),
                };
                match number {
                    Ok(value) => parsed.put(slot, value),
                    Err(error) => {
                        problem = problem.or_else(|| Some(self.problem(error, column, field)));
                    }
                }
                slot += 1;
            }
            let of_column = self.labels.iter().enumerate().filter(|(_, at)| **at == column);
            labels.extend(of_column.map(|(label, _)| (label, field)));
        }
        let expected = self.names.len();
        // A wrong number of columns takes precedence over the invalid fields that result from it.
        if found != expected {
            problem = Some(RowProblem::ColumnCount { expected, found });
        }
        match problem {
            Some(problem) => Err(problem),
            None => {
                labels.into_iter().for_each(|(label, field)| parsed.push_label(label, field));
                Ok(())
            }
        }
    }

    /// Returns true if a row of a board has no forces because the reference had no sample at that time.
    fn lacks_reference(&self, problem: &RowProblem) -> bool {
        let is_load = |name: &String| Axis::ALL.iter().any(|axis| axis.column() == name);
        let RowProblem::Field { name, problem: FieldProblem::Empty, .. } = problem else {
            return false;
        };
        is_load(name) && self.names.iter().any(|name| name == REFERENCE_NUMBER)
    }

    /// Returns true if the last field of a row is missing or empty.
    fn is_short(&self, problem: &RowProblem) -> bool {
        match problem {
            RowProblem::ColumnCount { expected, found } => found < expected,
            // The row ends after a separator.
            RowProblem::Field { column, problem: FieldProblem::Empty, .. } => {
                column + 1 == self.names.len()
            }
            _ => false,
        }
    }

    pub(super) fn problem(&self, problem: FieldProblem, column: usize, field: &[u8]) -> RowProblem {
        let name = self.names[column].clone();
        let mut found = String::from_utf8_lossy(field.trim_ascii()).into_owned();
        if let Some((at, _)) = found.char_indices().nth(40) {
            found.truncate(at);
            found.push('…');
        }
        RowProblem::Field { column, name, problem, found }
    }
}

/// Removes quotes, if all enclose a whole field that does not need them. Blanks at the ends of lines replace them, so
/// that line positions stay valid.
fn without_quotes(lines: &[u8], separator: u8) -> Option<Vec<u8>> {
    let ends_field = |byte: u8| byte == separator || byte == b'\n' || byte == b'\r';
    let is_end = |byte: Option<&u8>| byte.is_none_or(|&byte| ends_field(byte));
    let mut bare = Vec::with_capacity(lines.len());
    let (mut at, mut copied) = (0, 0);
    while let Some(found) = memchr2(b'"', b'\n', &lines[at..]) {
        at += found;
        if lines[at] == b'\n' {
            let end = at - usize::from(lines[copied..at].ends_with(b"\r"));
            bare.extend_from_slice(&lines[copied..end]);
            bare.resize(end, b' ');
            (at, copied) = (at + 1, end);
            continue;
        }
        let quoted = &lines[at + 1..];
        let length = quoted.iter().position(|&byte| byte == b'"' || ends_field(byte))?;
        if quoted[length] != b'"' || !is_end(lines[..at].last()) || !is_end(quoted.get(length + 1))
        {
            return None;
        }
        bare.extend_from_slice(&lines[copied..at]);
        bare.extend_from_slice(&quoted[..length]);
        at += length + 2;
        copied = at;
    }
    bare.extend_from_slice(&lines[copied..]);
    bare.resize(lines.len(), b' ');
    Some(bare)
}

fn begins_with_number(line: &[u8]) -> bool {
    line.trim_ascii_start()
        .first()
        .is_some_and(|byte| byte.is_ascii_digit() || b"+-.".contains(byte))
}

/// Returns the number of bytes in the blank lines at the start of some lines.
fn blank_lines(lines: &[u8]) -> usize {
    let is_blank = |byte: &u8| matches!(byte, b'\n' | b'\r');
    let blank = lines.iter().position(|byte| !is_blank(byte)).unwrap_or(lines.len());
    memchr::memrchr(b'\n', &lines[..blank]).map_or(0, |end| end + 1)
}

fn parse_dates(
    lines: &[u8],
    fields: ColumnFields<'_>,
    order: DateOrder,
    values: &mut [f64],
) -> Option<usize> {
    values.iter_mut().enumerate().position(|(row, value)| {
        let (start, end) = fields.position(row);
        let date = lines.get(start..end).and_then(|field| parse_date(field, order).ok());
        *value = date.unwrap_or(f64::NAN);
        date.is_none()
    })
}

/// Parses the fields of a column into `values`; returns the index of the first invalid one.
#[inline(always)]
fn parse_column(
    set: impl InstructionSet,
    lines: &[u8],
    fields: ColumnFields<'_>,
    values: &mut [f64],
) -> Option<usize> {
    // Readings are short integers. A fast loop parses them up to the first other field.
    let whole = whole_numbers(lines, fields, values);
    for (row, value) in values.iter_mut().enumerate().skip(whole) {
        let (start, end) = fields.position(row);
        *value = match plain_number(set, lines, start, end) {
            Some(number) => number,
            None => match parse_unusual(lines, start, end) {
                Some(number) => number,
                None => return Some(row),
            },
        };
    }
    None
}

/// Parses fields of a column as long as they are integers of up to eight digits; returns their number.
#[inline(always)]
fn whole_numbers(lines: &[u8], fields: ColumnFields<'_>, values: &mut [f64]) -> usize {
    for (row, value) in values.iter_mut().enumerate() {
        let (start, end) = fields.position(row);
        let Some(number) = parse_digits(lines, start, end) else { return row };
        *value = number as i64 as f64;
    }
    values.len()
}

/// Parses a plain decimal (`-12`, `-0.125`) in `lines[at..end]`; `None` leaves the field to [`parse_field`].
#[inline(always)]
fn plain_number(set: impl InstructionSet, lines: &[u8], at: usize, end: usize) -> Option<f64> {
    let negative = *lines.get(at)? == b'-';
    let start = at + usize::from(negative);
    let length = end.wrapping_sub(start);
    let plain = if length <= 32 { set.digits(lines, start, end) } else { None };
    match plain {
        Some((mantissa, decimals)) => signed(negative, mantissa, -(decimals as i32)),
        None => other_number(set, lines, at, end),
    }
}

/// Parses a field that [`InstructionSet::digits`] does not accept; separate from the loop over the others.
#[inline(never)]
fn other_number(set: impl InstructionSet, lines: &[u8], at: usize, end: usize) -> Option<f64> {
    set.run(
        #[inline(always)]
        || parse_long(lines, at, end),
    )
}

/// Parses an unusual field; separate from the loop for plain numbers.
#[cold]
#[inline(never)]
fn parse_unusual(lines: &[u8], start: usize, end: usize) -> Option<f64> {
    parse_field(lines.get(start..end)?).ok()
}
